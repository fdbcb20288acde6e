"""A localiser for rhs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.belief import moved
from rhs.api.contracts import Context
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, View


@dataclass
class Skeleton(Bounded):
    """The odometry is believed."""

    lost_m: float = within(10.0, 0.1, 1e4)
    """standard deviation of a position that is not known"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self, context.rng)


class Part:
    """Built anew for every run; randomness comes from `rng` alone."""

    def __init__(self, settings: Skeleton, rng: np.random.Generator) -> None:
        self.settings, self.rng = settings, rng

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """The survey's views and map: a better localiser remembers places here."""

    def start(self, belief: Belief | None) -> None:
        """None: nobody knows where the robot is."""
        anywhere = np.diag([self.settings.lost_m**2] * 3 + [10.0] * 3)
        self.belief = belief or Belief(np.eye(4), anywhere, BeliefStatus.LOST, 0.0)

    def update(self, observation: Observation, motion: Motion) -> Belief:
        """The belief, moved on by the odometry."""
        self.belief = moved(self.belief, motion)
        return self.belief
