"""What the odometries on a lidar's clouds have in common: what is asked of a cloud, and how sure its motion is.

Libraries of registration say nothing of how sure they are. The covariance is a point-to-plane alignment's of the thinned
cloud, H = sum J'J / s^2 with J = [n, p x n], neighbouring points counted as one; where hardly a normal leans into a
horizontal direction, the cloud can slide along it and the motion is `degenerate` (Zhang, Kaess and Singh, ICRA 2016).
"""

from __future__ import annotations

import logging
from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from rhs.api.contracts import Odometry
from rhs.api.geometry import inverse, log_se3, orthonormal, se2
from rhs.api.records import Motion, Observation, Revision, Scan, Tracking

from ..clouds.clouds import Observability, judged, within_reach
from .config import LidarAdvanced
from .config import LidarOdometry as Settings
from .deskew import LEAST_CLOUDS, MOST_POINTS, beam_rate, deskewed, deskewed_scan, were_straight

log = logging.getLogger("rhs.odometry")
MOST_RATES = 1000  # clouds that are asked whether they were deskewed before


class Cloud(NamedTuple):
    """points (N, 3) in the body's frame; after_s (N,): when each was seen, seconds after the view's stamp, or None."""

    points: np.ndarray
    after_s: np.ndarray | None


class LidarOdometry(Odometry):
    """Lays each cloud onto a map of those before. `align` is the method's own."""

    scale_from = "range"

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.voxel_m = settings.voxel_m
        self.last = np.eye(4)  # previous_from_body of the last cloud
        self._pose: np.ndarray | None = None  # map_from_body; the first cloud's is the identity
        self._stamp_s: float | None = None  # of the last cloud
        self._taken_s = 0.0  # from the one before to it
        self._timed: list[tuple[np.ndarray, Scan | None]] | None = None  # pose and scan of each view, if points have times
        self._first: Cloud | None = None  # such a cloud, until the motion is known that bent it
        self._rates: list[tuple[float, float]] = []  # of the beams of such clouds, and of these bent back
        self._straight = False  # they were deskewed by somebody before

    @abstractmethod
    def begin(self, points: np.ndarray) -> None:
        """Make the map of the first cloud (N, 3), whose voxels are `voxel_m` wide."""

    def guess(self, points: np.ndarray) -> np.ndarray:
        """previous_from_body (4x4) of this cloud (N, 3) without wheels."""
        return self.last

    @abstractmethod
    def align(self, points: np.ndarray, before: np.ndarray, guess: np.ndarray) -> np.ndarray:
        """map_from_body of this cloud. before: map_from_body of the last; guess: previous_from_body. All 4x4."""

    @abstractmethod
    def settle(self, pose: np.ndarray, *, aligned: bool) -> None:
        """The cloud that was aligned last is at this map_from_body; or, not aligned, no cloud is believed to be there."""

    def update(self, observation: Observation) -> Motion:
        """Motion of the body since the previous observation."""
        cloud = self._cloud(observation)
        first, self._taken_s = self._stamp_s is None, observation.stamp_s - (self._stamp_s or 0.0)
        self._stamp_s = observation.stamp_s
        wheel = observation.wheel
        motion = self._moved(cloud, None if wheel is None or not np.isfinite(wheel).all() else se2(*wheel))
        if first and cloud.after_s is not None:
            self._timed, self._first = [(np.eye(4), observation.scan)], cloud
        elif self._timed is not None:
            self._note(observation.scan, cloud, motion.previous_from_body)
            self._ask(cloud, motion)
        return motion

    def revise(self) -> Revision | None:
        """The scans as of the stamps of their clouds, where points have times; nothing else changes."""
        if self._timed is None:
            return None
        return Revision(np.array([pose for pose, _ in self._timed]), tuple(scan for _, scan in self._timed))

    def _cloud(self, observation: Observation) -> Cloud:
        points = np.asarray(observation.extras.get("cloud", np.empty((0, 3))), float)
        reach = np.linalg.norm(points, axis=1)
        used = (reach >= self.settings.min_range_m) & (reach <= self.settings.max_range_m)
        after = observation.extras.get("cloud_time_s") if self.settings.deskew else None
        return Cloud(points[used], None if after is None else np.asarray(after, float)[used])

    def _moved(self, cloud: Cloud, told: np.ndarray | None) -> Motion:
        """told: previous_from_body by the wheels, where there are any."""
        if len(cloud.points) < self.settings.min_points:
            return self._lost(self.last if told is None else told, f"only {len(cloud.points)} points", told is not None)
        if self._pose is None:
            self.voxel_m = self.voxel_m or _voxel(cloud.points, self.settings.advanced)
            self.begin(cloud.points)
            self._pose = np.eye(4)
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view")
        guess = self.guess(self._deskewed(cloud, self.last)) if told is None else told
        if self._first is not None:
            self.begin(self._deskewed(self._first, guess))  # both clouds were bent alike: only now is it known how
        points = self._deskewed(cloud, guess)
        motion = inverse(self._pose) @ self.align(points, self._pose, guess)
        if trouble := self._trouble(motion, guess):
            return self._lost(guess, trouble, told is not None)
        self.last = orthonormal(motion)
        self._pose = self._pose @ self.last
        self.settle(self._pose, aligned=True)
        return self._judged(points, self.last)

    def _ask(self, cloud: Cloud, motion: Motion) -> None:
        """Were these clouds deskewed by somebody before? From where that is clear they are taken as they are."""
        if cloud.after_s is None or self._straight or len(self._rates) == MOST_RATES or motion.status is Tracking.LOST:
            return
        some = slice(None, None, max(len(cloud.points) // MOST_POINTS, 1))
        points, after_s = cloud.points[some], cloud.after_s[some]
        bent = deskewed(points, after_s, inverse(motion.previous_from_body), self._taken_s)
        self._rates.append((beam_rate(points, after_s), beam_rate(bent, after_s)))
        if len(self._rates) % LEAST_CLOUDS == 0 and were_straight(np.array(self._rates)):
            self._straight, self._pose = True, np.eye(4)
            self.begin(cloud.points)  # the map so far is of clouds that were bent
            log.warning("the clouds were deskewed before: their beams go round unevenly as the robot moves; from number %d "
                        "on they are taken as they are (odometry.deskew=false does so from the first)", len(self._rates) + 2)

    def _deskewed(self, cloud: Cloud, motion: np.ndarray) -> np.ndarray:
        """Its points as of its stamp, if the body moves as in `motion` (4x4, since the last cloud)."""
        if cloud.after_s is None or self._taken_s <= 0.0 or self._straight:
            return cloud.points
        return deskewed(cloud.points, cloud.after_s, motion, self._taken_s)

    def _note(self, scan: Scan | None, cloud: Cloud, motion: np.ndarray) -> None:
        """Pose and scan, for the end. Until the second cloud the body is taken to move as it does until that."""
        assert self._timed is not None
        if self._first is not None:
            self._timed = [(np.eye(4), self._scan(self._timed[0][1], self._first, motion))]
            self._first = None
        self._timed.append((self._timed[-1][0] @ motion, self._scan(scan, cloud, motion)))

    def _scan(self, scan: Scan | None, cloud: Cloud, motion: np.ndarray) -> Scan | None:
        if scan is None or cloud.after_s is None or not len(cloud.points) or self._taken_s <= 0.0 or self._straight:
            return scan
        return deskewed_scan(scan, cloud.points, cloud.after_s, motion, self._taken_s)

    def _trouble(self, motion: np.ndarray, guess: np.ndarray) -> str:
        """What is wrong with an alignment; empty: nothing."""
        if not np.all(np.isfinite(motion)):
            return "the alignment came to nothing"
        near = within_reach(orthonormal(motion), guess, self.settings.advanced)
        return "" if near else "the alignment leapt away from the guess"

    def _lost(self, guess: np.ndarray, trouble: str, by_wheel: bool) -> Motion:
        wide = np.diag([0.5**2] * 3 + [0.2**2] * 3) + float(np.abs(log_se3(guess)).max()) ** 2 * np.eye(6)
        if self._pose is None:
            return Motion(np.eye(4), wide, Tracking.LOST, trouble)
        self.last, self._pose = guess, self._pose @ guess
        self.settle(self._pose, aligned=False)
        return Motion(guess, wide, Tracking.LOST, f"{trouble}; took {'wheel' if by_wheel else 'same again'}")

    def _judged(self, points: np.ndarray, motion: np.ndarray) -> Motion:
        s, a = self.settings, self.settings.advanced
        p = _thinned(points, self.voxel_m)
        n = normals(p, a)
        total = max(len(p), 1)
        p, n = p[flat := np.isfinite(n).all(axis=1)], n[flat]
        j = np.hstack([n, np.cross(p, n)]) / s.point_sigma_m
        axes = np.zeros((3, 2))
        axes[:2] = np.linalg.eigh((n.T @ n)[:2, :2])[1]
        shares = (np.abs(n @ axes) > a.lean).sum(axis=0) / total
        weakest = int(np.argmin(shares))
        seen = Observability(j.T @ j, axes[:, weakest], float(shares[weakest]))
        return judged(motion, seen, s, {"points": float(len(points))})


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
