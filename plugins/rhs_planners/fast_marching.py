"""Fast marching: arrival times of a wave from the goal (Sethian, "A fast marching level set method", 1996), first order,
then steepest descent from the start.

Every cell has a neighbour the wave reached earlier, so the descent cannot be trapped. Where the gradient is not usable
(beside blocked cells) the descent steps to the best neighbour cell instead. Times near the goal are exact distances,
which takes away most of the first-order error of a point source.
"""

from __future__ import annotations

import time

import numba as nb
import numpy as np
from scipy.ndimage import distance_transform_edt

from rhs.api.jit import typed
from rhs.api.records import Path
from rhs.estimation.paths.line import GRID, NEW_POINTS, POINTS, segment_free

from .heap import pop, push
from .problem import CellPlanner, Task, finish

_FIELD = nb.types.Array(nb.float64, 2, "C")
_LEVELS, _SIDE = 30, 200  # contours of a picture, and cells of a field looked at along its longer side: it shows no more
_SOURCE_CELLS = 3  # half width of the square round the goal that gets exact times


class FastMarchingPlanner(CellPlanner):
    """Settings: config.FastMarching."""

    def __init__(self, settings):
        super().__init__(settings)
        self._speed, self._version = np.empty((0, 0)), -1
        self._times, self._key = np.empty((0, 0)), None

    def solve(self, task: Task) -> Path:
        """Times from the goal, unless they are at hand; descend."""
        learning = time.process_time()
        if self._version != self._ground.version:
            self._speed, self._version = self._speeds(task), self._ground.version
        learn_ms = 1e3 * (time.process_time() - learning)
        key = (self._ground.version, *task.goal)
        i, j = int(task.start[0]), int(task.start[1])
        reused = key == self._key and np.isfinite(self._times[j, i])
        if not reused:
            self._times, self._key = arrival_times(task.grid, self._speed, task.goal[0], task.goal[1], i, j), key
        raw = None
        if np.isfinite(self._times[j, i]):
            raw = descend(task.grid, self._times, task.ends)
        return finish(task, raw, learn_ms=learn_ms, extras={"field_reused": float(reused)},
                      sketch=lambda: contours(self._times), keep_shape=self._settings.comfort_m > 0.0)  # pulling undoes it

    def _speeds(self, task: Task) -> np.ndarray:
        """(H, W) speed of the wave in cells per unit time, 1 away from walls."""
        if self._settings.comfort_m <= 0.0:
            return np.ones(task.grid.shape)
        away = distance_transform_edt(task.grid == 0) * task.problem.resolution_m
        return np.clip(away / self._settings.comfort_m, self._settings.advanced.slowest, 1.0)


@typed(nb.float64(_FIELD, nb.int64, nb.int64, nb.float64))
def _eikonal(times, i, j, slowness):
    """First-order upwind solution of |grad T| = slowness at cell (i, j)."""
    a, b = min(times[j, i - 1], times[j, i + 1]), min(times[j - 1, i], times[j + 1, i])
    if abs(a - b) >= slowness:
        return min(a, b) + slowness
    return 0.5 * (a + b + np.sqrt(2.0 * slowness * slowness - (a - b) ** 2))


@typed(_FIELD(GRID, _FIELD, nb.float64, nb.float64, nb.int64, nb.int64))
def arrival_times(grid, speed, goal_x, goal_y, until_i, until_j):
    """(H, W) arrival times of the wave from the goal, inf where it has not come before it passed cell (until_i, until_j)."""
    rows, columns = grid.shape
    times, settled = np.full((rows, columns), np.inf), np.zeros((rows, columns), np.uint8)
    keys, items = np.empty(1024), np.empty(1024, np.int64)
    size, gi, gj = 0, int(goal_x), int(goal_y)
    for j in range(max(gj - _SOURCE_CELLS, 0), min(gj + _SOURCE_CELLS + 1, rows)):
        for i in range(max(gi - _SOURCE_CELLS, 0), min(gi + _SOURCE_CELLS + 1, columns)):
            if segment_free(grid, goal_x, goal_y, i + 0.5, j + 0.5):
                times[j, i] = np.hypot(i + 0.5 - goal_x, j + 0.5 - goal_y) / min(speed[j, i], speed[gj, gi])
                size = push(keys, items, size, times[j, i], j * columns + i)
    last = np.inf
    while size:
        u = items[0]
        size = pop(keys, items, size)
        i, j = u % columns, u // columns
        if settled[j, i]:
            continue
        settled[j, i] = 1
        if times[j, i] > last:
            break
        if i == until_i and j == until_j:
            last = times[j, i] + 2.0 / speed[j, i]  # a margin, so that the descent finds neighbours on all sides
        if size + 4 > len(keys):
            keys, items = np.append(keys, np.empty(len(keys))), np.append(items, np.empty(len(items), np.int64))
        for k in range(4):
            a, b = i + (k == 0) - (k == 1), j + (k == 2) - (k == 3)
            if grid[b, a] or settled[b, a]:
                continue
            arrival = _eikonal(times, a, b, 1.0 / speed[b, a])
            if arrival < times[b, a]:
                times[b, a] = arrival
                size = push(keys, items, size, arrival, b * columns + a)
    return times


