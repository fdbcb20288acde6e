"""Things that stand where the map says free: seen in the scan, remembered for one mission only (thesis 5.6)."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import planar
from rhs.api.grid import OccupancyGrid, inflate
from rhs.api.records import Scan


def scan_points(map_from_body: np.ndarray, scan: Scan, *, within_m: float) -> np.ndarray:
    """(K, 2) map points of the beams of `scan` that hit something nearer than `within_m`."""
    hit = np.isfinite(scan.ranges_m) & (scan.ranges_m < within_m)
    x, y, yaw = planar(map_from_body)
    c, s = np.cos(yaw), np.sin(yaw)
    ox, oy = scan.origin_xy_m
    bx = ox + scan.ranges_m[hit] * np.cos(scan.bearings_rad[hit])
    by = oy + scan.ranges_m[hit] * np.sin(scan.bearings_rad[hit])
    return np.stack([x + c * bx - s * by, y + s * bx + c * by], axis=1)


class ObstacleWatch:
    """Compares scans with the finished map and keeps what the map does not know until told to forget it.

    A cell counts as an obstacle when scan points fell into it in at least `confirm` views, the map calls it free, and
    no wall of the map lies within `tolerance_m` (which absorbs the error of the belief).
    """

    def __init__(self, grid: OccupancyGrid, free: np.ndarray, *, tolerance_m: float, confirm: int = 2,
                 within_m: float = 4.0) -> None:
        self.grid = grid
        self.within_m = within_m
        self.confirm = confirm
        near_wall = inflate(grid.occupied(), tolerance_m / grid.resolution_m)
        self.explained = near_wall | ~free
        self.votes = np.zeros(grid.shape, np.int32)

    def forget(self) -> None:
        """A new mission begins with the map as surveyed."""
        self.votes[:] = 0

    def look(self, map_from_body: np.ndarray, scan: Scan) -> None:
        """Count one scan: at most one vote per cell and view."""
        points = scan_points(map_from_body, scan, within_m=self.within_m)
        points = points[self.grid.inside(points)] if len(points) else points
        if len(points):
            cells = np.unique(self.grid.cells(points), axis=0)
            self.votes[cells[:, 0], cells[:, 1]] += 1

    @property
    def cells(self) -> np.ndarray:
        """(H, W) bool: where something stands that the map does not know."""
        return (self.votes >= self.confirm) & ~self.explained
