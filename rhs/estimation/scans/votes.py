"""Obstacles as votes of a grid: a beam that ends in a cell speaks for a thing there, one that passes against it.

The inverse sensor model of occupancy grids (Moravec and Elfes 1985) with votes in the place of log-odds, two grids of them:
what stands in the way of the scan at the camera's height is cleared by that scan; what only the whole depth image shows, a
table or a box below the camera, is cleared only from where the floor it stands on is in the picture (Scan.blind_m).
Loads numba: import it when it is needed.
"""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import planar
from rhs.api.jit import compiled
from rhs.api.records import Scan

from .rays import HIT, mark_stretches
from .settings import VoteSettings

BESIDE_M = 0.15  # where no beam ends so near to a cell, those that pass it do not pass beside what stands there
SAME_M, SAME_PER_M = 0.15, 0.05  # two beams that end this near one another see the same thing


class Votes:
    """(H, W) votes for a thing in each cell, in [0, most]; `origin_m` is the corner of cell (0, 0). walks (H, W) bool: cells
    of what may walk on: there a view through which nothing ends near by takes `gone` votes."""

    def __init__(self, shape: tuple[int, int], resolution_m: float, origin_m: tuple[float, float],
                 settings: VoteSettings) -> None:
        self.resolution_m, self.origin_m, self.settings = resolution_m, np.array(origin_m, float), settings
        self.votes, self.walks = np.zeros(shape, np.float32), np.zeros(shape, np.bool_)
        self._marks = np.zeros(shape, np.uint8)
        self._touched = np.zeros((self._marks.size, 2), np.int32)

    def look(self, map_from_body: np.ndarray, scan: Scan, *, hits: np.ndarray, within_m: float) -> np.ndarray:
        """Count one scan, each cell at most once. hits (N,) bool: the beams whose ends count as things. (K, 2) int32: the
        cells (row, column) that beams passed or ended in."""
        ranges = np.asarray(scan.ranges_m, float)
        reach = min(within_m, scan.max_range_m)
        end = np.where(np.isnan(ranges), 0.0, np.where(ranges <= reach, ranges - self.settings.short_m, reach))
        stretches = np.stack([np.full(len(end), scan.blind_m), end], axis=1) / self.resolution_m
        ends = np.where(hits & (ranges <= reach), ranges, np.inf) / self.resolution_m
        start = map_from_body[:2, :2] @ np.asarray(scan.origin_xy_m) + map_from_body[:2, 3]
        angles = np.ascontiguousarray(scan.bearings_rad, float) + planar(map_from_body)[2]
        at = (start - self.origin_m) / self.resolution_m
        count = mark_stretches(self._marks, self._touched, at, angles, stretches, ends)
        cells: np.ndarray = self._touched[:count].copy()
        settings, beside = self.settings, round(BESIDE_M / self.resolution_m)
        steps = np.array([settings.clear, settings.gone, settings.most], np.float32)
        _count(self.votes, self._marks, self.walks, cells, steps, beside)
        return cells


@compiled
def _count(votes: np.ndarray, marks: np.ndarray, walks: np.ndarray, cells: np.ndarray, steps: np.ndarray,
           beside: int) -> None:
    """Add the marks to the votes of their cells, and clear them. steps: (clear, gone, most); beside: cells."""
    clear, gone, most = steps
    for row, column in cells:
        if marks[row, column] == HIT:
            votes[row, column] = min(votes[row, column] + np.float32(1.0), most)
        elif votes[row, column] > np.float32(0.0):
            step = clear
            if walks[row, column]:
                step = gone
                for r in range(max(row - beside, 0), min(row + beside + 1, marks.shape[0])):
                    for c in range(max(column - beside, 0), min(column + beside + 1, marks.shape[1])):
                        if marks[r, c] == HIT:
                            step = clear
            votes[row, column] = max(votes[row, column] - step, np.float32(0.0))
    for row, column in cells:
        marks[row, column] = 0


def low_only(obstacle: Scan, scan: Scan | None) -> np.ndarray:
    """(N,) bool: beams of `obstacle` that end on something which the scan at the camera's height passes over."""
    hit: np.ndarray = np.isfinite(obstacle.ranges_m)
    if scan is None or not len(scan.bearings_rad):
        return hit
    order = np.argsort(scan.bearings_rad)
    last = len(order) - 1
    after = np.clip(np.searchsorted(scan.bearings_rad[order], obstacle.bearings_rad), min(1, last), last)
    around = scan.ranges_m[order][np.stack([np.maximum(after - 1, 0), after])]
    near = obstacle.ranges_m * (1.0 + SAME_PER_M) + SAME_M
    with np.errstate(invalid="ignore"):
        low: np.ndarray = hit & ~(around <= near).any(axis=0)
    return low


def behind(scan: Scan, hits: np.ndarray, up_to_m: float, *, step_m: float) -> np.ndarray:
    """(K, 2) points of the body frame behind the ends of the beams hits (N,) bool, up to so far behind them."""
    ranges_m = scan.ranges_m[hits][:, None] + np.arange(step_m, up_to_m, step_m)
    bearings_rad = scan.bearings_rad[hits][:, None]
    along = np.stack([np.cos(bearings_rad) * ranges_m, np.sin(bearings_rad) * ranges_m], axis=-1)
    points: np.ndarray = along.reshape(-1, 2) + np.asarray(scan.origin_xy_m)
    return points
