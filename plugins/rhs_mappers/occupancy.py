"""Binary Bayes occupancy grid (thesis section 3.1.2, eqs 3.8-3.13), kept as log-odds.

With TrueHit = P(hit | occupied) and FalseAlarm = P(hit | free), the thesis multiplies and normalises per cell

    hit:   p <- TrueHit p       / (TrueHit p       + FalseAlarm (1 - p))
    free:  p <- (1 - TrueHit) p / ((1 - TrueHit) p + (1 - FalseAlarm) (1 - p))

which is the addition of log(TrueHit / FalseAlarm), or log((1 - TrueHit) / (1 - FalseAlarm)), to log(p / (1 - p)).

Policy per scan: each cell is updated once, however many beams touch it, and a hit outweighs passing beams. The thesis
samples the polygon that a scan sees, which is once per cell as well; counting beams instead would let one scan cast
dozens of votes near the camera, all with the same pose error. Deviations: the free cells are found by exact traversal
of each beam instead of sampling, and beliefs are clamped.
"""

from __future__ import annotations

import numpy as np

from rhs.api.contracts import Mapper
from rhs.api.geometry import planar
from rhs.api.grid import MOST_CELLS, OccupancyGrid, frame_of
from rhs.api.records import Scan
from rhs.estimation.scans.rays import add_marks, mark_scan, mark_stretches

from .occupancy_config import Occupancy

GROWS_BY_M = 10.0  # at least, so that it does so seldom


class OccupancyMapper(Mapper):
    """Draws scans into one grid over the area to map, which grows with what is seen where nobody knows how large it is."""

    def __init__(self, settings: Occupancy, bounds_m: tuple[float, float, float, float], *, grows: bool = False) -> None:
        """bounds_m: x_min, y_min, x_max, y_max. grows: where these are only where to begin."""
        self._settings, self._grows = settings, grows
        self._first = frame_of(bounds_m, settings.resolution_m)
        self._hit_step = np.float32(np.log(settings.true_hit / settings.false_alarm))
        self._free_step = np.float32(np.log((1.0 - settings.true_hit) / (1.0 - settings.false_alarm)))
        self._bound = np.float32(np.log(settings.belief_bound / (1.0 - settings.belief_bound)))
        self.reset()

    def reset(self) -> None:
        """Forget everything: no cell has been observed."""
        shape, self._origin_m = self._first
        self._log_odds = np.zeros(shape, np.float32)
        self._observed = np.zeros(shape, bool)
        self._make_marks()

    def _make_marks(self) -> None:
        self._marks = np.zeros(self._log_odds.shape, np.uint8)
        self._touched = np.zeros((self._marks.size, 2), np.int32)

    def update(self, map_from_body: np.ndarray, scan: Scan) -> None:
        """Draw one scan (beams from `scan.origin_xy_m` in the body frame) seen from a pose (4x4)."""
        origin, angles = self._beams(map_from_body, scan)
        ranges = np.asarray(scan.ranges_m, float)
        reach = min(self._settings.range_max_m, scan.max_range_m)
        near = min(self._settings.free_max_m or reach, reach)
        hits = np.isfinite(ranges) & (ranges <= reach)
        ends = np.where(hits, ranges, np.where(np.isnan(ranges), 0.0, near)) / self._settings.resolution_m
        lengths = np.minimum(ends, near / self._settings.resolution_m)
        if self._grows:
            origin = origin + self._grown(origin[:, None] + ends * np.stack([np.cos(angles), np.sin(angles)]))
        if (lengths < ends).any():
            stretches, walls = np.stack([np.zeros(len(lengths)), lengths], axis=1), np.where(hits, ends, np.nan)
            count = mark_stretches(self._marks, self._touched, origin, angles, stretches, walls)
        else:
            count = mark_scan(self._marks, self._touched, origin, angles, lengths, hits)
        add_marks(self._log_odds, self._observed, self._marks, self._touched, count,
                  self._free_step, self._hit_step, self._bound)  # fmt: skip

    def _grown(self, ends: np.ndarray) -> np.ndarray:
        """Make room for the ends (2, N) of beams, x and y in cells; (2,) how far their cells moved by it. What is so far off
        that the grid would hold more than MOST_CELLS is left out: the odometry has gone astray."""
        size = np.array(self._log_odds.shape[::-1])
        below, above = -np.floor(ends.min(axis=1)), np.floor(ends.max(axis=1)) + 1 - size
        step = np.ceil(GROWS_BY_M / self._settings.resolution_m)
        before, after = (np.where(lack > 0, np.maximum(lack, step), 0).astype(int) for lack in (below, above))
        if not (before.any() or after.any()) or np.prod((size + before + after).astype(float)) > MOST_CELLS:
            return np.zeros(2)
        around = [(before[1], after[1]), (before[0], after[0])]
        self._log_odds, self._observed = np.pad(self._log_odds, around), np.pad(self._observed, around)
        self._origin_m = tuple(np.asarray(self._origin_m) - before * self._settings.resolution_m)
        self._make_marks()
        return before.astype(float)

    def grid(self) -> OccupancyGrid:
        """The map so far, a copy; NaN where no beam passed."""
        probability = 1.0 / (1.0 + np.exp(-self._log_odds))
        return OccupancyGrid(
            np.where(self._observed, probability, np.nan).astype(np.float32),
            self._settings.resolution_m,
            self._origin_m,
        )

    def _beams(self, map_from_body: np.ndarray, scan: Scan) -> tuple[np.ndarray, np.ndarray]:
        """Start of the beams in cells (2,), and their angles (N,) in the map."""
        yaw_rad = planar(map_from_body)[2]
        start_m = map_from_body[:2, :2] @ np.asarray(scan.origin_xy_m) + map_from_body[:2, 3]
        origin = (start_m - np.asarray(self._origin_m)) / self._settings.resolution_m
        return origin, np.ascontiguousarray(scan.bearings_rad, float) + yaw_rad
