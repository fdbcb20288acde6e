"""Odometry `gicp`: generalised ICP (Segal, Haehnel and Thrun, RSS 2009) by small_gicp (Koide, JOSS 2024)."""

from __future__ import annotations

from typing import Any

import numpy as np
import small_gicp

from rhs.api.geometry import inverse, log_so3, orthonormal

from .clouds import Cloud, within_reach
from .config import Gicp


class GicpRegistration:
    """Aligns each cloud with a key cloud, which is replaced when the body has gone on."""

    def __init__(self, settings: Gicp) -> None:
        self._settings = settings
        self._key: tuple[Any, Any] | None = None  # (points, tree) of the key cloud, and the cloud itself
        self._key_points = np.empty((0, 3))
        self._key_from_body = self._before = np.eye(4)

    def align(self, cloud: Cloud, guess: np.ndarray) -> tuple[np.ndarray, str]:
        s, least = self._settings, self._settings.advanced.min_inlier_share
        points, tree = prepared = self._prepared(cloud.points)
        if self._key is None:
            self._key, self._key_points = prepared, cloud.points
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
            self._renew(cloud, prepared)
            return guess, f"{100 * share:.0f} % of the cloud found a partner, {100 * least:.0f} % needed"
        found = orthonormal(found)
        motion = inverse(before) @ found
        if not within_reach(motion, guess, s.advanced):
            self._renew(cloud, prepared)
            return guess, "the alignment leapt away from the guess"
        self._key_from_body = found
        turn = np.linalg.norm(log_so3(found[:3, :3]))
        if np.linalg.norm(found[:3, 3]) > s.keep_move_m or turn > np.radians(s.keep_turn_deg):
            self._renew(cloud, prepared)
        return motion, ""

    def take_guess(self, guess: np.ndarray) -> None:
        self._key_from_body = self._key_from_body @ guess

    def correct(self, motion: np.ndarray) -> None:
        if not np.array_equal(self._key_from_body, np.eye(4)):  # else this cloud is the key cloud by now
            self._key_from_body = self._before @ motion

    def _prepared(self, points: np.ndarray) -> tuple[Any, Any]:
        a = self._settings
        return small_gicp.preprocess_points(points, a.voxel_m, a.advanced.neighbours, 1)  # type: ignore[no-any-return]

    def _renew(self, cloud: Cloud, prepared: tuple[Any, Any]) -> None:
        self._key, self._key_points, self._key_from_body = prepared, cloud.points, np.eye(4)

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: the library's own are prepared anew."""
        return vars(self) | {"_key": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._key = self._prepared(self._key_points) if len(self._key_points) else None
