"""Where the floor ends on each bearing of a depth image that is blank above it: a plain wall, to two eyes.

Disparity needs texture. Before a plain wall the floor alone has any, up to the line where both meet: below it the column is
known, above it up to the horizon nothing is, and that line is where the robot's way ends (compare the free space of
Badino, Franke and Mester, "Free space computation using stochastic occupancy grids and dynamic programming", ICCV workshop
2007). Floor that is itself blank ends where its texture does, and counts as barred: the cautious side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.frozen import freeze
from rhs.api.records import Scan

from .obstacle_scan import ObstacleScanner
from .settings import FloorEndSettings


class FloorEnds:
    """Reads the images of an obstacle scanner once more. sure_m: further ends are the sensor's, not the floor's."""

    def __init__(self, scanner: ObstacleScanner, settings: FloorEndSettings, *, sure_m: float) -> None:
        self._scanner, self._settings = scanner, settings
        self.reach_m = min(sure_m, settings.range_m)

    def ranges(self, z: np.ndarray, floor: tuple[np.ndarray, bool]) -> np.ndarray:
        """(N,) metres along the scanner's bearings to where the floor ends before a blank; inf where it is seen further
        than its reach, NaN where a column shows no such end. z: a thinned depth image; floor: of it (ObstacleScanner)."""
        plane, seen = floor
        out = np.full(len(self._scanner.bearings_rad), np.nan)
        if not seen:
            return out
        heights, away, down = self._scanner.heights(z, plane)
        s, rows = self._settings, np.arange(len(z))[:, None]
        known = np.isfinite(heights)
        with np.errstate(invalid="ignore"):
            flat = np.abs(heights) <= s.floor_m + s.floor_per_m * away
        pair = flat & np.roll(flat, -1, axis=0)  # two rows agree
        pair[-1] = False
        top = np.where(pair.any(axis=0), pair.argmax(axis=0), len(z))
        below, blank = rows >= top, down & (rows < top)
        of = blank.sum(axis=0)
        floors, least = (flat & below).sum(axis=0), s.least_rows
        good = floors >= np.maximum(least, s.floor_below * below.sum(axis=0))
        good &= (of >= least) & ((known & blank).sum(axis=0) <= s.known_above * of)
        columns = np.flatnonzero(good)
        end = away[top[columns], columns]
        out[self._scanner.beam_of[top[columns], columns]] = np.where(end <= self.reach_m, end, np.inf)
        return out


def filled(scan: Scan, bearings_rad: np.ndarray, ends_m: np.ndarray) -> Scan:
    """The scan with what it does not know (NaN) taken from the nearest of the bearings (N,), ends_m (N,)."""
    between = 0.5 * (bearings_rad[1:] + bearings_rad[:-1])
    nearest = ends_m[np.searchsorted(between, scan.bearings_rad)]
    ranges = np.where(np.isnan(scan.ranges_m), nearest, scan.ranges_m)
    return replace(scan, ranges_m=freeze(ranges))
