"""OMPL's plane over one grid: bounds, exact motion checks in one crossing per edge, counted budgets, seeds.

OMPL (Sucan, Moll, Kavraki, "The Open Motion Planning Library", 2012) is used from Python with three cautions:
- an edge is checked whole by a compiled walk over cells, in one crossing from Python on a grid known by its address;
  checking states along it in Python is slower and cuts corners;
- termination is a counter, never a clock, and never given to a solve() that runs a thread of its own (PRM's does);
- its random seed is global and read when a planner is made, so it is set before every new planner from our own
  generator. That makes a plan depend on its seed only, whatever was planned before in the process. Two planners must
  not be built at the same time in two threads of one process.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba as nb
import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic
from ompl import base as ob
from ompl import util as ou

from rhs.api.jit import typed
from rhs.estimation.paths.line import segment_free


@intrinsic
def _as_pointer(typing_context, address):
    """An integer address as a pointer to bytes."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), generate


@typed(nb.boolean(nb.intp, nb.int64, nb.int64, nb.float64, nb.float64, nb.float64, nb.float64))
def segment_free_at(address, rows, columns, x0, y0, x1, y1):
    """segment_free on the uint8 grid at a memory address: spares unboxing the array on every call from OMPL.

    Ends beyond the grid are not free."""
    if not (0.0 <= min(x0, x1) and max(x0, x1) < columns and 0.0 <= min(y0, y1) and max(y0, y1) < rows):
        return False
    grid = nb.carray(_as_pointer(address), (rows, columns), np.uint8)  # type: ignore[call-arg]  # numba gives the first
    return segment_free(grid, x0, y0, x1, y1)


class GridMotion(ob.MotionValidator):
    """Exact validity of a straight motion over a uint8 grid (H, W), which must stay alive and in place."""

    def __init__(self, space_information, grid: np.ndarray):
        super().__init__(space_information)
        self._grid, self._address = grid, grid.ctypes.data
        self._rows, self._columns = grid.shape

    def checkMotion(self, a, b):
        return segment_free_at(self._address, self._rows, self._columns, a[0], a[1], b[0], b[1])


class LoggedGridMotion(GridMotion):
    """GridMotion that remembers the free edges it was asked about, for pictures of planners whose tree cannot be read."""

    def __init__(self, space_information, grid: np.ndarray):
        super().__init__(space_information, grid)
        self.free_edges: list[tuple[float, float, float, float]] = []

    def checkMotion(self, a, b):
        ends = a[0], a[1], b[0], b[1]
        free = segment_free_at(self._address, self._rows, self._columns, *ends)
        if free:
            self.free_edges.append(ends)
        return free


class Counter:
    """A termination condition that allows `budget` calls, or fewer when `enough` says so."""

    def __init__(self, budget: int, enough: Callable[[], bool] | None = None):
        self.budget, self.calls, self._enough = budget, 0, enough

    def condition(self):
        """For OMPL. Not kept here: it refers back to this counter, a ring that Python could not free."""
        return ob.PlannerTerminationCondition(self._spent)

    def _spent(self) -> bool:
        self.calls += 1
        return self.calls > self.budget or (self._enough is not None and self._enough())


def fresh_seed(rng: np.random.Generator) -> None:
    """Seed OMPL for the next planner from our generator; OMPL's warning about a second seeding is not for us."""
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    ou.RNG.setSeed(int(rng.integers(1, 2**31)))


def space_over(grid: np.ndarray, motion: type[GridMotion] = GridMotion):
    """SpaceInformation over a padded uint8 grid, and its validator of motions (made from the class `motion`).

    Both read the grid where it lies, so changes to it are seen at once.
    """
    rows, columns = grid.shape
    plane = ob.RealVectorStateSpace(2)
    bounds = ob.RealVectorBounds(2)
    for axis, size in enumerate((columns, rows)):
        bounds.setLow(axis, 1.0)
        bounds.setHigh(axis, size - 1.0 - 1e-6)
    plane.setBounds(bounds)
    information = ob.SpaceInformation(plane)
    cells = grid.reshape(-1).data  # reading one byte of a memoryview is the cheapest check from Python
    information.setStateValidityChecker(lambda state: cells[int(state[1]) * columns + int(state[0])] == 0)
    validator = motion(information, grid)
    information.setMotionValidator(validator)
    information.setup()
    return information, validator


def definition(information, start: np.ndarray, goal: np.ndarray):
    """ProblemDefinition from start to goal, (2,) cells each."""
    problem = ob.ProblemDefinition(information)
    ends = []
    for point in (start, goal):
        state = information.allocState()
        state[0], state[1] = float(point[0]), float(point[1])
        ends.append(state)
    problem.setStartAndGoalStates(ends[0], ends[1], 1e-6)
    return problem


def solution(problem, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
    """(N, 2) cells of an exact solution; None for none, for an approximate one, or one that does not join the ends."""
    if not problem.hasExactSolution():
        return None
    points: list[Any] = [(state[0], state[1]) for state in problem.getSolutionPath().getStates()]
    if len(points) < 2 or max(math.dist(points[0], start), math.dist(points[-1], goal)) > 1e-5:
        return None
    points[0], points[-1] = start, goal
    return np.array(points)


def edges_of(information, planner) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 2) in cells and edges (E, 2) of the planner's tree or roadmap."""
    data = ob.PlannerData(information)
    planner.getPlannerData(data)
    count = data.numVertices()
    points = np.empty((count, 2))
    edges: list[tuple[int, int]] = []
    for k in range(count):
        state = data.getVertex(k).getState()
        points[k] = state[0], state[1]
        edges.extend((k, other) for other in data.getEdges(k))
    return points, np.array(edges, int).reshape(-1, 2)
