"""Localiser `odometry_only`: the sum of the motions, nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rhs.api.contracts import Context, Localiser, PartSettings
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, View


@dataclass
class OdometryOnly(PartSettings):
    """Dead reckoning: believes the odometry and never looks at the map or at a place."""

    def build(self, context: Context) -> Localiser:
        return DeadReckoning()


class DeadReckoning:
    """Adds motions to the first belief. Started from nothing it stays lost for ever."""

    def __init__(self) -> None:
        import numpy as np

        self._belief = Belief(np.eye(4), np.diag([100.0] * 3 + [10.0] * 3), BeliefStatus.LOST, 0.0)

    def learn(self, views: Sequence[View], grid: Any) -> None:
        """Nothing: dead reckoning has no use for the survey."""

    def start(self, belief: Belief | None) -> None:
        if belief is None:
            self.__init__()  # type: ignore[misc]
        else:
            self._belief = belief

    def update(self, observation: Observation, motion: Motion) -> Belief:
        from rhs.api.belief import moved

        self._belief = moved(self._belief, motion)
        return self._belief
