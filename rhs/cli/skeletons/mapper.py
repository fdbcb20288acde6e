"""A mapper for rhs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Context
from rhs.api.geometry import planar
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Scan


@dataclass
class Skeleton(Bounded):
    """Log-odds of each cell: scans that end in it add, those that pass take away (Thrun et al. 2005, section 9.2)."""

    resolution_m: float = within(0.1, 0.01, 1.0)
    """side of a cell, metres"""
    hit: float = within(0.85, 0.0, 10.0)
    """what a scan adds to the log-odds of the cells in which its beams end"""
    miss: float = within(0.4, 0.0, 10.0)
    """what a scan takes away from the cells that its beams pass"""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self, context)


class Part:
    """odds: log-odds of a wall, (rows along y, columns along x); seen: whether a beam came there."""

    def __init__(self, settings: Skeleton, context: Context) -> None:
        self.settings, self.side_m = settings, settings.resolution_m
        x0, y0, x1, y1 = context.world.bounds_m
        self.origin_m = (x0 - self.side_m, y0 - self.side_m)  # walls stand on the bounds themselves
        self.shape = (int(np.ceil((y1 - y0) / self.side_m)) + 2, int(np.ceil((x1 - x0) / self.side_m)) + 2)
        self.reset()

    def reset(self) -> None:
        """Nothing was seen."""
        self.odds, self.seen = np.zeros(self.shape), np.zeros(self.shape, bool)

    def update(self, map_from_body: np.ndarray, scan: Scan) -> None:
        """One scan, which counts once in a cell. A range of inf saw nothing up to max_range_m; NaN says nothing."""
        known = ~np.isnan(scan.ranges_m)
        x, y, yaw = planar(map_from_body)
        eye = np.array([x, y]) + _turned(np.array(scan.origin_xy_m), yaw)
        along = _turned(np.stack([np.cos(scan.bearings_rad[known]), np.sin(scan.bearings_rad[known])], axis=-1), yaw)
        reach = np.minimum(scan.ranges_m[known], scan.max_range_m)
        hit = np.isfinite(scan.ranges_m[known])
        ended = self._cells(eye + reach[hit, None] * along[hit])
        ways = [eye + way * along[way < reach] for way in np.arange(0.0, reach.max(initial=0.0), 0.5 * self.side_m)]
        passed = self._cells(np.concatenate([np.empty((0, 2)), *ways])) & ~ended
        self.odds = np.clip(self.odds + self.settings.hit * ended - self.settings.miss * passed, -5.0, 5.0)
        self.seen |= ended | passed

    def grid(self) -> OccupancyGrid:
        """NaN where no beam came."""
        chance = np.where(self.seen, 1.0 / (1.0 + np.exp(-self.odds)), np.nan)
        return OccupancyGrid(chance.astype(np.float32), self.side_m, self.origin_m)

    def _cells(self, points_m: np.ndarray) -> np.ndarray:
        """Whether a point lies in each cell."""
        column, row = np.floor((points_m - self.origin_m) / self.side_m).astype(int).T
        inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        marks = np.zeros(self.shape, bool)
        marks[row[inside], column[inside]] = True
        return marks


def _turned(points: np.ndarray, yaw: float) -> np.ndarray:
    """(..., 2) points turned to the left."""
    turned: np.ndarray = points @ np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return turned
