"""Asks the planner for the way with the most room that is hardly longer than the one with the least."""

from __future__ import annotations

import time
from copy import deepcopy
from dataclasses import replace

import numpy as np

from rhs.api.contracts import Planner
from rhs.api.frozen import freeze
from rhs.api.grid import OccupancyGrid, configuration_space, inflate, nearest_open
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.api.validate import check_path

from .guard import TIGHT_M
from .mission import MissionSettings

LONGER = 1.2  # room is worth a way this much longer, not the other way round the building
COMFORTS = (1.0, 0.75, 0.5, 0.25, 0.0)  # shares of the wished-for room, tried in this order
SIDES = (1.0, 0.75, 0.5, 0.0)  # shares of the margin tried in this order in finer cells, none below TIGHT_M
FINER = 5  # for them cells of the map are split so often, each way: their middles must hit narrow ways
GOAL_SLACK_M = 0.05  # a goal may be moved by the distance at which a place counts as visited, less this


class RoomyPlanner:
    """A planner on one map of a patrol. who: what to call the planner in errors. side_m: metres that its last way
    keeps from what it was planned round at least; less than the margin where there was no other."""

    def __init__(self, planner: Planner, grid: OccupancyGrid, free: np.ndarray, *, radius_m: float,
                 settings: MissionSettings, who: str) -> None:
        self.planner, self.grid, self.settings, self.who = planner, grid, settings, who
        self.radius_m, self.side_m = radius_m, settings.margin_m
        self._free = free
        self._tight: TightMap | None = None  # made when there is no other way
        least_m, side_m = radius_m + settings.margin_m, min(settings.margin_m, settings.advanced.guard.side_m)
        narrow_cells = (radius_m + side_m) / grid.resolution_m
        self._squeezed = narrow_cells, configuration_space(~free, narrow_cells)
        self._grown = [(growth, configuration_space(~free, growth)) for growth in
                       np.unique([least_m + share * settings.comfort_m for share in COMFORTS])[::-1] / grid.resolution_m]

    def plan(self, start_m: np.ndarray, goal_m: np.ndarray, *, obstacles: np.ndarray, things_m: np.ndarray,
             squeeze: bool = False, seen_m: np.ndarray | None = None) -> Path:
        """The way from (2,) to (2,), metres in the map, round what stands there besides the map: obstacles (H, W) bool, in
        cells of it, and things_m (K, 2), seen just now and finer. squeeze: where there is no other way, through gaps that
        leave no margin for the size of the cells, for a robot whose guard does not let it touch; seen_m (K, 2): all that
        this robot has seen round itself lately, walls too, for gaps that are hardly wider than it."""
        self.side_m = self.settings.margin_m
        gap_cells = self._gap_m(things_m) / self.grid.resolution_m

        def ask(growth_cells: float, mapped: np.ndarray) -> Path:
            blocked = mapped | inflate(obstacles, growth_cells) | (gap_cells < growth_cells)
            return self._ask(self.grid, blocked, start_m, goal_m)

        least = ask(*self._grown[-1])
        if squeeze and not least.found and (narrow := ask(*self._squeezed)).found:
            self.side_m = min(self.settings.margin_m, self.settings.advanced.guard.side_m)
            return narrow
        if squeeze and not least.found and seen_m is not None and (tight := self._through(
                start_m, goal_m, obstacles, seen_m)) is not None:
            return tight
        for room in self._grown[:-1] if least.found else ():
            plan = ask(*room)
            if plan.found and length_m(plan) <= LONGER * length_m(least) + 0.5:
                return plan
        if least.reason is PlanReason.GOAL_BLOCKED and not self._something_at(goal_m, obstacles, gap_cells):
            return replace(least, reason=PlanReason.NEVER_SEEN)
        return least

    def blocked(self, obstacles: np.ndarray) -> np.ndarray:
        """(H, W) bool: where the robot's side would be nearer to a wall of the map or an obstacle (H, W) than its margin."""
        growth_cells, mapped = self._grown[-1]
        return mapped | inflate(obstacles, growth_cells)

    def _through(self, start_m: np.ndarray, goal_m: np.ndarray, obstacles: np.ndarray, seen_m: np.ndarray) -> Path | None:
        """A way in finer cells with as much of the margin as there is, or None."""
        self._tight = self._tight or TightMap(self.grid, self._free)
        margin_m = self.settings.margin_m
        room = self._tight.room_m(obstacles, seen_m, self.radius_m + margin_m)
        for side_m in np.unique(np.maximum(np.multiply(SIDES, margin_m), min(TIGHT_M, margin_m)))[::-1]:
            plan = self._ask(self._tight.grid, room < self.radius_m + side_m - 1e-9, start_m, goal_m)
            if plan.found:
                self.side_m = min(TIGHT_M, margin_m)
                return plan
        return None

    def _ask(self, grid: OccupancyGrid, blocked: np.ndarray, start_m: np.ndarray, goal_m: np.ndarray) -> Path:
        from rhs.estimation.paths.shorten import shortened  # compiled code, half a second to load

        near_m = nearest_open(grid, blocked, goal_m, self.settings.arrive_m - GOAL_SLACK_M)
        problem = freeze(PlanningProblem(blocked, grid.resolution_m, grid.origin_m, start_m.copy(), near_m))
        asked = freeze(deepcopy(problem))  # the judge keeps its own
        began_s = time.process_time()
        plan = self.planner.plan(asked)
        plan_ms = 1e3 * (time.process_time() - began_s)
        plan = check_path(plan, problem, who=self.who)
        plan = shortened(replace(plan, plan_ms=plan_ms), problem)
        return _set_off(plan, grid) if plan.found and blocked[tuple(grid.cells(start_m[None])[0])] else plan

    def _gap_m(self, things_m: np.ndarray) -> np.ndarray:
        """(H, W) metres from each cell's centre to the nearest thing."""
        gaps = np.full(self.grid.shape, np.inf)
        if len(things_m):
            from scipy.spatial import cKDTree

            cells = np.argwhere(np.isfinite(self.grid.probability))
            gaps[cells[:, 0], cells[:, 1]] = cKDTree(things_m).query(self.grid.centres(cells), distance_upper_bound=2.0)[0]
        return gaps

    def _something_at(self, goal_m: np.ndarray, obstacles: np.ndarray, gap_cells: np.ndarray) -> bool:
        """Whether anything known to stand somewhere bars the goal; what was never seen does not."""
        things = inflate(self.grid.occupied() | obstacles, self._grown[-1][0]) | (gap_cells < self._grown[-1][0])
        return bool(things[tuple(self.grid.cells(goal_m[None])[0])])


