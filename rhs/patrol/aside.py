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
AWAY_M = 2.0  # at least so far from what stands in the way
ELSEWHERE_M = 1.0  # and so far from where the robot stands, or stood aside before
NEAR_M = 5.0  # no further from the robot
SET_OFF_M = 0.5  # a robot close to things may set off from an open cell so near
ENOUGH_M = 0.8  # room beside the robot, as much as somebody keeps from it and is wide; more is no better
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

    def go(self, at_m: np.ndarray, for_m: np.ndarray, grid: OccupancyGrid, blocked: np.ndarray) -> bool:
        """Choose where to go from (2,), out of the way of what stands at for_m (2,); whether there is anywhere. blocked
        (H, W) bool: where the middle of the robot may not be."""
        spots = np.stack([at_m, *self._spots])
        spot = roomy_spot(for_m, spots, grid, blocked) if len(self._spots) < MOST else None
        self.goal_m, self.for_m = spot, for_m
        self._spots += [] if spot is None else [spot]
        return spot is not None


def roomy_spot(for_m: np.ndarray, spots_m: np.ndarray, grid: OccupancyGrid, blocked: np.ndarray) -> np.ndarray | None:
    """(2,) the middle of a cell with room, away from (2,); None where there is none. spots_m (K, 2): the first is where the
    robot stands and sets off, the others have been tried."""
    from scipy.ndimage import distance_transform_edt, label

    at_m, open_cells = spots_m[0], np.pad(~blocked, 1)
    regions, _ = label(open_cells)
    cells = np.argwhere(~blocked)
    if not len(cells):
        return None
    region, room_m = (array[1:-1, 1:-1][tuple(cells.T)] for array in (regions, distance_transform_edt(open_cells)))
    middles = grid.centres(cells)
    way_m = np.linalg.norm(middles - at_m, axis=1)
    here = np.unique(region[way_m <= max(way_m.min(), SET_OFF_M)])
    fit = np.isin(region, here) & (way_m <= NEAR_M) & (np.linalg.norm(middles - for_m, axis=1) >= AWAY_M)
    fit &= np.linalg.norm(middles[:, None] - spots_m, axis=2).min(axis=1) >= ELSEWHERE_M
    if not fit.any():
        return None
    worth = np.minimum(grid.resolution_m * room_m, ENOUGH_M) - WAY_COST * way_m
    best: np.ndarray = middles[fit][np.argmax(worth[fit])]
    return best
