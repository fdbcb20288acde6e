"""From a PlanningProblem in metres to cells of a padded grid, and from a path in cells back to a Path in metres.

Cells are continuous: cell (i, j) covers [i, i+1) x [j, j+1) of a grid with one blocked cell all round, so no planner
needs a case for the edge of the map. Times are CPU milliseconds of this process.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from rhs.api.errors import ContractError
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.estimation.paths.line import polyline_free, scaled

Knob = tuple[str, int]
_EMPTY = np.empty((0, 2))


class Ground:
    """The grid of the last problem, padded; kept while the grid stays the same. `version` counts its changes."""

    def __init__(self):
        self.grid = np.ones((0, 0), np.uint8)
        self.version = 0
        self._free, self._free_cells = None, -1
        self._last: np.ndarray | None = None  # the array the grid was taken from, if nobody can have changed it

    def stand_on(self, blocked: np.ndarray) -> None:
        """Take the grid (H, W) bool of a problem; cheap when it has not changed."""
        if blocked is self._last:
            return
        if blocked.ndim != 2 or 0 in blocked.shape or blocked.dtype != np.bool_:
            raise ContractError(
                f"planning problem: blocked has shape {blocked.shape} and type {blocked.dtype}; expected (H, W) bool"
            )
        shape = (blocked.shape[0] + 2, blocked.shape[1] + 2)
        inner = np.ascontiguousarray(blocked).view(np.uint8)
        constant = not blocked.flags.writeable and (blocked.base is None or not blocked.base.flags.writeable)
        self._last = blocked if constant else None
        if self.grid.shape == shape and np.array_equal(self.grid[1:-1, 1:-1], inner):
            return
        if self.grid.shape != shape:
            self.grid = np.ones(shape, np.uint8)
        self.grid[1:-1, 1:-1] = inner
        self.version += 1
        self._free, self._free_cells = None, -1

    @property
    def free_cells(self) -> int:
        """How many cells are free."""
        if self._free_cells < 0:
            self._free_cells = self.grid.size - int(np.count_nonzero(self.grid))
        return self._free_cells

    def connected(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Two points in free cells can be joined: their cells are in one 4-connected piece (exact for a point)."""
        if self._free is None:
            self._free = label(self.grid == 0)[0]
        (i, j), (k, m) = np.floor(a).astype(int), np.floor(b).astype(int)
        return bool(self._free[j, i] == self._free[m, k])


@dataclass(eq=False, slots=True)
class Task:
    """A problem whose ends are usable. ends (2, 2): start and goal, cells, in free cells. moved_m: how far the start was
    set off to leave a blocked cell, metres. began_s: CPU clock when planning began."""

    problem: PlanningProblem
    ground: Ground
    ends: np.ndarray
    moved_m: float
    began_s: float

    @property
    def grid(self) -> np.ndarray:
        return self.ground.grid

    @property
    def start(self) -> np.ndarray:
        return self.ends[0]

    @property
    def goal(self) -> np.ndarray:
        return self.ends[1]

    def metres(self, cells: np.ndarray) -> np.ndarray:
        """(..., 2) metres in the map frame of (..., 2) padded cells."""
        step, (x, y) = self.problem.resolution_m, self.problem.origin_m
        return scaled(cells.reshape(-1, 2), step, x - step, y - step).reshape(cells.shape)


class CellPlanner:
    """rhs.api.contracts.Planner over cells. Who derives from it has `solve(task)`, for ends that can be used."""

    def __init__(self, settings):
        self._settings, self._ground = settings, Ground()

    def plan(self, problem: PlanningProblem) -> Path:
        task = begin(problem, self._ground, self._settings.start_radius_m)
        return task if isinstance(task, Path) else self.solve(task)

    def solve(self, task: Task) -> Path:
        raise NotImplementedError


def begin(problem: PlanningProblem, ground: Ground, start_radius_m: float) -> Task | Path:
    """The task, or the Path that says why start or goal cannot be used.

    A start inside a blocked cell (a grown obstacle seen too late) is set to the nearest centre of a free cell within
    `start_radius_m`; the path still begins at the true start.
    """
    began = time.process_time()
    ground.stand_on(problem.blocked)
    start, goal = _cells(problem, problem.start_m), _cells(problem, problem.goal_m)
    if not (_inside(ground.grid, start) and _inside(ground.grid, goal)):
        return failure(PlanReason.OUTSIDE, began)
    moved = 0.0
    if ground.grid[int(start[1]), int(start[0])]:
        free = _nearest_free(ground.grid, np.array(start), start_radius_m / problem.resolution_m)
        if free is None:
            return failure(PlanReason.START_BLOCKED, began)
        moved = math.dist(free, start) * problem.resolution_m
        start = tuple(free)
    if ground.grid[int(goal[1]), int(goal[0])]:
        return failure(PlanReason.GOAL_BLOCKED, began)
    return Task(problem, ground, np.array((start, goal)), moved, began)


