"""Clouds of a lidar that turns while it moves, as if they were taken at one instant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from rhs.api.geometry import log_se3
from rhs.api.records import Scan


def deskewed(points: np.ndarray, after_s: np.ndarray, motion: np.ndarray, taken_s: float) -> np.ndarray:
    """(N, 3) points in the body's frame at the cloud's stamp.

    points (N, 3): in the body's frame when each was seen, `after_s` (N,) seconds later. The body goes on as in `motion` (4x4
    previous_from_body), which took `taken_s`: constant velocity and turning, as KISS-ICP assumes (Vizzo et al., RA-L 2023,
    III-A), so that a point is moved by exp(t xi) of SE(3)."""
    twist = log_se3(motion) / taken_s
    turn = after_s[:, None] * twist[3:]
    angle = np.maximum(np.linalg.norm(turn, axis=1), 1e-9)[:, None]
    way = after_s[:, None] * twist[:3]
    across = np.cross(turn, way)
    way = way + (1.0 - np.cos(angle)) / angle**2 * across + (angle - np.sin(angle)) / angle**3 * np.cross(turn, across)
    return Rotation.from_rotvec(turn).apply(points) + way


def deskewed_scan(scan: Scan, points: np.ndarray, after_s: np.ndarray, motion: np.ndarray, taken_s: float) -> Scan:
    """The scan of such a cloud as of its stamp. A beam was taken when the points on its bearing were, in the mean."""
    bearings, ranges = scan.bearings_rad, scan.ranges_m
    beam = np.searchsorted(0.5 * (bearings[1:] + bearings[:-1]), np.arctan2(points[:, 1], points[:, 0]))
    count = np.bincount(beam, minlength=len(bearings))
    known = np.isfinite(ranges) & (count > 0)
    taken = np.bincount(beam, weights=after_s, minlength=len(bearings))[known] / count[known]
    ends = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(ranges))])[known]
    x, y, _ = deskewed(ends, taken, motion, taken_s).T
    bearings, ranges = bearings.copy(), ranges.copy()
    bearings[known], ranges[known] = np.arctan2(y, x), np.hypot(x, y)
    order = np.argsort(bearings)
    return replace(scan, bearings_rad=bearings[order], ranges_m=ranges[order])
