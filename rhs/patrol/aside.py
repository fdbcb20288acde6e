"""Out of the way of somebody who wants to come past.

A robot that waits before the only way on may itself stand in the way of whom it waits for: he comes up, waits, turns back,
and comes again. So after a while it goes aside, to where there is room for two near by, lets him pass, and tries again.
"""

from __future__ import annotations

import numpy as np

from rhs.api.grid import OccupancyGrid

PATIENCE_VIEWS = 12  # of waiting for somebody, half a second each, until the robot goes aside
REST_VIEWS = 16  # there, at most: who walks comes by in some seconds
MOST = 3  # times on the way to one place, each time elsewhere
AWAY_M = 1.5  # from what stands in the way, and from where the robot has stood aside before
NEAR_M = 5.0  # no further from the robot
ENOUGH_M = 1.0  # room beside the robot's middle: its own and somebody's width; more is no better
WAY_COST = 0.1  # metres of room that a metre of way is worth


class Aside:
    """Going aside on the way to one place. goal_m (2,): where to, metres in the map; None while the robot does not."""

    def __init__(self) -> None:
        self.goal_m: np.ndarray | None = None
        self.for_m = np.zeros(2)  # who is let past
        self._spots: list[np.ndarray] = []
        self._rest = 0

    def resting(self, at_m: np.ndarray, within_m: float) -> bool:
        """Whether the robot at (2,) stands aside and lets others pass."""
        if self.goal_m is not None and np.linalg.norm(at_m - self.goal_m) <= within_m:
            self.goal_m, self._rest = None, REST_VIEWS
        self._rest -= self._rest > 0
        return self._rest > 0

    def go(self, at_m: np.ndarray, for_m: np.ndarray, grid: OccupancyGrid, open_cells: np.ndarray) -> bool:
        """Choose where to go from (2,), out of the way of what stands at for_m (2,); whether there is anywhere. open_cells
        (H, W) bool: where the map is free and nothing was seen to stand."""
        away_from_m = np.stack([for_m, at_m, *self._spots])
        spot = roomy_spot(at_m, away_from_m, grid, open_cells) if len(self._spots) < MOST else None
        self.goal_m, self.for_m = spot, for_m
        self._spots += [] if spot is None else [spot]
        return spot is not None


def roomy_spot(at_m: np.ndarray, away_from_m: np.ndarray, grid: OccupancyGrid, open_cells: np.ndarray) -> np.ndarray | None:
    """(2,) the middle of a cell with room near (2,), not near any of the points (K, 2); None where there is none."""
    from scipy.ndimage import distance_transform_edt

    room_m = distance_transform_edt(np.pad(open_cells, 1))[1:-1, 1:-1] * grid.resolution_m
    cells = np.argwhere(open_cells)
    middles = grid.centres(cells)
    way_m = np.linalg.norm(middles - at_m, axis=1)
    away_m = np.linalg.norm(middles[:, None] - away_from_m[None], axis=2).min(axis=1)
    fit = (way_m <= NEAR_M) & (away_m >= AWAY_M)
    if not fit.any():
        return None
    worth = np.minimum(room_m[cells[:, 0], cells[:, 1]], ENOUGH_M) - WAY_COST * way_m
    best: np.ndarray = middles[fit][np.argmax(worth[fit])]
    return best
