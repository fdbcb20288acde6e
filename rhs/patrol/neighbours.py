"""Which points have neighbours, or a robot beside them."""

from __future__ import annotations

import numpy as np

from rhs.api.robot_shape import Footprint


def near_any(points_m: np.ndarray, others_m: np.ndarray, within_m: float) -> np.ndarray:
    """(K,) bool: the point (K, 2) has one of the others (L, 2) so near."""
    from scipy.spatial import cKDTree

    if not len(points_m) or not len(others_m):
        return np.zeros(len(points_m), bool)
    close: np.ndarray = np.isfinite(cKDTree(others_m).query(points_m, distance_upper_bound=within_m)[0])
    return close


def has_neighbour(points_m: np.ndarray, within_m: float) -> np.ndarray:
    """(K,) bool: the point (K, 2) has another so near."""
    from scipy.spatial import cKDTree

    if not len(points_m):
        return np.zeros(0, bool)
    close: np.ndarray = cKDTree(points_m).query_ball_point(points_m, within_m, return_length=True) > 1
    return close


def too_near(footprint: Footprint, things_m: np.ndarray, stands: np.ndarray, margin_m: float | np.ndarray) -> np.ndarray:
    """(M, K) bool: on each of stands (M, 3), x, y, yaw in the body frame, the robot's side is nearer than margin_m (K,) to
    the thing (K, 2), and nearer than now."""
    from_m, (c, s) = things_m - stands[:, None, :2], (f(stands[:, None, 2]) for f in (np.cos, np.sin))
    turned = np.stack([from_m[..., 0] * c + from_m[..., 1] * s, from_m[..., 1] * c - from_m[..., 0] * s], axis=-1)
    gaps = footprint.gaps_m(turned)
    near: np.ndarray = (gaps < margin_m) & (gaps < footprint.gaps_m(things_m) - 0.01)
    return near
