"""Odometry `gicp`: generalised ICP (Segal, Haehnel and Thrun, RSS 2009) by small_gicp (Koide, JOSS 2024)."""

from __future__ import annotations

from typing import Any

import numpy as np
import small_gicp

from rhs.api.contracts import Context
from rhs.api.geometry import inverse, log_so3, orthonormal

from .clouds import Cloud, within_reach
from .gicp_config import Gicp
from .odometry import CloudOdometry


class GicpRegistration:
    """Aligns each cloud with a key cloud, which is replaced when the body has gone on."""

    def __init__(self, settings: Gicp) -> None:
        self._settings = settings
        self._key: tuple[Any, Any] | None = None  # (points, tree) of the key cloud
        self._key_from_body = self._before = np.eye(4)

    def align(self, cloud: Cloud, guess: np.ndarray) -> tuple[np.ndarray, str]:
        s, least = self._settings, self._settings.advanced.min_inlier_share
        points, tree = small_gicp.preprocess_points(cloud.points, s.voxel_m, s.advanced.neighbours, 1)
        if self._key is None:
            self._key = (points, tree)
            return np.eye(4), ""
        before = self._before = self._key_from_body
        start = before @ guess
        result = small_gicp.align(
            self._key[0], points, self._key[1], init_T_target_source=start, registration_type="GICP",
            max_correspondence_distance=s.reach_m, num_threads=1, max_iterations=s.iterations,
        )
        share = result.num_inliers / max(points.size(), 1)
        found = np.asarray(result.T_target_source, float)
        if not np.all(np.isfinite(found)) or share < least:
            self._renew((points, tree))
            return guess, f"{100 * share:.0f} % of the cloud found a partner, {100 * least:.0f} % needed"
        found = orthonormal(found)
        motion = inverse(before) @ found
        if not within_reach(motion, guess, s.advanced):
            self._renew((points, tree))
            return guess, "the alignment leapt away from the guess"
        self._key_from_body = found
        turn = np.linalg.norm(log_so3(found[:3, :3]))
        if np.linalg.norm(found[:3, 3]) > s.keep_move_m or turn > np.radians(s.keep_turn_deg):
            self._renew((points, tree))
        return motion, ""

    def take_guess(self, cloud: Cloud, guess: np.ndarray) -> None:
        self._key_from_body = self._key_from_body @ guess

    def correct(self, motion: np.ndarray) -> None:
        if not np.array_equal(self._key_from_body, np.eye(4)):  # else this cloud is the key cloud by now
            self._key_from_body = self._before @ motion

    def _renew(self, prepared) -> None:
        self._key, self._key_from_body = prepared, np.eye(4)


def build(settings: Gicp, context: Context) -> CloudOdometry:
    return CloudOdometry(settings, context, GicpRegistration(settings))