@typed(nb.types.UniTuple(nb.float64, 2)(_FIELD, nb.float64, nb.float64))
def _gradient(times, x, y):
    """Gradient of the bilinear surface through the four cell centres round (x, y); NaN beside cells without a time."""
    i, j = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    u, v = x - 0.5 - i, y - 0.5 - j
    a, b, c, d = times[j, i], times[j, i + 1], times[j + 1, i], times[j + 1, i + 1]
    if not np.isfinite(a + b + c + d):
        return np.nan, np.nan
    return (b - a) * (1.0 - v) + (d - c) * v, (c - a) * (1.0 - u) + (d - b) * u


@typed(nb.types.UniTuple(nb.int64, 2)(GRID, _FIELD, nb.int64, nb.int64))
def _steepest(grid, times, i, j):
    """The neighbour cell with the steepest fall of time per distance, corners not cut; itself if none falls."""
    best, to_i, to_j = 0.0, i, j
    for b in range(j - 1, j + 2):
        for a in range(i - 1, i + 2):
            if (a == i and b == j) or grid[b, a] or grid[b, i] or grid[j, a]:
                continue
            fall = (times[j, i] - times[b, a]) / np.hypot(float(a - i), float(b - j))
            if fall > best:
                best, to_i, to_j = fall, a, b
    return to_i, to_j


@typed(NEW_POINTS(GRID, _FIELD, POINTS))
def descend(grid, times, ends):
    """(N, 2) points from ends[0] down the times to ends[1], half a cell at a time.

    A gradient step must go to a cell whose time is not later than the one it leaves; else the step goes to the steepest
    neighbour's centre, whose time is earlier. So the time of the cell never rises, and the walk ends.
    """
    rows, columns = grid.shape
    out = np.empty((4096, 2))
    out[0] = ends[0]
    count, x, y, idle = 1, ends[0, 0], ends[0, 1], 0
    gx, gy = ends[1]
    while not (np.hypot(gx - x, gy - y) <= 1.5 and segment_free(grid, x, y, gx, gy)):
        i, j = int(x), int(y)
        dx, dy = _gradient(times, x, y)
        slope = np.hypot(dx, dy)
        nx, ny = x - 0.5 * dx / slope, y - 0.5 * dy / slope
        moved = slope > 0.0 and segment_free(grid, x, y, nx, ny) and times[int(ny), int(nx)] <= times[j, i]
        same = moved and int(nx) == i and int(ny) == j
        idle = idle + 1 if same else 0
        if not moved or idle > 4:
            a, b = _steepest(grid, times, i, j)
            if a == i and b == j:
                a, b = int(gx), int(gy)
            nx, ny, idle = a + 0.5, b + 0.5, 0
        if count + 1 == len(out):
            out = np.concatenate((out, np.empty_like(out)))
        x, y = nx, ny
        out[count, 0], out[count, 1] = x, y
        count += 1
    out[count] = ends[1]
    return out[: count + 1].copy()


def contours(field: np.ndarray) -> np.ndarray:
    """(E, 2, 2) cells: contour lines of a field (H, W) between cell centres, for a picture; where it is infinite there are
    none."""
    from contourpy import contour_generator

    every = max(1, max(field.shape) // _SIDE)
    seen = np.ma.masked_invalid(field[::every, ::every])
    if not seen.count() or min(seen.shape) < 2:
        return np.empty((0, 2, 2))
    generator = contour_generator(z=seen, line_type="Separate")
    levels = np.linspace(seen.min(), seen.max(), _LEVELS + 2)[1:-1]
    lines = [np.asarray(line, float) for level in levels for line in generator.lines(level)]
    pieces = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
    return np.concatenate([*pieces, np.empty((0, 2, 2))]) * every + 0.5
