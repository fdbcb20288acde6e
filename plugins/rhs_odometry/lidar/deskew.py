"""Clouds of a lidar that turns while it moves, as if they were taken at one instant; and whether somebody did so before.

A scanner's beams go round evenly on the scanner, whatever the robot does. In clouds that were deskewed they do not, but in
these as they were before, bent back by the robot's motion: of the two kinds one goes round at one rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from rhs.api.geometry import log_se3, wrap
from rhs.api.records import Scan

NEAR_M = 1.0  # nearer points are seen from where the scanner sits, not from the body
LEAST_POINTS, MOST_POINTS = 100, 2000
UNEVEN_RAD = 0.3  # the beams of one column are not of one bearing, Ouster's by 0.1
LEAST_CLOUDS, LEAST_RADPS, TIMES = 20, 0.02, 2.0  # spread of the rates, median; by which one kind's is larger


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


def beam_rate(points: np.ndarray, after_s: np.ndarray) -> float:
    """Radians a second by which the bearings (body's z) of points (N, 3) go round with their times (N,); NaN where that is
    no even turn."""
    far = np.flatnonzero(np.hypot(points[:, 0], points[:, 1]) > NEAR_M)
    if len(far) < LEAST_POINTS or np.ptp(after_s[far]) <= 0.0:
        return float("nan")
    order = far[np.argsort(after_s[far], kind="stable")]
    turn, times = np.arctan2(points[order, 1], points[order, 0]), after_s[order]
    sign = 1.0 if np.median(np.sin(np.diff(turn))) >= 0.0 else -1.0
    rate = sign * 2.0 * np.pi / np.ptp(times)  # nearly once round
    off = turn - rate * times
    off = wrap(off - np.angle(np.exp(1j * off).mean()))
    line = np.polyfit(times, off, 1)
    return float(rate + line[0]) if np.std(off - np.polyval(line, times)) < UNEVEN_RAD else float("nan")


def were_straight(rates: np.ndarray) -> bool:
    """Whether clouds were deskewed before, clearly so. rates (N, 2): beam_rate of each cloud, and of the cloud bent back."""
    rates = rates[np.isfinite(rates).all(axis=1)]
    if len(rates) < LEAST_CLOUDS:
        return False
    seen, bent = np.median(np.abs(rates - np.median(rates, axis=0)), axis=0)
    return bool(seen > LEAST_RADPS and seen > TIMES * bent)


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
