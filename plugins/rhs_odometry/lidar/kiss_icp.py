"""Odometry `kiss_icp_lidar`: KISS-ICP (Vizzo et al., RA-L 2023) by its own library on a lidar's clouds.

The library says nothing of how sure it is. The covariance is a point-to-plane alignment's of the thinned cloud, H = sum
J'J / s^2 with J = [n, p x n], neighbouring points counted as one; where hardly a normal leans into a horizontal direction,
the cloud can slide along it and the motion is `degenerate` (Zhang, Kaess and Singh, ICRA 2016).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
from kiss_icp.voxelization import voxel_down_sample

from rhs.api.contracts import Odometry
from rhs.api.geometry import inverse, log_se3, orthonormal, se2
from rhs.api.records import Motion, Observation, Tracking

from .config import KissIcpLidar, LidarAdvanced


class KissIcpOdometry(Odometry):
    """Lays each cloud onto a voxel map; begins from the wheels, else from the last motion."""

    scale_from = "range"

    def __init__(self, settings: KissIcpLidar) -> None:
        self._settings = settings
        self._kiss: Any = None  # made of the first cloud, which tells how large the voxels are
        self._last = np.eye(4)
        self._voxel_m = settings.voxel_m

    def update(self, observation: Observation) -> Motion:
        """Motion of the body since the previous observation."""
        points = self._points(observation)
        wheel = observation.wheel
        guess = self._last if wheel is None or not np.isfinite(wheel).all() else se2(*wheel)
        wide = np.diag([0.5**2] * 3 + [0.2**2] * 3) + float(np.abs(log_se3(guess)).max()) ** 2 * np.eye(6)
        few = f"only {len(points)} points" if len(points) < self._settings.min_points else ""
        if self._kiss is None:
            if few:
                return Motion(np.eye(4), wide, Tracking.LOST, few)
            self._begin(points)
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view")
        before = np.array(self._kiss.last_pose, float)
        motion, trouble = (guess, few) if few else self._aligned(points, before, guess)
        self._last = motion
        if trouble:
            self._kiss.last_pose = before @ guess
            return Motion(guess, wide, Tracking.LOST, f"{trouble}; took {'same again' if wheel is None else 'wheel'}")
        return self._judged(points, motion)

    def revise(self) -> None:
        """Nothing to say afterwards."""
        return None

    def _points(self, observation: Observation) -> np.ndarray:
        points = np.asarray(observation.extras.get("cloud", np.empty((0, 3))), float)
        reach = np.linalg.norm(points, axis=1)
        return points[(reach >= self._settings.min_range_m) & (reach <= self._settings.max_range_m)]

    def _begin(self, points: np.ndarray) -> None:
        s = self._settings
        if s.voxel_m == 0.0:
            self._voxel_m = max(0.05, float(np.median(np.linalg.norm(points, axis=1))) / s.advanced.voxels_of_range)
        config = KISSConfig()
        config.data.deskew = False
        config.data.min_range, config.data.max_range = s.min_range_m, s.max_range_m
        config.mapping.voxel_size = self._voxel_m
        config.registration.max_num_threads = 1
        config.registration.max_num_iterations = s.iterations
        config.adaptive_threshold.initial_threshold = s.initial_threshold_m
        config.adaptive_threshold.min_motion_th = s.min_motion_m
        self._kiss = KissICP(config)
        self._kiss.register_frame(points, np.array([]))

    def _aligned(self, points: np.ndarray, before: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, str]:
        """previous_from_body, and what is wrong with it (empty: nothing)."""
        a = self._settings.advanced
        self._kiss.last_delta = guess
        self._kiss.register_frame(points, np.array([]))
        motion = inverse(before) @ np.asarray(self._kiss.last_pose, float)
        if not np.all(np.isfinite(motion)):
            return guess, "the alignment came to nothing"
        motion = orthonormal(motion)
        off = log_se3(inverse(guess) @ motion)
        if np.linalg.norm(off[:3]) > a.leap_m or np.linalg.norm(off[3:]) > a.leap_rad:
            return guess, "the alignment leapt away from the guess"
        return motion, ""

    def _judged(self, points: np.ndarray, motion: np.ndarray) -> Motion:
        s, a = self._settings, self._settings.advanced
        p, n = normals(voxel_down_sample(points, self._voxel_m), a)
        total = max(len(p), 1)
        p, n = p[flat := np.isfinite(n).all(axis=1)], n[flat]
        j = np.hstack([n, np.cross(p, n)]) / s.point_sigma_m
        information = j.T @ j / a.correlated + 1e-3 * np.eye(6)
        covariance = np.linalg.inv(information) + np.diag([a.least_m] * 3 + [a.least_rad] * 3) ** 2
        axes = np.zeros((3, 2))
        axes[:2] = np.linalg.eigh((n.T @ n)[:2, :2])[1]
        shares = (np.abs(n @ axes) > a.lean).sum(axis=0) / total
        weakest = int(np.argmin(shares))
        status, reason = Tracking.OK, ""
        if shares[weakest] < s.min_support:
            axis = np.concatenate([axes[:, weakest], np.zeros(3)])
            covariance = covariance + a.slipped_m**2 * np.outer(axis, axis)
            where = ", ".join(f"{v:+.2f}" for v in axis[:3])
            status = Tracking.DEGENERATE
            reason = f"{100 * shares[weakest]:.2f} % of the points hold the direction ({where}) of the body"
        covariance = 0.5 * (covariance + covariance.T)
        sure = np.sqrt(np.diag(np.linalg.inv(covariance)))
        details = {"points": float(len(points)), "support": float(shares[weakest])}
        return Motion(motion, covariance, status, reason, sure, details=details)


def normals(points: np.ndarray, s: LidarAdvanced) -> tuple[np.ndarray, np.ndarray]:
    """The points (N, 3) and their unit normals (N, 3), NaN where the nearest ones lie on no plane: along one ring of the
    scanner they lie on a line, and on a bush on nothing."""
    from scipy.spatial import cKDTree

    out = np.full(points.shape, np.nan)
    if len(points) < s.neighbours:
        return points, out
    near = points[cKDTree(points).query(points, s.neighbours)[1]]
    off = near - near.mean(axis=1, keepdims=True)
    values, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off) / s.neighbours)
    flat = (values[:, 0] < s.thin * values[:, 1]) & (values[:, 1] > s.broad * values[:, 2])
    out[flat] = axes[flat, :, 0]
    return points, out
