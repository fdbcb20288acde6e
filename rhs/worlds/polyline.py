"""Polylines (N, 2) in metres: a closed one driven past its start, and how far points lie beside a straight line."""

from __future__ import annotations

import numpy as np

PAST_M = 1.0  # the tour goes on so far past its start, that the last views are like the first


def past_start(route_m: np.ndarray) -> np.ndarray:
    """The closed route, and once more along its beginning for PAST_M."""
    left, points = PAST_M, list(route_m)
    for a, b in zip(route_m[:-1], route_m[1:], strict=True):
        length = float(np.hypot(*(b - a)))
        if length >= left:
            points.append((a + (b - a) * (left / length)).round(4))
            break
        points.append(b)
        left -= length
    out: np.ndarray = np.array(points)
    return out


def aside_m(points: np.ndarray) -> np.ndarray:
    """(N,) distance of points from the straight line between the first and the last."""
    a, b = points[0], points[-1]
    along = np.clip(((points - a) * (b - a)).sum(axis=1) / max(float(((b - a) ** 2).sum()), 1e-12), 0.0, 1.0)
    aside: np.ndarray = np.hypot(*(points - a - along[:, None] * (b - a)).T)
    return aside
