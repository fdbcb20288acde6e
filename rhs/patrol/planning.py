"""Asks the planner for the way with the most room that is hardly longer than the one with the least."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from rhs.api.contracts import Planner
from rhs.api.frozen import freeze
from rhs.api.grid import OccupancyGrid, configuration_space, inflate, nearest_open
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.api.validate import check_path

from .control import ahead_on_path
from .mission import MissionSettings

LONGER = 1.2  # room is worth a way this much longer, not the other way round the building
COMFORTS = (1.0, 0.75, 0.5, 0.25, 0.0)  # shares of the wished-for room, tried in this order
GOAL_SLACK_M = 0.05  # a goal may be moved by the distance at which a place counts as visited, less this
FINER = 3  # a tight way is looked for in cells so many times smaller; odd, so that a cell has one in its middle
NARROW_M = 0.5  # round where it is tight the way may be so; elsewhere it keeps the margin
DOUBTS = (0.0, 0.25, 0.5)  # shares of a cell by which the things of the map may stand further off than its middle, there


class RoomyPlanner:
    """A planner on one map of a patrol. who: what to call the planner in errors."""

    def __init__(self, planner: Planner, grid: OccupancyGrid, free: np.ndarray, *, radius_m: float,
                 settings: MissionSettings, who: str) -> None:
        self.planner, self.grid, self.settings, self.who = planner, grid, settings, who
        least_m, self._side_m = radius_m + settings.margin_m, min(settings.margin_m, settings.advanced.guard.side_m)
        self.radius_m, self._free = radius_m, free
        self._grown = [(growth_m, configuration_space(~free, growth_m / grid.resolution_m)) for growth_m in
                       np.unique([least_m + share * settings.comfort_m for share in COMFORTS])[::-1]]

    @cached_property
    def _tight(self) -> tuple[OccupancyGrid, list[tuple[float, np.ndarray]]]:
        """The map in finer cells; grown by the margin, and for each of DOUBTS to where the robot's middle may not be."""
        grid, step_m = self.grid, self.grid.resolution_m
        fine = replace(grid, probability=grid.probability.repeat(FINER, 0).repeat(FINER, 1), resolution_m=step_m / FINER)
        middles = np.zeros(fine.shape, bool)
        middles[FINER // 2::FINER, FINER // 2::FINER] = ~self._free
        side_m = self.radius_m + self._side_m
        growths = [(self._grown[-1][0], 0.0), *((side_m, doubt * step_m) for doubt in DOUBTS)]
        return fine, [(to_things_m, configuration_space(middles, (to_things_m - doubt_m) / fine.resolution_m))
                      for to_things_m, doubt_m in growths]

    @property
    def tight_m(self) -> float:
        """The least distance of a way from the middle of a thing that is known when it is planned, metres."""
        return self.radius_m + self._side_m - self.grid.resolution_m / FINER / np.sqrt(2.0)

    def plan(self, start_m: np.ndarray, goal_m: np.ndarray, *, things_m: np.ndarray, squeeze: bool = False) -> Path:
        """The way from (2,) to (2,), metres in the map, round what stands there besides the map: things_m (K, 2). squeeze:
        where there is no other way, through gaps that leave no margin for the size of the cells, for a robot whose guard
        does not let it touch."""
        ends_m = (start_m, goal_m)
        gaps_m = self._gaps_m(self.grid, self._free, things_m, self._grown[0][0])
        *roomier, least_blocked = (mapped | (gaps_m < growth_m) for growth_m, mapped in self._grown)
        least = self._ask(self.grid, least_blocked, ends_m)
        if squeeze and not least.found and (narrow := self._squeezed(things_m, ends_m)) is not None:
            return narrow
        for blocked in roomier if least.found else ():
            plan = self._ask(self.grid, blocked, ends_m)
            if plan.found and length_m(plan) <= LONGER * length_m(least) + 0.5:
                return plan
        if least.reason is PlanReason.GOAL_BLOCKED and not self._something_at(goal_m, things_m):
            return replace(least, reason=PlanReason.NEVER_SEEN)
        return least

    def _squeezed(self, things_m: np.ndarray, ends_m: tuple[np.ndarray, np.ndarray]) -> Path | None:
        """A way on which the robot's side is as near to things as its guard lets it, only where there is no more room."""
        fine, grown = self._tight
        gaps_m = self._gaps_m(fine, ~grown[-1][1], things_m, grown[0][0])
        tight = grown[0][1] | (gaps_m < grown[0][0])
        for to_things_m, mapped in grown[1:]:
            blocked = mapped | (gaps_m < to_things_m)
            plan = self._ask(fine, blocked, ends_m)
            if plan.found:
                away = self._gaps_m(fine, tight & ~blocked, _narrows(plan, fine, tight), NARROW_M) > NARROW_M
                better = self._ask(fine, blocked | (tight & away), ends_m)
                return better if better.found else plan
        return None

    def _ask(self, grid: OccupancyGrid, blocked: np.ndarray, ends_m: tuple[np.ndarray, np.ndarray]) -> Path:
        """The planner's way, pulled tight, for a robot whose middle may not be in the cells `blocked` (H, W) bool."""
        from rhs.estimation.paths.shorten import shortened  # compiled code, half a second to load

        near_m = nearest_open(grid, blocked, ends_m[1], self.settings.arrive_m - GOAL_SLACK_M)
        problem = freeze(PlanningProblem(blocked, grid.resolution_m, grid.origin_m, ends_m[0].copy(), near_m))
        began_s = time.process_time()
        plan = self.planner.plan(problem)
        plan_ms = 1e3 * (time.process_time() - began_s)
        plan = check_path(plan, problem, who=self.who)
        return shortened(replace(plan, plan_ms=plan_ms), problem)

    def _gaps_m(self, grid: OccupancyGrid, where: np.ndarray, things_m: np.ndarray, up_to_m: float) -> np.ndarray:
        """(H, W) metres from the middles of the cells `where` (H, W) bool to the nearest thing; inf beyond up_to_m."""
        gaps_m = np.full(grid.shape, np.inf)
        if len(things_m):
            from scipy.spatial import cKDTree

            cells = np.argwhere(where)
            gaps_m[where] = cKDTree(things_m).query(grid.centres(cells), distance_upper_bound=up_to_m)[0]
        return gaps_m

    def _something_at(self, goal_m: np.ndarray, things_m: np.ndarray) -> bool:
        """Whether anything known to stand somewhere bars the goal; what was never seen does not."""
        growth_m = self._grown[-1][0]
        mapped = inflate(self.grid.occupied(), growth_m / self.grid.resolution_m)[tuple(self.grid.cells(goal_m[None])[0])]
        return bool(mapped) or bool((np.linalg.norm(things_m - goal_m, axis=1) < growth_m).any())


def _narrows(plan: Path, grid: OccupancyGrid, tight: np.ndarray) -> np.ndarray:
    """(K, 2) points of the way where it has to leave the cells with room: between parts of them that do not hang together.
    tight (H, W) bool: the other cells."""
    from scipy.ndimage import label

    way_m = ahead_on_path(plan.points_m, plan.points_m[0], np.inf)
    cells = np.clip(grid.cells(way_m), 0, np.array(grid.shape) - 1)
    part = label(~tight)[0][cells[:, 0], cells[:, 1]]
    narrow = part == 0
    for before, after in pairwise(np.flatnonzero(part)):
        narrow[before:after] &= part[before] != part[after]
    return way_m[narrow]


def length_m(path: Path) -> float:
    """Length of a path, metres."""
    return float(np.linalg.norm(np.diff(path.points_m, axis=0), axis=1).sum())
