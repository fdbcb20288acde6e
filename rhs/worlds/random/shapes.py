"""Plane geometry of what is drawn: distances to line segments, offsets of closed polygons."""

from __future__ import annotations

import math

import numpy as np


def units(angles_rad: np.ndarray) -> np.ndarray:
    """(N, 2) unit vectors along angles (N,). By the C library, as everywhere here: NumPy's own sine differs in its last
    bit from processor to processor, and the same seed would draw another building."""
    return np.array([(math.cos(angle), math.sin(angle)) for angle in angles_rad.tolist()])


def edges_of(polygon_m: np.ndarray) -> np.ndarray:
    """(N, 2, 2) segments of a closed polygon (N, 2)."""
    return np.stack([polygon_m, np.roll(polygon_m, -1, axis=0)], axis=1)


def gaps_m(points_m: np.ndarray, segments_m: np.ndarray) -> np.ndarray:
    """(N, S) distances of points (N, 2) from segments (S, 2, 2), in metres."""
    a, way = segments_m[:, 0], segments_m[:, 1] - segments_m[:, 0]
    square = np.maximum(way[:, 0] ** 2 + way[:, 1] ** 2, 1e-12)
    dx, dy = points_m[:, :1] - a[:, 0], points_m[:, 1:] - a[:, 1]
    along = np.clip((dx * way[:, 0] + dy * way[:, 1]) / square, 0.0, 1.0)
    gaps: np.ndarray = np.sqrt((dx - along * way[:, 0]) ** 2 + (dy - along * way[:, 1]) ** 2)
    return gaps


def nearest_gap_m(points_m: np.ndarray, segments_m: np.ndarray, *, at_once: int = 4096) -> np.ndarray:
    """(N,) distance of points from the nearest of the segments, in metres."""
    pieces = [gaps_m(points_m[i : i + at_once], segments_m).min(axis=1) for i in range(0, len(points_m), at_once)]
    return np.concatenate(pieces) if pieces else np.empty(0)


def polygon_gaps_m(polygon_m: np.ndarray, segments_m: np.ndarray) -> np.ndarray:
    """(S,) distances of segments from a convex polygon (N, 2), counter-clockwise; 0 where they meet it."""
    sides = edges_of(polygon_m)
    corners = gaps_m(polygon_m, segments_m).min(axis=0)
    ends = np.minimum(gaps_m(segments_m[:, 0], sides).min(axis=1), gaps_m(segments_m[:, 1], sides).min(axis=1))
    meets = inside(segments_m[:, 0], polygon_m) | inside(segments_m[:, 1], polygon_m) | _cross(sides, segments_m).any(axis=0)
    return np.where(meets, 0.0, np.minimum(corners, ends))


def inside(points_m: np.ndarray, polygon_m: np.ndarray) -> np.ndarray:
    """(N,) bool: points within a convex polygon, counter-clockwise."""
    sides = edges_of(polygon_m)
    return np.asarray((_side(sides[:, None], points_m[None]) >= 0.0).all(axis=0))


def within(points_m: np.ndarray, polygon_m: np.ndarray) -> np.ndarray:
    """(N,) bool: points within any simple polygon: a ray to the right crosses its border an odd number of times."""
    a, b = polygon_m, np.roll(polygon_m, -1, axis=0)
    x, y = points_m[:, :1], points_m[:, 1:]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    odd: np.ndarray = (spans & (x < a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise)).sum(axis=1) % 2 == 1
    return odd


def _side(segments: np.ndarray, points: np.ndarray) -> np.ndarray:
    a, b = segments[..., 0, :], segments[..., 1, :]
    way, off = b - a, points - a
    side: np.ndarray = way[..., 0] * off[..., 1] - way[..., 1] * off[..., 0]
    return side


def _cross(sides: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """(N, S) bool: the side and the segment cross."""
    one, other = sides[:, None], segments[None]
    apart = _side(one, other[:, :, 0]) * _side(one, other[:, :, 1])
    across = _side(other, one[:, :, 0]) * _side(other, one[:, :, 1])
    cross: np.ndarray = (apart < 0) & (across < 0)
    return cross


def turned(points_m: np.ndarray, angle_rad: float) -> np.ndarray:
    """(N, 2) points turned about the origin."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    x, y = points_m[..., 0], points_m[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def shifted_sides(polygon_m: np.ndarray, by_m: np.ndarray) -> np.ndarray:
    """(N, 2) corners of a counter-clockwise polygon with each side i moved inwards by by_m[i]."""
    way = np.roll(polygon_m, -1, axis=0) - polygon_m
    length = np.sqrt(way[:, 0] ** 2 + way[:, 1] ** 2)
    normal = np.stack([-way[:, 1], way[:, 0]], axis=1) / length[:, None]
    offset = normal[:, 0] * polygon_m[:, 0] + normal[:, 1] * polygon_m[:, 1] + by_m
    one, other, c, d = np.roll(normal, 1, axis=0), normal, np.roll(offset, 1), offset
    det = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    x = (c * other[:, 1] - d * one[:, 1]) / det
    y = (one[:, 0] * d - other[:, 0] * c) / det
    return np.stack([x, y], axis=1)


def is_convex(polygon_m: np.ndarray, *, least_side_m: float) -> bool:
    """Counter-clockwise, convex, and no side shorter than that."""
    way = np.roll(polygon_m, -1, axis=0) - polygon_m
    after = np.roll(way, -1, axis=0)
    bends = way[:, 0] * after[:, 1] - way[:, 1] * after[:, 0]
    return bool((bends > 1e-6).all() and (np.hypot(way[:, 0], way[:, 1]) >= least_side_m).all())
