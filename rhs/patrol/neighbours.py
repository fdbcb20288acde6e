"""Points and what is near them."""

from __future__ import annotations

import numpy as np

LAST_M = 0.02  # nearer than that the robot comes to nothing, however little
EXACT_M = 0.01  # what was seen is no more exact than that from view to view


def near_any(points_m: np.ndarray, others_m: np.ndarray, within_m: float) -> np.ndarray:
    """(K,) bool: the point (K, 2) has one of the others (L, 2) so near."""
    from scipy.spatial import cKDTree

    if not len(points_m) or not len(others_m):
        return np.zeros(len(points_m), bool)
    return np.isfinite(cKDTree(others_m).query(points_m, distance_upper_bound=within_m)[0])


def has_neighbour(points_m: np.ndarray, within_m: float) -> np.ndarray:
    """(K,) bool: the point (K, 2) has another so near."""
    from scipy.spatial import cKDTree

    if not len(points_m):
        return np.zeros(0, bool)
    return cKDTree(points_m).query_ball_point(points_m, within_m, return_length=True) > 1


def nears(gaps_m: np.ndarray, now_m: np.ndarray, margin_m: float | np.ndarray) -> np.ndarray:
    """Whether gaps are less than the margin and than the gaps now, if there are any, within LAST_M by anything: commands
    that each bring the robot nearer by less than what was seen is exact to would end at the thing."""
    slack_m = np.where((gaps_m < LAST_M) & (now_m > 0.0), 0.001, EXACT_M)
    return (gaps_m < margin_m) & (gaps_m < now_m - slack_m)


def width_m(points_m: np.ndarray) -> float:
    """Of points (K, 2) of the body frame, across the line of sight to their middle."""
    ahead = points_m.mean(axis=0)
    return float(np.ptp(points_m @ np.array([-ahead[1], ahead[0]])) / max(np.hypot(*ahead), 1e-9))
