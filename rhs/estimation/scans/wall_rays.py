"""Walls an odometry believes in, used in place of depth: scans cast on them, key-points lifted onto them.

Thesis section 4.4: the ray of a pixel is followed to the plane of the corridor it pierces (eq. 4.7). Here the walls are
segments and the nearest one counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rhs.api.geometry import Camera, inverse, planar, transform
from rhs.api.records import Features, Scan, Wall

LEAP_SHARE = 0.1  # neighbouring beams whose ranges differ by more see two things


def cast_on_walls(walls: Sequence[Wall], map_from_body: np.ndarray, bearings_rad: np.ndarray, max_range_m: float) -> Scan:
    """The scan that walls of the map would give from a pose. Beams that meet no wall are NaN (unknown), not free:
    where no wall is known there may still be one. Walls beyond max_range_m give +inf: free so far."""
    x, y, yaw = planar(map_from_body)
    angles = bearings_rad + yaw
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ranges = meet_walls(walls, np.array([x, y]), directions)
    ranges = np.where(np.isfinite(ranges), np.where(ranges > max_range_m, np.inf, ranges), np.nan)
    return Scan(np.asarray(bearings_rad, float), ranges, float(max_range_m))


def meet_walls(walls: Sequence[Wall], origin_m: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N,) multiples of the (N, 2) directions at which rays from `origin_m` (2,) meet the nearest wall; inf: none."""
    best = np.full(len(directions), np.inf)
    for wall in walls:
        along, from_origin = wall.end_xy_m - wall.start_xy_m, wall.start_xy_m - origin_m
        det = directions[:, 1] * along[0] - directions[:, 0] * along[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (from_origin[1] * along[0] - from_origin[0] * along[1]) / det
            u = (directions[:, 0] * -from_origin[1] + directions[:, 1] * from_origin[0]) / -det
        hit = (np.abs(det) > 1e-9) & (t > 1e-6) & (u >= 0.0) & (u <= 1.0)
        best = np.where(hit & (t < best), t, best)
    return best


def lift_on_walls(
    features: Features, camera: Camera, map_from_body: np.ndarray, walls: Sequence[Wall], *, max_range_m: float = 12.0
) -> Features:
    """The same features with `points` (camera frame) where their rays first meet a wall, the floor or the ceiling.

    Rays that meet nothing within max_range_m stay NaN. Floor and ceiling are those of the walls: the lowest floor and,
    if finite, the lowest ceiling. This gives monocular views the points that a place memory and a loop closer need.
    """
    if not walls or not len(features.pixels):
        return features
    rays = camera.rays(features.pixels.astype(float))
    map_from_camera = map_from_body @ camera.body_from_camera
    directions, eye = rays @ map_from_camera[:3, :3].T, map_from_camera[:3, 3]
    reach = meet_walls(walls, eye[:2], directions[:, :2])
    for level in (min(w.floor_m for w in walls), min(w.ceiling_m for w in walls)):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (level - eye[2]) / directions[:, 2]
        reach = np.where(np.isfinite(t) & (t > 1e-6) & (t < reach), t, reach)
    points = eye + directions * reach[:, None]
    far = ~(reach * np.linalg.norm(directions, axis=1) < max_range_m)
    local = np.where(far[:, None], np.nan, transform(inverse(map_from_camera), np.where(far[:, None], 0.0, points)))
    return replace(features, points=local.astype(np.float32))


def lift_on_scan(features: Features, camera: Camera, scan: Scan) -> Features:
    """The same features with `points` (camera frame) where their rays meet what the scan of their view found standing
    upright, or the floor before it. NaN where the scan does not know, and where it leaps between two beams."""
    eye = camera.body_from_camera[:3, 3]
    rays = camera.rays(features.pixels.astype(float)) @ camera.body_from_camera[:3, :3].T
    bearing, flat = np.arctan2(rays[:, 1], rays[:, 0]), np.hypot(rays[:, 0], rays[:, 1])
    after = np.clip(np.searchsorted(scan.bearings_rad, bearing), 1, len(scan.bearings_rad) - 1)
    left, right = scan.ranges_m[after - 1], scan.ranges_m[after]
    with np.errstate(invalid="ignore", divide="ignore"):
        even = np.abs(left - right) < LEAP_SHARE * np.minimum(left, right)
        upright = np.where(even, 0.5 * (left + right), np.nan) / flat
        floor = np.where(rays[:, 2] < 0.0, -eye[2] / rays[:, 2], np.inf)
        floor = np.where(floor * flat < np.fmin(np.minimum(left, right), scan.max_range_m), floor, np.nan)
        reach = np.where(np.isfinite(floor), floor, upright)
    points = rays * reach[:, None] @ camera.body_from_camera[:3, :3]
    return replace(features, points=points.astype(np.float32))
