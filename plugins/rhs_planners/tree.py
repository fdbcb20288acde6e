"""OMPL's single-query planners behind rhs.api.contracts.Planner: one fresh, freshly seeded OMPL planner per problem."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from ompl import geometric as og

from rhs.api.records import Path

from .ompl_space import Counter, GridMotion, LoggedGridMotion, definition, edges_of, fresh_seed, solution, space_over
from .problem import CellPlanner, Task, already_there, finish


class TreePlanner(CellPlanner):
    """make(information, settings, resolution_m, times) gives the OMPL planner, `times` as thorough as at first;
    settings.rounds(free_cells) the steps that each round of the search may take."""

    def __init__(self, settings, rng: np.random.Generator, make: Callable):
        super().__init__(settings)
        self._rng, self._make = rng, make
        self._anew = make is fmt  # it cannot go on with the tree it has; every round takes a new one
        # BIT*'s tree cannot be read, OMPL then keeps its vertices for ever: the edges it tested are drawn instead
        self._motion = LoggedGridMotion if make is bit_star else GridMotion
        self._version = -1
        self._space: tuple[Any, GridMotion]  # over the ground of that version

    def solve(self, task: Task) -> Path:
        """Space over the grid, unless it is at hand; seed; make; solve within the counted budgets; check."""
        there = already_there(task)
        if there is not None:
            return finish(task, there, extras={"iterations": 0.0})
        setting_up = time.process_time()
        if self._version != self._ground.version:
            self._space, self._version = space_over(task.grid, self._motion), self._ground.version
        learn_ms = 1e3 * (time.process_time() - setting_up)
        free = self._ground.free_cells
        times = self._settings.tries(free / self._ground.grid.size)
        rounds = [round(times * steps) for steps in self._settings.rounds(free)]
        raw, used, planner = self._search(task, rounds)
        information, motion = self._space
        return finish(task, raw, learn_ms=learn_ms, extras={"iterations": float(used)}, knob=self._settings.knob(rounds),
                      sketch=lambda: _edges(information, planner, motion))

    def _search(self, task: Task, rounds: list[int]) -> tuple[np.ndarray | None, int, Any]:
        """The path (N, 2) in cells, the steps used, and the planner: the first round, and the next ones while there is no
        path although a flood fill says there is a way."""
        used = 0
        for number, budget in enumerate(rounds):
            if number and not task.ground.connected(task.start, task.goal):
                break
            if number == 0 or self._anew:
                planner, ends = self._prepared(task, 2**number)
            counter = Counter(budget)
            planner.solve(counter.condition())
            used += min(counter.calls, budget)
            raw = solution(ends, task.start, task.goal)
            if raw is not None:
                break
        return raw, used, planner

    def _prepared(self, task: Task, times: int):
        """A freshly seeded planner, and the definition of its problem."""
        information, _ = self._space
        fresh_seed(self._rng)
        planner = self._make(information, self._settings, task.problem.resolution_m, times)
        ends = definition(information, task.start, task.goal)
        planner.setProblemDefinition(ends)
        planner.setup()
        return planner, ends


def _edges(information, planner, motion: GridMotion) -> np.ndarray:
    """(E, 2, 2) cells: the planner's tree, or the free edges it asked about since the last picture."""
    if isinstance(motion, LoggedGridMotion):
        lines = np.array(motion.free_edges).reshape(-1, 2, 2)
        motion.free_edges.clear()
        return lines
    points, edges = edges_of(information, planner)
    return points[edges]


def _biased(kind, information, settings, resolution_m: float, times: int):
    planner = kind(information)
    planner.setGoalBias(settings.goal_bias)
    return _ranged(planner, settings, resolution_m)


rrt, rrt_star, informed_rrt_star = (partial(_biased, kind) for kind in (og.RRT, og.RRTstar, og.InformedRRTstar))


def rrt_connect(information, settings, resolution_m: float, times: int):
    return _ranged(og.RRTConnect(information), settings, resolution_m)


def bit_star(information, settings, resolution_m: float, times: int):
    planner = og.BITstar(information)
    planner.setSamplesPerBatch(settings.batch)
    return planner


def fmt(information, settings, resolution_m: float, times: int):
    planner = og.FMT(information)
    planner.setNumSamples(times * settings.samples)
    return planner


def _ranged(planner, settings, resolution_m: float):
    """Longest edge in cells, as the settings say; OMPL's own choice at 0."""
    if settings.range_m > 0.0:
        planner.setRange(settings.range_m / resolution_m)
    return planner