def already_there(task: Task) -> np.ndarray | None:
    """(2, 2) cells when start and goal are one point, which sampling planners need not be troubled with; else None."""
    return task.ends if math.dist(*task.ends.tolist()) < 1e-6 else None


def finish(task: Task, raw: np.ndarray | None, *, learn_ms: float = 0.0, extras: dict | None = None,
           knob: Knob | None = None, sketch: Callable[[], np.ndarray] | None = None, keep_shape: bool = False) -> Path:
    """The Path of a path (N, 2) in cells, as it was found; or, for None, the reason why there is none.

    extras: numbers for the table. knob: the setting that bounded the search, and the number it stood for. sketch gives
    (E, 2, 2) cells, the tree or roadmap, when somebody draws. A path that leaves the free cells is never returned: that is
    a fault of the planner, a ContractError.
    """
    extras = dict(extras or {}, start_moved_m=task.moved_m)
    reason, points = PlanReason.OK, _EMPTY
    if raw is None:
        reason = PlanReason.BUDGET_SPENT if task.ground.connected(task.start, task.goal) else PlanReason.DISCONNECTED
    else:
        points = _in_metres(task, raw)
    further = advice(*knob) if knob is not None and reason is PlanReason.BUDGET_SPENT else ""
    plan_ms = 1e3 * (time.process_time() - task.began_s) - learn_ms
    drawing = None if sketch is None else lambda: task.metres(sketch())
    return Path(reason, points, points, learn_ms, plan_ms, drawing, extras, keep_shape, further)


def advice(setting: str, number: int) -> str:
    """What to type after a budget was spent."""
    return f"planner.{setting}={number} spent; try planner.{setting}={10 * max(number, 1)}"


def failure(reason: PlanReason, began_s: float) -> Path:
    """A Path that was refused before planning, and why."""
    return Path(reason, _EMPTY, _EMPTY, 0.0, 1e3 * (time.process_time() - began_s))


def _in_metres(task: Task, cells: np.ndarray) -> np.ndarray:
    """The path in metres, with the ends exactly as the problem gave them; a start that was set off stays as a second
    point."""
    if not polyline_free(task.grid, cells):
        raise ContractError("planner returned a path through blocked cells; expected every segment to be free")
    points = task.metres(cells)
    if task.moved_m > 0.0:
        points = np.vstack([np.asarray(task.problem.start_m, float), points])
    points[0], points[-1] = task.problem.start_m, task.problem.goal_m
    return points


def _cells(problem: PlanningProblem, point_m) -> tuple[float, float]:
    """x, y in padded cells of a point; within 1e-9 of a border it counts as on it, as OccupancyGrid.cells does."""
    step, (x, y) = problem.resolution_m, problem.origin_m
    return _on_border((float(point_m[0]) - x) / step + 1.0), _on_border((float(point_m[1]) - y) / step + 1.0)


def _on_border(cell: float) -> float:
    return float(round(cell)) if math.isfinite(cell) and abs(cell - round(cell)) < 1e-9 else cell


def _inside(grid: np.ndarray, point: tuple[float, float]) -> bool:
    rows, columns = grid.shape
    return 1.0 <= point[0] < columns - 1 and 1.0 <= point[1] < rows - 1


def _nearest_free(grid: np.ndarray, point: np.ndarray, radius: float) -> np.ndarray | None:
    """(2,) centre of the nearest free cell within `radius` cells, first in row order among equals; else None."""
    low = np.maximum(np.floor(point - radius - 1).astype(int), 0)
    high = np.floor(point + radius + 2).astype(int)
    rows, columns = np.nonzero(grid[low[1]: high[1], low[0]: high[0]] == 0)
    if not len(rows):
        return None
    centres = np.stack([columns + low[0], rows + low[1]], axis=1) + 0.5
    distance = np.hypot(*(centres - point).T)
    best = int(np.argmin(distance))
    return centres[best] if distance[best] <= radius + 1e-9 else None
