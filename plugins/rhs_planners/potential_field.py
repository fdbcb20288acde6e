"""Potential field with a repulsive trail (Khatib 1986; the trail is the thesis's, section 3.2.5).

The walk goes to the neighbour cell of least potential: distance to the goal, plus repulsion near blocked cells, plus
a trail, a cone heaped on the cells round each visited one, that fills local minima until the walk leaves them. On grids
of finer cells the cones come at the same distances in metres, so that the walk is much the same. It is a search, not a
plan: loops are cut out of the walk before anyone drives it. Deterministic.
"""

from __future__ import annotations

import time

import numba as nb
import numpy as np
from scipy.ndimage import distance_transform_edt

from rhs.api.jit import compiled, typed
from rhs.api.records import Path
from rhs.estimation.paths.line import GRID, NEW_POINTS, POINTS, segment_free

from .problem import CellPlanner, Task, finish

_FIELD = nb.types.Array(nb.float64, 2, "C")


class PotentialFieldPlanner(CellPlanner):
    """Settings: config.PotentialField."""

    def __init__(self, settings):
        super().__init__(settings)
        self._repulsion, self._version = np.empty((0, 0)), -1

    def solve(self, task: Task) -> Path:
        """Potential of the goal over the kept repulsion, walk, cut loops."""
        learning = time.process_time()
        if self._version != self._ground.version:
            self._repulsion, self._version = self._repel(task), self._ground.version
        learn_ms = 1e3 * (time.process_time() - learning)
        step_m = task.problem.resolution_m
        field = _with_attraction(self._repulsion, step_m, task.goal[0], task.goal[1])
        every = max(1, round(self._settings.trail_step_m / step_m))
        walk, arrived = descend(task.grid, field, task.ends, every, self._settings.trail * every * step_m,
                                round(self._settings.trail_radius_m / step_m, 9), self._settings.steps * every)
        extras = {"walk_steps": float(len(walk) - 1)}
        raw = _join(task, without_loops(walk)) if arrived else None
        return finish(task, raw, learn_ms=learn_ms, extras=extras, knob=("steps", self._settings.steps),
                      sketch=lambda: np.stack([walk[:-1], walk[1:]], axis=1))

    def _repel(self, task: Task) -> np.ndarray:
        """(H, W) metres of potential from blocked cells, at cell centres; zero beyond the reach, no steeper nearer than one
        step of the trail, so that finer cells do not make higher walls."""
        inner = task.grid[1:-1, 1:-1]
        out = np.zeros(task.grid.shape)
        if inner.any():
            away = np.maximum(distance_transform_edt(inner == 0) * task.problem.resolution_m, self._settings.trail_step_m)
            with np.errstate(divide="ignore"):
                steep = np.maximum(1.0 / away - 1.0 / self._settings.reach_m, 0.0)
            out[1:-1, 1:-1] = 0.5 * self._settings.repulsion_m3 * np.where(inner == 0, steep, 0.0) ** 2
        return out


def _with_attraction(repulsion: np.ndarray, step_m: float, goal_x: float, goal_y: float) -> np.ndarray:
    """The repulsion plus the distance in metres from each cell's centre to the goal."""
    rows, columns = repulsion.shape
    away = np.hypot(np.arange(columns) + 0.5 - goal_x, (np.arange(rows) + 0.5 - goal_y)[:, None])
    return repulsion + step_m * away


@compiled
def _heap(field, i, j, trail, radius):
    """Add a cone of height `trail` and this radius in cells round cell (i, j), but not to the frame."""
    rows, columns = field.shape
    reach = int(np.floor(radius))
    for b in range(max(j - reach, 1), min(j + reach + 1, rows - 1)):
        for a in range(max(i - reach, 1), min(i + reach + 1, columns - 1)):
            away = np.hypot(float(a - i), float(b - j))
            if away <= radius:
                field[b, a] += trail * (1.0 - away / (radius + 1.0))


@typed(nb.types.Tuple((NEW_POINTS, nb.boolean))(GRID, _FIELD, POINTS, nb.int64, nb.float64, nb.float64, nb.int64))
def descend(grid, field, ends, every, trail, radius, steps):
    """(N, 2) cell centres from the cell of ends[0] down the potential, leaving the trail in `field` (changed) at every
    `every`-th cell; and whether it arrived.

    8-connected without cutting corners; among equals the first in row order. Ends within half a step of the trail from
    ends[1], in sight of it, which is its cell where steps are cells; or after `steps` cells.
    """
    i, j = int(np.floor(ends[0, 0])), int(np.floor(ends[0, 1]))
    gi, gj = int(np.floor(ends[1, 0])), int(np.floor(ends[1, 1]))
    walk = np.empty((steps + 1, 2))
    walk[0, 0], walk[0, 1] = i + 0.5, j + 0.5
    for count in range(1, steps + 1):
        if max(abs(i - gi), abs(j - gj)) <= every // 2 and segment_free(grid, i + 0.5, j + 0.5, ends[1, 0], ends[1, 1]):
            return walk[:count].copy(), True
        if (count - 1) % every == 0:
            _heap(field, i, j, trail, radius)
        least, to_i, to_j = np.inf, i, j
        for b in range(j - 1, j + 2):
            for a in range(i - 1, i + 2):
                if (a == i and b == j) or grid[b, a] or grid[b, i] or grid[j, a]:
                    continue
                if field[b, a] < least:
                    least, to_i, to_j = field[b, a], a, b
        i, j = to_i, to_j
        walk[count, 0], walk[count, 1] = i + 0.5, j + 0.5
    return walk, i == gi and j == gj


def without_loops(walk: np.ndarray) -> np.ndarray:
    """The walk (N, 2) with every loop cut out: from each cell go on as after the last visit to it."""
    cells = [tuple(cell) for cell in walk]
    last = {cell: k for k, cell in enumerate(cells)}
    keep, at = [], 0
    while at < len(cells):
        at = last[cells[at]]
        keep.append(at)
        at += 1
    return walk[keep]


def _join(task: Task, cells: np.ndarray) -> np.ndarray:
    """Start, the centres between, goal: the start lies inside the first cell of the walk, the goal often in the last."""
    if np.array_equal(cells[-1], np.floor(task.goal) + 0.5):
        between = cells[1:-1]
    else:
        between = cells[1:] if len(cells) > 1 else cells
    return np.vstack([task.start, between, task.goal])
