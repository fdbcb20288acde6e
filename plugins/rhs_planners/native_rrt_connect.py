"""RRT-Connect compiled whole (Kuffner and LaValle, "RRT-Connect: an efficient approach to single-query path planning",
ICRA 2000), for a point on a grid. The method is OMPL's; the difference is that nothing crosses into Python before the
trees have met. Nearest neighbours are found by linear search, which is quickest for a few hundred vertices, and among the
vertices of the squares round the sample when there are more.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from rhs.api.jit import compiled, typed
from rhs.api.records import Path
from rhs.estimation.paths.line import GRID, NEW_POINTS, POINTS, segment_free

from .chance import uniform
from .problem import CellPlanner, Task, already_there, finish

_FIRST_ROOM = 256  # vertices a tree has room for at first
_MANY = 500  # vertices from which on looking into squares is quicker
_SQUARE = 16  # cells a side


class NativeRrtConnect(CellPlanner):
    """Settings: config.RrtConnect."""

    def __init__(self, settings, rng: np.random.Generator):
        super().__init__(settings)
        self._rng = rng

    def solve(self, task: Task) -> Path:
        there = already_there(task)
        if there is not None:
            return finish(task, there, extras={"iterations": 0.0})
        step = self._settings.range_m / task.problem.resolution_m or 0.2 * math.hypot(*task.problem.blocked.shape)
        seed = self._rng.bit_generator.random_raw()
        rounds = self._settings.rounds(task.ground.free_cells)
        raw, edges, used = connect(task.grid, task.ends, seed, step, rounds[0])
        if not len(raw) and len(rounds) > 1 and task.ground.connected(task.start, task.goal):
            raw, edges, used = connect(task.grid, task.ends, seed, step, sum(rounds))  # the same trees, grown on
        extras = {"iterations": float(used), "vertices": len(edges) + 2.0}
        return finish(task, raw if len(raw) else None, extras=extras,
                      knob=self._settings.knob(rounds), sketch=lambda: edges)


@compiled
def _room(trees, parents, nexts, sizes):
    """The arrays, twice as long when one tree has filled them."""
    if max(sizes) < len(trees):
        return trees, parents, nexts
    longer, up, after = np.empty((2 * len(trees), 4)), np.full((2, 2 * len(trees)), -1), np.full((2, 2 * len(trees)), -1)
    longer[: len(trees)] = trees
    up[:, : len(trees)] = parents
    after[:, : len(trees)] = nexts
    return longer, up, after


@compiled
def _add(trees, parents, squares, sizes, which, x, y, parent):
    """A new vertex, put into the list of its square; its number."""
    heads, nexts = squares
    new = sizes[which]
    trees[new, 2 * which], trees[new, 2 * which + 1] = x, y
    parents[which, new] = parent
    j, i = int(y) // _SQUARE, int(x) // _SQUARE
    nexts[which, new] = heads[which, j, i]
    heads[which, j, i] = new
    sizes[which] = new + 1
    return new


@compiled
def _nearest(trees, squares, sizes, which, x, y):
    """The vertex nearest to (x, y), the first among equals, and its distance squared."""
    nearest, least = -1, np.inf
    if sizes[which] < _MANY:
        for k in range(sizes[which]):
            away = (trees[k, 2 * which] - x) ** 2 + (trees[k, 2 * which + 1] - y) ** 2
            if away < least:
                nearest, least = k, away
        return nearest, least
    heads, nexts = squares
    rows, columns = heads.shape[1:]
    j, i = int(y) // _SQUARE, int(x) // _SQUARE
    for ring in range(max(rows, columns)):
        for b in range(max(j - ring, 0), min(j + ring + 1, rows)):
            stride = 1 if abs(b - j) == ring else 2 * ring  # whole rows above and below, two squares of those between
            for a in range(i - ring, i + ring + 1, max(stride, 1)):
                k = heads[which, b, a] if 0 <= a < columns else -1
                while k >= 0:
                    away = (trees[k, 2 * which] - x) ** 2 + (trees[k, 2 * which + 1] - y) ** 2
                    if away < least or (away == least and k < nearest):
                        nearest, least = k, away
                    k = nexts[which, k]
        if least <= (ring * _SQUARE) ** 2:  # what lies in the next ring is farther
            break
    return nearest, least


@compiled
def _extend(grid, trees, parents, squares, sizes, which, x, y, step):
    """One edge of at most `step` from the nearest vertex towards (x, y); the new vertex, or -1 when stopped."""
    nearest, least = _nearest(trees, squares, sizes, which, x, y)
    fx, fy = trees[nearest, 2 * which], trees[nearest, 2 * which + 1]
    share = min(1.0, step / np.sqrt(least)) if least > 0.0 else 1.0
    if share < 1.0:
        x, y = fx + share * (x - fx), fy + share * (y - fy)
    if least == 0.0 or not segment_free(grid, fx, fy, x, y):
        return -1
    return _add(trees, parents, squares, sizes, which, x, y, nearest)


@compiled
def _joined(trees, parents, tips):
    """(N, 2) from the root of the first tree to where they meet and on to the root of the second."""
    counts = [0, 0]
    for which in range(2):
        node = tips[which]
        while node >= 0:
            node = parents[which, node]
            counts[which] += 1
    path = np.empty((counts[0] + counts[1] - 1, 2))  # the point where they meet is in both
    for which in range(2):
        node, at = tips[which], counts[0] - 1
        while node >= 0:
            path[at, 0], path[at, 1] = trees[node, 2 * which], trees[node, 2 * which + 1]
            node = parents[which, node]
            at += 2 * which - 1
    return path


@compiled
def _edges(trees, parents, sizes):
    """(E, 2, 2) every edge of both trees, for pictures."""
    edges = np.empty((sizes[0] + sizes[1] - 2, 2, 2))
    count = 0
    for which in range(2):
        for k in range(1, sizes[which]):
            up = parents[which, k]
            edges[count, 0, 0], edges[count, 0, 1] = trees[k, 2 * which], trees[k, 2 * which + 1]
            edges[count, 1, 0], edges[count, 1, 1] = trees[up, 2 * which], trees[up, 2 * which + 1]
            count += 1
    return edges


_RESULT = nb.types.Tuple((NEW_POINTS, nb.types.Array(nb.float64, 3, "C"), nb.int64))


@typed(_RESULT(GRID, POINTS, nb.uint64, nb.float64, nb.int64))
def connect(grid, ends, seed, step, budget):
    """Two trees from ends (2, 2), turn about, until they meet or `budget` samples are spent.

    Returns the path (N, 2), empty for none, all edges (E, 2, 2), and the samples used.
    """
    rows, columns = grid.shape
    trees, parents, nexts = np.empty((_FIRST_ROOM, 4)), np.full((2, _FIRST_ROOM), -1), np.full((2, _FIRST_ROOM), -1)
    heads = np.full((2, rows // _SQUARE + 1, columns // _SQUARE + 1), -1)
    sizes, tips, state = np.zeros(2, np.int64), np.full(2, -1), seed
    for which in range(2):
        _add(trees, parents, (heads, nexts), sizes, which, ends[which, 0], ends[which, 1], -1)
    for k in range(budget):
        near, far = k % 2, 1 - k % 2
        state, u = uniform(state)
        state, v = uniform(state)
        trees, parents, nexts = _room(trees, parents, nexts, sizes)
        x, y = 1.0 + u * (columns - 2.0), 1.0 + v * (rows - 2.0)
        new = _extend(grid, trees, parents, (heads, nexts), sizes, near, x, y, step)
        if new < 0:
            continue
        x, y = trees[new, 2 * near], trees[new, 2 * near + 1]
        while True:  # connect: the other tree comes nearer in steps until it arrives or is stopped
            trees, parents, nexts = _room(trees, parents, nexts, sizes)
            other = _extend(grid, trees, parents, (heads, nexts), sizes, far, x, y, step)
            if other < 0:
                break
            if trees[other, 2 * far] == x and trees[other, 2 * far + 1] == y:
                tips[near], tips[far] = new, other
                return _joined(trees, parents, tips), _edges(trees, parents, sizes), k + 1
    return np.empty((0, 2)), _edges(trees, parents, sizes), budget
