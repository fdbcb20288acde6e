"""A SLAM as the chain sees it: one part in the place of odometry, loop closer, mapper and localiser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rhs.api.contracts import Odometry, Slam
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, Closure, Motion, Observation, Scan, View


def in_place_of(slam: Slam) -> dict[str, Any]:
    """The four parts that the SLAM takes the place of."""
    return {"odometry": SlamOdometry(slam), "loop_closer": SlamCloser(slam), "mapper": SlamMapper(slam),
            "localiser": SlamLocaliser(slam)}


class _Of:
    """A part that asks the SLAM."""

    def __init__(self, slam: Slam) -> None:
        self._slam = slam


class SlamOdometry(_Of, Odometry):
    """Its motions."""

    def update(self, observation: Observation) -> Motion:
        return self._slam.update(observation)


class SlamCloser(_Of):
    """Its trajectory of now: what loops have moved is in it already."""

    def close(self, views: Sequence[View]) -> Closure:
        return Closure(self._slam.trajectory())


class SlamMapper(_Of):
    """Its map of now."""

    draws_furniture = True  # it is handed whole observations

    def update(self, map_from_body: np.ndarray, scan: Scan) -> None:
        """The SLAM has seen it."""

    def grid(self) -> OccupancyGrid:
        return self._slam.grid()

    def reset(self) -> None:
        """The SLAM keeps its map."""


class SlamLocaliser(_Of):
    """Its belief of now: `update` of the odometry has seen this view."""

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """The SLAM was there."""

    def start(self, belief: Belief | None) -> None:
        """The SLAM knows."""

    def update(self, observation: Observation, motion: Motion) -> Belief:
        return self._slam.belief()
