"""A* and Theta* over cells, eight neighbours, corners never cut. Deterministic: ties go to the lower cell number.

Theta* is the basic form of Nash et al. (2007): a cell takes its predecessor's predecessor when that is in sight.
Start and goal stand where they are within their cells; all other points are cell centres.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import typed
from rhs.api.records import Path
from rhs.estimation.paths.line import GRID, NEW_POINTS, POINTS, segment_free

from .heap import pop, push
from .problem import CellPlanner, Task, finish

_BRANCHES = 4000  # of the tree of predecessors that a picture shows
_DIAGONAL = np.sqrt(2.0) - 1.0
_RESULT = nb.types.Tuple((NEW_POINTS, nb.int64, nb.types.Array(nb.int64, 1, "C")))


class GridSearch(CellPlanner):
    """Settings: config.AStar or ThetaStar."""

    def solve(self, task: Task) -> Path:
        cells, expanded, parent = search(task.grid, task.ends, self._settings.expansions, self._settings.any_angle)
        raw = cells if len(cells) else None
        return finish(task, raw, extras={"expanded": float(expanded)},
                      knob=("expansions", self._settings.expansions), sketch=lambda: branches(parent, task.grid.shape[1]))


def branches(parent: np.ndarray, columns: int) -> np.ndarray:
    """(E, 2, 2) cells: from a cell's centre to its predecessor's. parent: cell numbers, -1 where nobody came."""
    reached = np.flatnonzero(parent >= 0)
    reached = reached[:: max(1, len(reached) // _BRANCHES)]
    ends = np.stack([reached, parent[reached]], axis=1)
    return np.stack([ends % columns + 0.5, ends // columns + 0.5], axis=-1)


@typed(nb.float64(nb.int64, nb.int64, nb.int64, nb.int64))
def octile(i, j, k, m):
    """Least cost in cells from cell (i, j) to (k, m) over free eight-connected cells."""
    dx, dy = abs(i - k), abs(j - m)
    return max(dx, dy) + _DIAGONAL * min(dx, dy)


@typed(NEW_POINTS(nb.types.Array(nb.int64, 1, "C"), nb.int64, nb.int64, POINTS))
def _trace(parent, last, columns, ends):
    """Points from start to goal along parents; the ends exact, centres between."""
    count, node = 1, last
    while parent[node] != node:
        count, node = count + 1, parent[node]
    count = max(count, 2)
    out = np.empty((count, 2))
    node = last
    for k in range(count - 1, -1, -1):
        out[k, 0], out[k, 1] = node % columns + 0.5, node // columns + 0.5
        node = parent[node]
    out[0], out[count - 1] = ends[0], ends[1]
    return out


@typed(nb.types.UniTuple(nb.float64, 2)(nb.int64, nb.int64, nb.int64, nb.int64, POINTS))
def _place(node, columns, start, goal, ends):
    """Where a node stands: the start and the goal where they are, other cells at their centre."""
    if node == start:
        return ends[0, 0], ends[0, 1]
    if node == goal:
        return ends[1, 0], ends[1, 1]
    return node % columns + 0.5, node // columns + 0.5


@typed(_RESULT(GRID, POINTS, nb.int64, nb.boolean))
def search(grid, ends, budget, any_angle):
    """A* with the octile distance between the cells of ends (2, 2); any_angle: Theta* with the straight distance between the
    points themselves. The path (N, 2) in cells, empty for none, the number of cells taken up, every cell's predecessor."""
    rows, columns = grid.shape
    cost, parent = np.full(rows * columns, np.inf), np.full(rows * columns, -1)
    closed = np.zeros(rows * columns, np.uint8)
    keys, items = np.empty(256), np.empty(256, np.int64)
    gi, gj = int(ends[1, 0]), int(ends[1, 1])
    start, goal = int(ends[0, 1]) * columns + int(ends[0, 0]), gj * columns + gi
    cost[start], parent[start] = 0.0, start
    size, expanded = push(keys, items, 0, 0.0, start), 0
    while size and expanded < budget:
        u = items[0]
        size = pop(keys, items, size)
        if closed[u]:
            continue
        closed[u] = 1
        expanded += 1
        if u == goal:
            return _trace(parent, u, columns, ends), expanded, parent
        i, j, above = u % columns, u // columns, parent[u]
        ux, uy = _place(u, columns, start, goal, ends)
        px, py = _place(above, columns, start, goal, ends)
        if size + 8 > len(keys):
            keys, items = np.append(keys, np.empty(len(keys))), np.append(items, np.empty(len(items), np.int64))
        for b in range(j - 1, j + 2):
            for a in range(i - 1, i + 2):
                v = b * columns + a
                if grid[b, a] or closed[v] or grid[b, i] or grid[j, a]:
                    continue
                via = u
                if any_angle:
                    vx, vy = _place(v, columns, start, goal, ends)
                    left = np.hypot(vx - ends[1, 0], vy - ends[1, 1])
                    through = cost[above] + np.hypot(vx - px, vy - py)
                    if through < cost[v] and segment_free(grid, px, py, vx, vy):
                        via = above
                    else:
                        through = cost[u] + np.hypot(vx - ux, vy - uy)
                else:
                    left = octile(a, b, gi, gj)
                    through = cost[u] + (1.0 if a == i or b == j else 1.0 + _DIAGONAL)
                if through < cost[v]:
                    cost[v], parent[v] = through, via
                    size = push(keys, items, size, through + left, v)
    return np.empty((0, 2)), expanded, parent
