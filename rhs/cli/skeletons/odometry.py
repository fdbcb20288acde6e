"""An odometry for rhs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Context
from rhs.api.geometry import se2
from rhs.api.records import Motion, Observation, Revision, Tracking


@dataclass
class Skeleton(Bounded):
    """The wheels are believed."""

    share: float = within(0.1, 0.0, 1.0)
    """standard deviation of a step, as a share of it"""

    needs: ClassVar[frozenset[str]] = frozenset({"wheel"})
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self, context.rng)


class Part:
    """Built anew for every run; randomness comes from `rng` alone."""

    def __init__(self, settings: Skeleton, rng: np.random.Generator) -> None:
        self.settings, self.rng = settings, rng

    first: bool = True

    def update(self, observation: Observation) -> Motion:
        """The pose of this view as seen from the view before. The first has none before it."""
        first, self.first = self.first, False
        if first:
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK)
        if observation.wheel is None:
            return Motion(np.eye(4), np.eye(6), Tracking.LOST, reason="no wheels")
        x, y, yaw = observation.wheel
        sigma_m = 1e-3 + self.settings.share * np.hypot(x, y)
        sigma_rad = 1e-3 + self.settings.share * abs(yaw)
        sigmas = np.array([sigma_m, sigma_m, 1e-3, 1e-3, 1e-3, sigma_rad])  # x, y, z in metres, turns about them
        return Motion(se2(x, y, yaw), np.diag(sigmas**2), Tracking.OK)

    def revise(self) -> Revision | None:
        """Nothing that was said is taken back."""
        return None
