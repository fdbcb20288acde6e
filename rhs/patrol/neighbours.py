"""Which points have neighbours."""

from __future__ import annotations

import numpy as np


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
