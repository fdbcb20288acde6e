"""A scan laid onto a map of points, point to line. Loads numba: import it when it is needed.

Source: point-to-line ICP (Censi 2008) with a robust kernel and a prior, Gauss-Newton on the floor. Deviations: the partner
of a point is the nearest one on the same side of a wall, the reach shrinks from step to step, and because neighbouring beams
share their errors each counts for `trust` only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.records import Scan

from .planar_poses import between, composed
from .point_kernels import bucketed, fitted, looked_through, merged, passed_by, surface_points
from .settings import PointSettings

MOVING_WITHIN_M = 10.0  # what is further from a scanner is not asked of its beams, metres
MOST_MOVING = 0.5  # where more of a scan seems to move the pose is wrong


@dataclass(frozen=True, eq=False)
class Cloud:
    """What one scan saw, in the body frame: points and normals (N, 2), and the beams themselves (B,) from `origin`, (3,)
    pose of the scanner in the body, for what they passed through."""

    points: np.ndarray
    normals: np.ndarray
    ranges: np.ndarray
    bearings: np.ndarray
    origin: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """pose (3,), information (3, 3) of the scan alone (right perturbation), share of the points with a partner."""

    pose: np.ndarray
    information: np.ndarray
    share: float


def cloud_of(scan: Scan, settings: PointSettings) -> Cloud:
    """The points of a scan with their normals."""
    ranges, bearings = np.array(scan.ranges_m, float), np.array(scan.bearings_rad, float)
    points, normals = surface_points(ranges, bearings, settings.range_max_m, settings.span_m, settings.span_steps,
                                     settings.flat)
    apart = abs(float(bearings[-1] - bearings[0])) / max(len(bearings) - 1, 1)
    every = max(int(np.radians(settings.beam_deg) / max(apart, 1e-6) + 0.1), 1)
    points, normals = np.ascontiguousarray(points[::every]), np.ascontiguousarray(normals[::every])
    origin = np.array([*scan.origin_xy_m, 0.0], float)
    seen_to = np.where(np.isinf(ranges), float(scan.max_range_m), ranges)  # further on nobody knows what stands
    return Cloud(points + origin[:2], normals, seen_to, bearings, origin)


def without_passed(cloud: Cloud, pose: np.ndarray, others: Sequence[tuple[Cloud, np.ndarray]], slack: np.ndarray) -> Cloud:
    """The cloud, at a pose (3,), without the points that the beams of other clouds, with their poses, pass by: people, and
    whatever else moves. slack (3,): metres that a beam must pass by, metres and radians that the poses may be wrong by."""
    passed, limits = np.zeros(len(cloud.points), bool), np.array([MOVING_WITHIN_M, *slack], float)
    for other, there in others:
        at = composed(np.asarray(there, float), other.origin)
        passed |= passed_by(other.ranges, other.bearings, at, cloud.points, np.asarray(pose, float), limits)
    if not passed.any() or passed.mean() > MOST_MOVING:
        return cloud
    return replace(cloud, points=cloud.points[~passed], normals=cloud.normals[~passed])


def gathered(clouds: Sequence[Cloud], poses: np.ndarray, *, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (N, 2) of clouds at poses (K, 3) in one frame, one for each cell and side of a wall."""
    if not len(clouds):
        return np.empty((0, 2)), np.empty((0, 2))
    points, normals = (np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in ("points", "normals"))
    counts = np.array([len(cloud.points) for cloud in clouds])
    return merged(points, normals, counts, np.ascontiguousarray(poses, float), cell_m)


class PointMap:
    """Points (N, 2) with normals, ready to be laid upon."""

    def __init__(self, points: np.ndarray, normals: np.ndarray) -> None:
        self.points, self.normals = points, normals
        self._buckets = bucketed(points, normals) if len(points) else None

    def fit(self, cloud: Cloud, start: np.ndarray, prior: np.ndarray, settings: PointSettings, *, steps: int = 12,
            reach: tuple[float, float] | None = None) -> Fit:
        """The cloud laid onto the map from a pose (3,) that `prior` (3, 3) information pulls towards. steps=0: only look."""
        if self._buckets is None or not len(cloud.points):
            return Fit(np.array(start, float), np.zeros((3, 3)), 0.0)
        first, last = reach or (settings.reach_m, settings.reach_least_m)
        numbers = np.array([first, last, settings.sigma_m, settings.trust, steps], float)
        pose, information, share = fitted(cloud.points, cloud.normals, self._buckets, np.array(start, float),
                                          np.ascontiguousarray(prior, float), numbers)
        return Fit(pose, information, share)

    def unslid(self, cloud: Cloud, fit: Fit, start: np.ndarray, settings: PointSettings) -> Fit:
        """The fit without what it moved from `start` (3,) in directions that the scan hardly sees (compare Zhang, Kaess and
        Singh, On degeneracy of optimization-based state estimation problems, ICRA 2016)."""
        scale = np.array([1.0, 1.0, settings.lever_m])
        values, vectors = np.linalg.eigh(fit.information / np.outer(scale, scale))
        blind = vectors[:, values <= settings.blind_below * max(values.max(), 1e-9)]
        if not blind.shape[1]:
            return fit
        moved = between(np.asarray(start, float), fit.pose) * scale
        return self.fit(cloud, composed(np.asarray(start, float), (moved - blind @ (blind.T @ moved)) / scale), np.eye(3),
                        settings, steps=0)

    def seen_through(self, cloud: Cloud, pose: np.ndarray, *, far_m: float, clear_m: float) -> tuple[int, int]:
        """How many points of the map that face the scanner its beams pass through from a pose (3,),
        and how many they meet."""
        if not len(self.points):
            return 0, 0
        at = composed(np.asarray(pose, float), cloud.origin)
        return looked_through(cloud.ranges, cloud.bearings, at, self.points, self.normals, np.zeros(3), far_m, clear_m)


def seen_directions(information: np.ndarray, settings: PointSettings) -> np.ndarray:
    """The information (3, 3), or many (N, 3, 3), without the directions that the scan hardly sees: along a corridor, say."""
    scale = np.array([1.0, 1.0, 1.0 / settings.lever_m])
    scale = scale[:, None] * scale
    values, vectors = np.linalg.eigh(information * scale)
    least = settings.blind_below * np.maximum(values[..., -1:], 1e-9)
    out: np.ndarray = (vectors * np.where(values > least, values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2) / scale
    return out
