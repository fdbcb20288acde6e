"""OMPL's single-query planners behind rhs.api.contracts.Planner: one fresh, freshly seeded OMPL planner per problem."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from ompl import geometric as og

from rhs.api.records import Path, PlanningProblem

from .ompl_space import (
    Counter,
    GridMotion,
    LoggedGridMotion,
    definition,
    edges_of,
    fresh_seed,
    solution,
    space_over,
)
from .problem import Ground, Task, already_there, begin, finish


class TreePlanner:
    """make(information, settings, resolution_m) gives the OMPL planner; settings.iterations bounds its steps.

    logged: draw the edges it tested instead of its tree (BIT*'s cannot be read: OMPL then keeps its vertices for ever).
    """

    def __init__(self, settings, rng: np.random.Generator, make: Callable, *, logged: bool = False):
        self._settings, self._rng, self._make = settings, rng, make
        self._motion = LoggedGridMotion if logged else GridMotion
        self._ground, self._space, self._version = Ground(), None, -1

    def plan(self, problem: PlanningProblem) -> Path:
        """Space over the grid, unless it is at hand; seed; make; solve within the counted budget; check."""
        task = begin(problem, self._ground, self._settings.start_radius_m)
        if isinstance(task, Path):
            return task
        there = already_there(task)
        if there is not None:
            return finish(task, there, rounds=0, extras={"iterations": 0.0})
        setting_up = time.process_time()
        if self._version != self._ground.version:
            self._space, self._version = space_over(task.grid, self._motion), self._ground.version
        learn_ms = 1e3 * (time.process_time() - setting_up)
        information, motion = self._space
        fresh_seed(self._rng)
        planner = self._make(information, self._settings, problem.resolution_m)
        ends = definition(information, task.start, task.goal)
        planner.setProblemDefinition(ends)
        planner.setup()
        raw, used = self._solve(planner, ends, task)
        extras = {"iterations": float(used)}
        return finish(task, raw, rounds=self._settings.shorten_rounds, learn_ms=learn_ms, extras=extras,
                      sketch=lambda: _edges(information, planner, motion))

    def _solve(self, planner, ends, task: Task) -> tuple[np.ndarray | None, int]:
        """The path (N, 2) in cells, and the iterations used: the budget, and again where the settings allow extensions
        and there is a way that was not found yet. OMPL's planners go on with the tree they have."""
        used = 0
        for extension in range(getattr(self._settings, "extensions", 0) + 1):
            if extension and not task.ground.connected(task.start, task.goal):
                break
            counter = Counter(self._settings.iterations)
            planner.solve(counter.condition())
            used += min(counter.calls, self._settings.iterations)
            raw = solution(ends, task.start, task.goal)
            if raw is not None:
                break
        return raw, used


def _edges(information, planner, motion: GridMotion) -> np.ndarray:
    """(E, 2, 2) cells: the planner's tree, or the free edges it asked about since the last picture."""
    if isinstance(motion, LoggedGridMotion):
        lines = np.array(motion.free_edges).reshape(-1, 2, 2)
        motion.free_edges.clear()
        return lines
    points, edges = edges_of(information, planner)
    return points[edges]


def rrt(information, settings, resolution_m: float):
    planner = og.RRT(information)
    planner.setGoalBias(settings.goal_bias)
    return _ranged(planner, settings, resolution_m)


def rrt_connect(information, settings, resolution_m: float):
    return _ranged(og.RRTConnect(information), settings, resolution_m)


def rrt_star(information, settings, resolution_m: float):
    planner = og.RRTstar(information)
    planner.setGoalBias(settings.goal_bias)
    return _ranged(planner, settings, resolution_m)


def informed_rrt_star(information, settings, resolution_m: float):
    planner = og.InformedRRTstar(information)
    planner.setGoalBias(settings.goal_bias)
    return _ranged(planner, settings, resolution_m)


def bit_star(information, settings, resolution_m: float):
    planner = og.BITstar(information)
    planner.setSamplesPerBatch(settings.batch)
    return planner


def fmt(information, settings, resolution_m: float):
    planner = og.FMT(information)
    planner.setNumSamples(settings.samples)
    return planner


def _ranged(planner, settings, resolution_m: float):
    """Longest edge in cells, as the settings say; OMPL's own choice at 0."""
    if settings.range_m > 0.0:
        planner.setRange(settings.range_m / resolution_m)
    return planner
