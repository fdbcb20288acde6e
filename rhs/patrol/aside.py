"""Out of the way of somebody who wants to come past.

A robot that waits before the only way on may itself stand in the way of whom it waits for: he comes up, waits, turns back,
and comes again. So after a while it goes aside, lets him pass, and tries again: off the way on which it saw somebody walk,
or where it saw nobody walk, to where there is room for two.
"""

from __future__ import annotations

import numpy as np

from rhs.api.grid import OccupancyGrid

PATIENCE_VIEWS = 12  # of waiting for somebody, half a second each, until the robot goes aside
REST_VIEWS = 16  # there, at most: who walks comes by in some seconds ...
REST_OFF_VIEWS = 40  # ... or stops for some at the end of his way, if it is known where he walks, ...
PASSED_VIEWS = 4  # ... and so many more when he has come by
PASSED_M = 2.0  # who comes so near comes by
MOST = 3  # times on the way to one place, each time elsewhere
AWAY_M = 2.0  # at least so far from what stands in the way
ELSEWHERE_M = 1.0  # and so far from where the robot stands, or stood aside before
NEAR_M = 5.0  # no further from the robot
SET_OFF_M = 0.5  # a robot close to things may set off from an open cell so near
ENOUGH_M = 0.8  # room beside the robot, as much as somebody keeps from it and is wide; more is no better
OFF_M = 1.2  # between the middles of a robot and of who walks past: half of both and what he keeps; more is no better
ROOM_SHARE = 0.3  # metres off his way that a metre of room is worth: not all of it was seen
WAY_COST = 0.1  # metres of room that a metre of way is worth
GRAIN_M = 0.1  # of where somebody walks
NOWHERE = np.zeros((0, 2))


class Trails:
    """Where somebody was seen to walk, in the map: what came to stand where nothing had been a moment ago."""

    def __init__(self) -> None:
        self._cells: set[tuple[int, int]] = set()

    def note(self, points_m: np.ndarray) -> None:
        """Somebody was seen at these points (K, 2)."""
        self._cells.update(map(tuple, np.floor(points_m / GRAIN_M).astype(int).tolist()))

    @property
    def points_m(self) -> np.ndarray:
        """(K, 2) metres in the map."""
        return (np.array(sorted(self._cells), dtype=float).reshape(-1, 2) + 0.5) * GRAIN_M


class Aside:
    """Going aside on the way to one place. goal_m (2,): where to, metres in the map; None while the robot does not."""

    def __init__(self) -> None:
        self.goal_m: np.ndarray | None = None
        self.for_m = np.zeros(2)  # who is let past
        self._spots: list[np.ndarray] = []
        self._rest, self._off = 0, False  # views left; whether it stands where nobody was seen to walk

    def resting(self, at_m: np.ndarray, within_m: float, *, passed: bool) -> bool:
        """Whether the robot at (2,) stands aside and lets others pass. passed: somebody comes by in this view."""
        if self.goal_m is not None and np.linalg.norm(at_m - self.goal_m) <= within_m:
            self.goal_m, self._rest = None, REST_OFF_VIEWS if self._off else REST_VIEWS
        elif passed and self._off:
            self._rest = min(self._rest, PASSED_VIEWS)
        self._rest -= self._rest > 0
        return self._rest > 0

    def go(self, at_m: np.ndarray, for_m: np.ndarray, grid: OccupancyGrid, blocked: np.ndarray,
           trail_m: np.ndarray = NOWHERE) -> bool:
        """Choose where to go from (2,), out of the way of what stands at for_m (2,); whether there is anywhere. blocked
        (H, W) bool: where the middle of the robot may not be. trail_m (K, 2): where somebody was seen to walk."""
        spots = np.stack([at_m, *self._spots])
        spot = roomy_spot(for_m, spots, grid, blocked, trail_m) if len(self._spots) < MOST else None
        self.goal_m, self.for_m, self._off = spot, for_m, len(trail_m) > 0
        self._spots += [] if spot is None else [spot]
        return spot is not None


def roomy_spot(for_m: np.ndarray, spots_m: np.ndarray, grid: OccupancyGrid, blocked: np.ndarray,
               trail_m: np.ndarray = NOWHERE) -> np.ndarray | None:
    """(2,) the middle of a cell off the trail (K, 2) of who walks there, or with room where none is known, away from (2,);
    None where there is none. spots_m (K, 2): the first is where the robot stands and sets off, the others were tried."""
    from scipy.ndimage import distance_transform_edt, label
    from scipy.spatial import cKDTree

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
    tried_m = spots_m[1:] if len(trail_m) else spots_m  # off the trail it may be a step
    if len(tried_m):
        fit &= np.linalg.norm(middles[:, None] - tried_m, axis=2).min(axis=1) >= ELSEWHERE_M
    if not fit.any():
        return None
    worth = np.minimum(grid.resolution_m * room_m, ENOUGH_M) - WAY_COST * way_m
    if len(trail_m):
        worth = np.minimum(cKDTree(trail_m).query(middles)[0], OFF_M) + ROOM_SHARE * worth
    return middles[fit][np.argmax(worth[fit])]
