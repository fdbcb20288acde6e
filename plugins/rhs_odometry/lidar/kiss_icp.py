"""Odometry `kiss_icp_lidar`: KISS-ICP (Vizzo et al., RA-L 2023) by its own library on a lidar's clouds."""

from __future__ import annotations

from typing import Any

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP

from .config import KissIcpLidar
from .odometry import LidarOdometry

WITHOUT_STAMPS = np.array([])  # of the points of a cloud


class KissIcp(LidarOdometry):
    """Begins from the wheels, else from the last motion."""

    settings: KissIcpLidar
    _kiss: Any

    def begin(self, points: np.ndarray) -> None:
        s = self.settings
        config = KISSConfig()
        config.data.deskew = False
        config.data.min_range, config.data.max_range = s.min_range_m, s.max_range_m
        config.mapping.voxel_size = self.voxel_m
        config.registration.max_num_threads = 1
        config.registration.max_num_iterations = s.iterations
        config.adaptive_threshold.initial_threshold = s.initial_threshold_m
        config.adaptive_threshold.min_motion_th = s.min_motion_m
        self._kiss = KissICP(config)
        self._kiss.register_frame(points, WITHOUT_STAMPS)

    def align(self, points: np.ndarray, before: np.ndarray, guess: np.ndarray) -> np.ndarray:
        self._kiss.last_delta = guess
        self._kiss.register_frame(points, WITHOUT_STAMPS)
        return np.asarray(self._kiss.last_pose, float)

    def settle(self, pose: np.ndarray, *, aligned: bool) -> None:
        if not aligned:
            self._kiss.last_pose = pose
