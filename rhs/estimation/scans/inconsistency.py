"""Does a map contradict itself? A figure that needs no truth. Loads numba.

A wall seen on one passage stands where another passage looked through: one of the two is wrong. The figure is the share of
wall points facing the laser, seen on another passage, that a scan's beams pass by clearly, of those they pass or meet. Only
what stood still counts, as the scans about it on its own passage say: people would be walls that others look through.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.records import Scan

from .planar_poses import composed
from .point_kernels import judged, looked_through
from .point_map import Cloud, cloud_of
from .settings import SEES_AROUND_RAD, PointSettings

NEAR_M, OTHER_WAY_M = 4.0, 8.0  # a scan of another passage: this near, and so much way apart
FAR_M, CLEAR_M = 10.0, 0.15
KEY_M, KEY_RAD, EVERY = 0.3, 0.35, 3
BESIDE, BESIDE_M = (-4, -2, 2, 4), 3.0  # key scans of the same passage that say what stood still, metres of way at most
ANYWHERE = np.array([25.0, CLEAR_M, -2.0])  # at any angle
LEAST_POINTS = 1000  # points that were passed or met; of fewer nothing is said


def inconsistency(clouds: Sequence[Cloud], poses: np.ndarray, way_m: np.ndarray, *, every: int = EVERY) -> float:
    """The figure of key scans at poses (K, 3), metres of way (K,) apart; NaN where no place was passed twice."""
    still = [_still(clouds, poses, way_m, k) for k in range(len(clouds))]
    through = met = 0
    for k in range(0, len(clouds), every):
        at = composed(poses[k], clouds[k].origin)
        near = np.hypot(*(poses[:, :2] - poses[k, :2]).T) < NEAR_M
        for j in np.nonzero(near & (np.abs(way_m - way_m[k]) > OTHER_WAY_M))[0][:: max(every - 1, 1)]:
            walls, facing = still[j]
            passed, ended = looked_through(clouds[k].ranges, clouds[k].bearings, at, walls, facing, poses[j], FAR_M, CLEAR_M)
            through, met = through + passed, met + ended
    return through / (through + met) if through + met >= LEAST_POINTS else float("nan")


def _still(clouds: Sequence[Cloud], poses: np.ndarray, way_m: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of a scan that another scan about it met and none looked through."""
    cloud = clouds[k]
    met, passed = np.zeros(len(cloud.points), bool), np.zeros(len(cloud.points), bool)
    for j in (k + beside for beside in BESIDE):
        if 0 <= j < len(clouds) and abs(way_m[j] - way_m[k]) <= BESIDE_M:
            at = composed(poses[j], clouds[j].origin)
            verdict = judged(clouds[j].ranges, clouds[j].bearings, at, cloud.points, cloud.normals, poses[k], ANYWHERE)
            met |= verdict > 0
            passed |= verdict < 0
    return cloud.points[met & ~passed], cloud.normals[met & ~passed]


def spaced(poses: np.ndarray, least_m: float, least_rad: float) -> list[int]:
    """Places of poses (N, 3), each at least so far, or turned, from the one chosen before."""
    out = [0] if len(poses) else []
    for k in range(1, len(poses)):
        dx, dy, turn = poses[k] - poses[out[-1]]
        if dx * dx + dy * dy > least_m**2 or abs((turn + np.pi) % (2.0 * np.pi) - np.pi) > least_rad:
            out.append(k)
    return out


def map_inconsistency(scans: Sequence[Scan | None], poses: np.ndarray) -> float:
    """The figure of measured scans at poses (N, 3); NaN for scanners that see little at once."""
    seen = [k for k, scan in enumerate(scans) if scan is not None and np.ptp(scan.bearings_rad) >= SEES_AROUND_RAD]
    keys = [seen[k] for k in spaced(poses[seen], KEY_M, KEY_RAD)] if seen else []
    clouds = [cloud_of(scan, PointSettings()) for k in keys if (scan := scans[k]) is not None]
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    return inconsistency(clouds, poses[keys], way_m[keys]) if keys else float("nan")
