"""Localiser `odometry_only`: the sum of the motions, nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rhs.api.contracts import Context, Localiser, PartSettings
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, View

SURE = 0.9  # of the chance of being right, that a map leaves by which it calls itself tracking


@dataclass
class OdometryOnly(PartSettings):
    """Dead reckoning: believes the odometry and never looks at the map or at a place."""

    def build(self, context: Context) -> Localiser:
        return DeadReckoning()


class DeadReckoning:
    """Adds motions to the first belief, as unsure as that and the map there are. Started from nothing it stays lost."""

    def __init__(self) -> None:
        import numpy as np

        from .map_spread import MapSpread

        self._spread = MapSpread()
        self._belief = self._nowhere = Belief(np.eye(4), np.diag([100.0] * 3 + [10.0] * 3), BeliefStatus.LOST, 0.0)

    def learn(self, views: Sequence[View], grid: Any) -> None:
        """How unsure the survey is; dead reckoning has no other use for it."""
        from .map_spread import MapSpread

        self._spread = MapSpread(views)

    def start(self, belief: Belief | None) -> None:
        if belief is None:
            self._belief = self._nowhere
            return
        from rhs.api.belief import chance_right

        covariance = belief.covariance + self._spread.at(belief.map_from_body)
        left = chance_right(covariance) / max(chance_right(belief.covariance), 1e-12)  # of the chance, by an unsure map
        status = BeliefStatus.DEGRADED if belief.status.on_map and left < SURE else belief.status
        self._belief = Belief(belief.map_from_body, covariance, status, belief.probability * left)

    def update(self, observation: Observation, motion: Motion) -> Belief:
        from rhs.api.belief import moved

        self._belief = moved(self._belief, motion)
        return self._belief
