"""Gaps hardly wider than the robot: the map in finer cells, with what was seen just now where it was seen.

In cells of the map, 10 cm, walls and things are up to a cell thicker than they are, and the robot stands in the middle of
cells only: a gap 20 cm wider than the robot may be closed. Here cells are a third as wide, a thing counts at the middle of
its cell (Lozano-Perez 1983 for points), and where the robot has just seen what stands there, in cells of 5 cm, that takes
the place of the map's cell. This is also what its guard asks, so that a way found here can be driven.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.grid import OccupancyGrid

FINER = 3  # cells of the map are split so often, each way


class TightMap:
    """The map of a patrol in finer cells. `grid`: those cells."""

    def __init__(self, grid: OccupancyGrid, free: np.ndarray) -> None:
        from scipy.ndimage import binary_erosion

        self._map, self._free = grid, free
        self.grid = replace(grid, probability=grid.probability.repeat(FINER, axis=0).repeat(FINER, axis=1),
                            resolution_m=grid.resolution_m / FINER)
        self._inside = free.repeat(FINER, axis=0).repeat(FINER, axis=1)
        self._bounds = grid.centres(np.argwhere(~free & ~binary_erosion(~free, np.ones((3, 3)))))  # taken, beside free

    def room_m(self, obstacles: np.ndarray, seen_m: np.ndarray, most_m: float) -> np.ndarray:
        """(H, W) metres from the middle of each finer cell to the nearest thing, at most most_m; 0 where the map does not
        call it free. obstacles (H, W) bool: cells of the map where something stands that it does not know. seen_m (K, 2):
        all that was seen round the robot lately, metres in the map, walls too."""
        from scipy.spatial import cKDTree

        coarse = np.concatenate([self._bounds, self._map.centres(np.argwhere(obstacles & self._free))])
        if len(seen_m) and len(coarse):
            coarse = coarse[cKDTree(seen_m).query(coarse)[0] > self._map.resolution_m]
        points = np.concatenate([coarse, seen_m])
        room = np.zeros(self.grid.shape)
        cells = np.argwhere(self._inside)
        if len(points) and len(cells):
            gaps = cKDTree(points).query(self.grid.centres(cells), distance_upper_bound=most_m)[0]
            room[self._inside] = np.minimum(gaps, most_m)
        return room
