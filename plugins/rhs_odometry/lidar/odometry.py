"""What the odometries on a lidar's clouds have in common: what is asked of a cloud, and how sure its motion is.

Libraries of registration say nothing of how sure they are. The covariance is a point-to-plane alignment's of the thinned
cloud, H = sum J'J / s^2 with J = [n, p x n], neighbouring points counted as one; where hardly a normal leans into a
horizontal direction, the cloud can slide along it and the motion is `degenerate` (Zhang, Kaess and Singh, ICRA 2016).
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from scipy.spatial import cKDTree

from rhs.api.contracts import Odometry
from rhs.api.geometry import inverse, log_se3, orthonormal, se2
from rhs.api.records import Motion, Observation, Tracking

from .config import LidarAdvanced
from .config import LidarOdometry as Settings


class LidarOdometry(Odometry):
    """Lays each cloud onto a map of those before. `align` is the method's own."""

    scale_from = "range"

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.voxel_m = settings.voxel_m
        self.last = np.eye(4)  # previous_from_body of the last cloud
        self._pose: np.ndarray | None = None  # map_from_body; the first cloud's is the identity

    @abstractmethod
    def begin(self, points: np.ndarray) -> None:
        """Make the map of the first cloud (N, 3), whose voxels are `voxel_m` wide."""

    @abstractmethod
    def align(self, points: np.ndarray, before: np.ndarray, wheel: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """map_from_body of this cloud, which is put into the map there, and previous_from_body that it began with. before:
        map_from_body of the last cloud; wheel: previous_from_body by the wheels, where there are any. All 4x4."""

    @abstractmethod
    def correct(self, pose: np.ndarray) -> None:
        """The last cloud was at this map_from_body, whatever `align` found."""

    def update(self, observation: Observation) -> Motion:
        """Motion of the body since the previous observation."""
        points = self._points(observation)
        wheel = observation.wheel
        told = None if wheel is None or not np.isfinite(wheel).all() else se2(*wheel)
        few = f"only {len(points)} points" if len(points) < self.settings.min_points else ""
        if few:
            return self._lost(self.last if told is None else told, few, told is not None)
        if self._pose is None:
            self.voxel_m = self.voxel_m or _voxel(points, self.settings.advanced)
            self.begin(points)
            self._pose = np.eye(4)
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view")
        found, guess = self.align(points, self._pose, told)
        motion = inverse(self._pose) @ found
        if trouble := self._trouble(motion, guess):
            return self._lost(guess, trouble, told is not None)
        self.last = orthonormal(motion)
        self._pose = self._pose @ self.last
        return self._judged(points, self.last)

    def revise(self) -> None:
        """Nothing to say afterwards."""
        return None

    def _points(self, observation: Observation) -> np.ndarray:
        points = np.asarray(observation.extras.get("cloud", np.empty((0, 3))), float)
        reach = np.linalg.norm(points, axis=1)
        return points[(reach >= self.settings.min_range_m) & (reach <= self.settings.max_range_m)]

    def _trouble(self, motion: np.ndarray, guess: np.ndarray) -> str:
        """What is wrong with an alignment; empty: nothing."""
        if not np.all(np.isfinite(motion)):
            return "the alignment came to nothing"
        off = log_se3(inverse(guess) @ orthonormal(motion))
        a = self.settings.advanced
        leapt = np.linalg.norm(off[:3]) > a.leap_m or np.linalg.norm(off[3:]) > a.leap_rad
        return "the alignment leapt away from the guess" if leapt else ""

    def _lost(self, guess: np.ndarray, trouble: str, by_wheel: bool) -> Motion:
        wide = np.diag([0.5**2] * 3 + [0.2**2] * 3) + float(np.abs(log_se3(guess)).max()) ** 2 * np.eye(6)
        if self._pose is None:
            return Motion(np.eye(4), wide, Tracking.LOST, trouble)
        self.last, self._pose = guess, self._pose @ guess
        self.correct(self._pose)
        return Motion(guess, wide, Tracking.LOST, f"{trouble}; took {'wheel' if by_wheel else 'same again'}")

    def _judged(self, points: np.ndarray, motion: np.ndarray) -> Motion:
        s, a = self.settings, self.settings.advanced
        p = _thinned(points, self.voxel_m)
        n = normals(p, a)
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


def _voxel(points: np.ndarray, a: LidarAdvanced) -> float:
    """Side of a voxel by how far the points are, metres."""
    return max(0.05, float(np.median(np.linalg.norm(points, axis=1))) / a.voxels_of_range)


def _thinned(points: np.ndarray, voxel_m: float) -> np.ndarray:
    """The first point of each voxel."""
    _, first = np.unique(np.floor(points / voxel_m).astype(np.int64), axis=0, return_index=True)
    return points[np.sort(first)]


def normals(points: np.ndarray, a: LidarAdvanced) -> np.ndarray:
    """Unit normals (N, 3) of points (N, 3), NaN where the nearest ones lie on no plane: along one ring of the scanner they
    lie on a line, and on a bush on nothing."""
    out = np.full(points.shape, np.nan)
    if len(points) < a.neighbours:
        return out
    near = points[cKDTree(points).query(points, a.neighbours)[1]]
    off = near - near.mean(axis=1, keepdims=True)
    values, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off) / a.neighbours)
    flat = (values[:, 0] < a.thin * values[:, 1]) & (values[:, 1] > a.broad * values[:, 2])
    out[flat] = axes[flat, :, 0]
    return out
