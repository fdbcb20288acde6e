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
from rhs.api.grid import OccupancyGrid, frame_of
from rhs.api.records import Scan
from rhs.estimation.scans.rays import add_marks, mark_scan

from .occupancy_config import Occupancy


class OccupancyMapper(Mapper):
    """Draws scans into one grid over the area to map."""

    def __init__(self, settings: Occupancy, bounds_m: tuple[float, float, float, float]) -> None:
        self._settings = settings
        self._shape, self._origin_m = frame_of(bounds_m, settings.resolution_m)
        self._hit_step = np.float32(np.log(settings.true_hit / settings.false_alarm))
        self._free_step = np.float32(np.log((1.0 - settings.true_hit) / (1.0 - settings.false_alarm)))
        self._bound = np.float32(np.log(settings.belief_bound / (1.0 - settings.belief_bound)))
        self._marks = np.zeros(self._shape, np.uint8)
        self._touched = np.zeros((self._marks.size, 2), np.int32)
        self.reset()

    def reset(self) -> None:
        """Forget everything: no cell has been observed."""
        self._log_odds = np.zeros(self._shape, np.float32)
        self._observed = np.zeros(self._shape, bool)

    def update(self, map_from_body: np.ndarray, scan: Scan) -> None:
        """Draw one scan (beams from `scan.origin_xy_m` in the body frame) seen from a pose (4x4)."""
        origin, angles = self._beams(map_from_body, scan)
        ranges = np.asarray(scan.ranges_m, float)
        reach = min(self._settings.range_max_m, scan.max_range_m)
        hits = np.isfinite(ranges) & (ranges <= reach)
        lengths = np.where(hits, ranges, np.where(np.isnan(ranges), 0.0, reach)) / self._settings.resolution_m
        count = mark_scan(self._marks, self._touched, origin, angles, lengths, hits)
        add_marks(self._log_odds, self._observed, self._marks, self._touched, count,
                  self._free_step, self._hit_step, self._bound)  # fmt: skip

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
