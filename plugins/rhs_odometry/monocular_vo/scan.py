"""A scan of the points that one camera has placed: sparse, and nothing between them."""

from __future__ import annotations

import numpy as np

from rhs.api.frozen import freeze
from rhs.api.geometry import Camera
from rhs.api.records import Scan

BEAMS = 81  # across the field of view, as the other odometries of one camera have them
LEVEL_RAD = 0.1  # a point belongs to the scan when it is seen this near to the camera's height
REACH = 3.0  # times the median distance: further points are hardly placed


def scan_of(points: np.ndarray, camera: Camera, unit_m: float) -> Scan:
    """Of points (N, 3) in the camera frame, in units of so many metres: in each bearing the nearest one at the camera's
    height; NaN where there is none."""
    turned = points @ camera.body_from_camera[:3, :3].T
    flat = np.hypot(turned[:, 0], turned[:, 1])
    level = (np.abs(np.arctan2(turned[:, 2], flat)) < LEVEL_RAD) & (flat > 1e-6)
    ends = camera.rays(np.array([[0.0, camera.cy], [camera.width - 1.0, camera.cy]])) @ camera.body_from_camera[:3, :3].T
    left, right = np.arctan2(ends[:, 1], ends[:, 0])
    bearings = np.linspace(right, left, BEAMS)
    beam = np.rint((np.arctan2(turned[:, 1], turned[:, 0]) - right) / (left - right) * (BEAMS - 1)).astype(int)
    use = level & (beam >= 0) & (beam < BEAMS)
    ranges = np.full(BEAMS, np.inf)
    np.minimum.at(ranges, beam[use], flat[use] * unit_m)
    reach_m = REACH * unit_m * float(np.median(points[:, 2])) if len(points) else unit_m
    ranges[~(ranges < reach_m)] = np.nan
    origin = camera.body_from_camera[:2, 3]
    return Scan(freeze(bearings), freeze(ranges), max(reach_m, 1e-3), (float(origin[0]), float(origin[1])))
