"""Odometry `kiss_icp`: KISS-ICP (Vizzo et al., RA-L 2023) by its own library, fed with depth clouds.

The library accepts empty clouds and slides along smooth walls without a word; odometry.py says so for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP

from rhs.api.geometry import inverse, orthonormal

from .clouds import Cloud, within_reach
from .config import KissIcp


def made_kiss(settings: Any, voxel_m: float, far_m: float) -> KissICP:
    """The library's own, one thread, clouds as they are. settings: min_range_m, iterations, initial_threshold_m,
    min_motion_m."""
    config = KISSConfig()
    config.data.deskew = False
    config.data.min_range, config.data.max_range = settings.min_range_m, far_m
    config.mapping.voxel_size = voxel_m
    config.registration.max_num_threads = 1
    config.registration.max_num_iterations = settings.iterations
    config.adaptive_threshold.initial_threshold = settings.initial_threshold_m
    config.adaptive_threshold.min_motion_th = settings.min_motion_m
    return KissICP(config)


class KissRegistration:
    """Hands clouds to KISS-ICP and reads its pose; the guess replaces its constant velocity."""

    def __init__(self, settings: KissIcp) -> None:
        far_m = settings.max_range_m * 1.5  # along the ray, not the optical axis
        self._kiss, self._advanced = made_kiss(settings, settings.voxel_m, far_m), settings.advanced
        self._before = np.eye(4)

    def align(self, cloud: Cloud, guess: np.ndarray) -> tuple[np.ndarray, str]:
        before = self._before = np.array(self._kiss.last_pose)
        self._kiss.last_delta = guess
        self._kiss.register_frame(cloud.points, np.array([]))
        motion = inverse(before) @ np.asarray(self._kiss.last_pose, float)
        if not np.all(np.isfinite(motion)) or not within_reach(motion, guess, self._advanced):
            self._kiss.last_pose = before @ guess
            return guess, "the alignment leapt away from the guess"
        return orthonormal(motion), ""

    def take_guess(self, guess: np.ndarray) -> None:
        self._kiss.last_pose = np.array(self._kiss.last_pose) @ guess

    def correct(self, motion: np.ndarray) -> None:
        self._kiss.last_pose = self._before @ motion
