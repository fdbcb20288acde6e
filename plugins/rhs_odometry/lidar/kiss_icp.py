"""Odometry `kiss_icp_lidar`: KISS-ICP (Vizzo et al., RA-L 2023) by its own library on a lidar's clouds."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..clouds.kiss_icp import made_kiss
from .config import KissIcpLidar
from .odometry import LidarOdometry

WITHOUT_STAMPS = np.array([])  # of the points of a cloud


class KissIcp(LidarOdometry):
    """Begins from the wheels, else from the last motion."""

    settings: KissIcpLidar
    _kiss: Any

    def begin(self, points: np.ndarray) -> None:
        self._kiss = made_kiss(self.settings, self.voxel_m, self.settings.max_range_m)
        self._kiss.register_frame(points, WITHOUT_STAMPS)

    def align(self, points: np.ndarray, before: np.ndarray, guess: np.ndarray) -> np.ndarray:
        self._kiss.last_delta = guess
        self._kiss.register_frame(points, WITHOUT_STAMPS)
        return np.asarray(self._kiss.last_pose, float)

    def settle(self, pose: np.ndarray, *, aligned: bool) -> None:
        if not aligned:
            self._kiss.last_pose = pose