def with_unseen(grid: OccupancyGrid, free: np.ndarray, reach_m: float) -> np.ndarray:
    """(H, W) bool: free cells, and those within reach_m of one that nobody has looked at."""
    from scipy.ndimage import distance_transform_edt

    near = distance_transform_edt(~free) * grid.resolution_m <= reach_m
    return free | (np.isnan(grid.probability) & near)


class TightMap:
    """Gaps hardly wider than the robot: the map of a patrol in finer cells, with what was seen just now where it was seen.

    In cells of the map, 10 cm, walls and things are up to a cell thicker than they are, and the robot stands in the middle
    of cells only: a gap 20 cm wider than the robot may be closed. Here a thing counts at the middle of its cell, and where
    the robot has just seen what stands there, in cells of 5 cm, that takes the place of the map's cell. It is also what its
    guard asks, so that a way found here can be driven. grid: the finer cells.
    """

    def __init__(self, grid: OccupancyGrid, free: np.ndarray) -> None:
        from scipy.ndimage import binary_erosion

        self._map, self._free = grid, free
        self.grid = replace(grid, probability=self._split(grid.probability), resolution_m=grid.resolution_m / FINER)
        self._inside = self._split(free)
        self._mapped_m: np.ndarray | None = None  # room_m by the map alone
        taken = np.pad(~free, 1, constant_values=True)  # nobody knows what stands outside the map
        self._bounds = grid.centres(np.argwhere(taken & ~binary_erosion(taken, np.ones((3, 3)))) - 1)  # beside free cells

    def room_m(self, obstacles: np.ndarray, seen_m: np.ndarray, most_m: float) -> np.ndarray:
        """(H, W) metres from the middle of each finer cell to the nearest thing, at most most_m; 0 where the map does not
        call it free. obstacles (H, W) bool: cells of the map where something stands that it does not know. seen_m (K, 2):
        all that was seen round the robot lately, metres in the map, walls too."""
        from scipy.spatial import cKDTree

        if self._mapped_m is None:
            self._mapped_m = self._to_nearest(np.zeros(self.grid.shape), self._inside, self._bounds, most_m)
        new = self._map.centres(np.argwhere(obstacles & self._free))
        coarse = np.concatenate([self._bounds, new])
        if len(seen_m) and len(coarse):
            coarse = coarse[cKDTree(seen_m).query(coarse)[0] > self._map.resolution_m]
        changed = np.zeros(self._map.shape, bool)
        points = np.concatenate([new, seen_m])
        changed[tuple(self._map.cells(points[self._map.inside(points)]).T)] = True
        near = inflate(changed, most_m / self._map.resolution_m + 2.0) & self._free
        return self._to_nearest(self._mapped_m.copy(), self._split(near), np.concatenate([coarse, seen_m]), most_m)

    def _to_nearest(self, room: np.ndarray, where: np.ndarray, points: np.ndarray, most_m: float) -> np.ndarray:
        """room (H, W), with the metres from the middles of the finer cells `where` (H, W) to the nearest point (K, 2)."""
        from scipy.spatial import cKDTree

        cells = np.argwhere(where)
        if len(cells):
            gaps = cKDTree(points).query(self.grid.centres(cells), distance_upper_bound=most_m)[0] if len(points) else np.inf
            room[where] = np.minimum(gaps, most_m)
        return room

    @staticmethod
    def _split(cells: np.ndarray) -> np.ndarray:
        """(H, W) of the map, in finer cells."""
        return cells.repeat(FINER, axis=0).repeat(FINER, axis=1)


def _set_off(path: Path, grid: OccupancyGrid) -> Path:
    """The way of a robot that stands in a cell which its size closes, without the step to the middle of the nearest open
    cell: whatever side that lies on, the robot's guard knows how near it may come to what."""
    points = path.points_m
    if len(points) < 3 or np.linalg.norm(points[1] - points[0]) > np.sqrt(2.0) * grid.resolution_m:
        return path
    return replace(path, points_m=np.delete(points, 1, axis=0))


def length_m(path: Path) -> float:
    """Length of a path, metres."""
    return float(np.linalg.norm(np.diff(path.points_m, axis=0), axis=1).sum())
