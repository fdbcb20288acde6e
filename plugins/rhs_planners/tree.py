"""OMPL's single-query planners behind rhs.contracts.Planner: one fresh, freshly seeded OMPL planner per problem."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from ompl import geometric as og

from rhs.records import Path, PlanningProblem

from .ompl_space import Counter, definition, edges_of, fresh_seed, solution, space_over
from .problem import Ground, begin, finish, straight


class TreePlanner:
    """make(information, settings, resolution_m) gives the OMPL planner; settings.iterations bounds its steps.

    draws: its tree may be read out for pictures (BIT*'s may not: OMPL then keeps its vertices for ever).
    """

    def __init__(self, settings, rng: np.random.Generator, make: Callable, *, draws: bool = True):
        self._settings, self._rng, self._make, self._draws = settings, rng, make, draws
        self._ground, self._information, self._version = Ground(), None, -1

    def plan(self, problem: PlanningProblem) -> Path:
        task = begin(problem, self._ground, self._settings.start_radius_m)
        if isinstance(task, Path):
            return task
        setting_up = time.process_time()
        if self._version != self._ground.version:
            self._information, self._version = space_over(task.grid), self._ground.version
        learn_ms = 1e3 * (time.process_time() - setting_up)
        line = straight(task)
        if line is not None:
            return finish(task, line, rounds=0, learn_ms=learn_ms, extras={"iterations": 0.0})
        fresh_seed(self._rng)
        planner = self._make(self._information, self._settings, problem.resolution_m)
        ends = definition(self._information, task.start, task.goal)
        planner.setProblemDefinition(ends)
        planner.setup()
        counter = Counter(self._settings.iterations)
        planner.solve(counter.condition())
        raw = solution(ends, task.start, task.goal)

        def sketch() -> np.ndarray:
            points, edges = edges_of(self._information, planner)
            return points[edges]

        extras = {"iterations": float(min(counter.calls, self._settings.iterations))}
        return finish(task, raw, rounds=self._settings.shorten_rounds, learn_ms=learn_ms, extras=extras,
                      sketch=sketch if self._draws else None)


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
