"""Correlative search: points laid onto a map anywhere in a window of shifts and turns. Loads numba.

Source: Olson, Real-time correlative scan matching (ICRA 2009): a field says how close each cell is to a wall, a coarser
one bounds whole blocks of shifts, and only blocks that can hold the best are looked into. Deviation: what scores nearly as
well somewhere else is returned too, because a place with a rival is no place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .window_kernels import BLOCK, best_of, bounded, bounded_again, bounds_of, stamped

APART_M, APART_RAD = 1.0, 0.3  # two finds further apart than either are rivals, not neighbours


@dataclass(frozen=True, eq=False)
class Found:
    """pose (3,) of the body in the map, its score (mean closeness, 0..1), and that of the best place apart from it."""

    pose: np.ndarray
    score: float
    rival: float


class WindowSearch:
    """A map of points (N, 2), ready for searches."""

    def __init__(self, points: np.ndarray, *, cell_m: float, sigma_m: float) -> None:
        margin = 4.0 * sigma_m + BLOCK * cell_m
        self._corner = points.min(axis=0) - margin
        size = np.ceil((points.max(axis=0) + margin - self._corner) / cell_m).astype(int)
        self._cell_m = cell_m
        self._field = stamped(points, float(self._corner[0]), float(self._corner[1]), int(size[1]), int(size[0]), cell_m,
                              sigma_m)
        coarse = bounded(self._field)
        self._coarse = coarse, coarse

    def best(self, points: np.ndarray, around: np.ndarray, *, window_m: float, window_rad: float, step_rad: float,
             least: float, rivals: float = 0.94) -> Found | None:
        """The best pose within the window around a pose (3,), or None when none scores `least`. rivals: share of the best
        score from which another place counts."""
        cells = np.ascontiguousarray(points / self._cell_m)
        centre = (np.asarray(around[:2]) - self._corner) / self._cell_m
        half = int(np.ceil(window_rad / step_rad))
        yaws = around[2] + step_rad * np.arange(-half, half + 1)
        blocks = int(np.ceil(window_m / (self._cell_m * BLOCK)))
        if blocks > BLOCK and self._coarse[1] is self._coarse[0]:
            self._coarse = self._coarse[0], bounded_again(self._coarse[0])
        turns, bounds = bounds_of(self._coarse, cells, centre, yaws, blocks, least)
        promising = np.argwhere(bounds >= least)
        value = bounds[tuple(promising.T)]
        order = np.argsort(-value, kind="stable")
        shift = (promising[order][:, [2, 1]] - blocks) * BLOCK
        tries = np.ascontiguousarray(np.column_stack([promising[order][:, 0], shift, value[order]]), float)
        found = best_of(self._field, cells, centre, turns, tries, least, rivals)
        if not len(found):
            return None
        poses = np.column_stack([around[:2] + found[:, :2] * self._cell_m, yaws[found[:, 2].astype(int)]])
        top = int(found[:, 3].argmax())
        gap = np.abs(poses - poses[top])
        apart = (np.hypot(gap[:, 0], gap[:, 1]) > APART_M) | (gap[:, 2] > APART_RAD)
        rival = float(found[apart, 3].max()) if apart.any() else 0.0
        return Found(poses[top], float(found[top, 3]), rival)
