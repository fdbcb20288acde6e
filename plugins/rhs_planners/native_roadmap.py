"""A roadmap grown by compiled code, the same method as OMPL's: uniform samples in free cells, each joined to its nearest
earlier ones in sight. PRM (Kavraki, Svestka, Latombe, Overmars 1996) takes 10 of them, as OMPL does; PRM* (Karaman and
Frazzoli 2011) e (1 + 1/2) ln n. Neighbours are found by linear search, which is quickest up to a few thousand vertices.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import typed
from rhs.estimation.paths.line import GRID, NEW_POINTS, POINTS, segment_free

from .chance import uniform
from .problem import Task
from .roadmap import Roadmap

_TRIES_PER_VERTEX = 200  # samples allowed per wanted vertex, for maps with hardly any free cell
_NEIGHBOURS = 10
_STAR = np.e * 1.5  # k of PRM* over ln n, in the plane
_PAIRS = nb.types.Array(nb.int64, 2, "C")


class NativeGrower:
    """One growing roadmap. star: PRM* instead of PRM."""

    def __init__(self, task: Task, rng: np.random.Generator, *, star: bool):
        self._rng, self._star = rng, star
        self._points, self._edges = np.empty((0, 2)), np.empty((0, 2), np.int64)

    def grow(self, grid: np.ndarray, vertices: int, *, stale: bool) -> Roadmap:
        """Add vertices; the roadmap of all edges so far. stale: cells have changed since some were found."""
        before = len(self._points)
        self._points = sample(grid, self._points, vertices, self._rng.bit_generator.random_raw())
        new = join(grid, self._points, before, 0 if self._star else _NEIGHBOURS)
        self._edges = np.concatenate([self._edges, new]) if before else new
        return Roadmap(grid, self._points, self._edges, stale=stale)


@typed(NEW_POINTS(GRID, POINTS, nb.int64, nb.uint64))
def sample(grid, points, count, seed):
    """points (N, 2) and up to `count` more in free cells, uniform over them."""
    rows, columns = grid.shape
    n, state = len(points), seed
    out = np.empty((n + count, 2))
    for k in range(n):
        out[k, 0], out[k, 1] = points[k, 0], points[k, 1]
    for _ in range(_TRIES_PER_VERTEX * count):
        state, u = uniform(state)
        state, v = uniform(state)
        x, y = 1.0 + u * (columns - 2.0), 1.0 + v * (rows - 2.0)
        if grid[int(y), int(x)] == 0:
            out[n, 0], out[n, 1] = x, y
            n += 1
            if n == len(out):
                break
    return out[:n].copy()


@typed(_PAIRS(GRID, POINTS, nb.int64, nb.int64))
def join(grid, points, first, neighbours):
    """(E, 2) free edges from each vertex k >= first to its nearest among those before it; neighbours: how many are tried,
    0 for PRM*'s number."""
    most = max(neighbours, int(np.ceil(_STAR * np.log(len(points) + 1.0))))
    edges, count = np.empty((most * (len(points) - first) + 1, 2), np.int64), 0
    near, away = np.empty(most, np.int64), np.empty(most)
    for k in range(max(first, 1), len(points)):
        wanted = min(k, neighbours if neighbours else int(np.ceil(_STAR * np.log(k + 1.0))))
        found = 0
        for other in range(k):  # the nearest so far, kept in order
            gap = (points[other, 0] - points[k, 0]) ** 2 + (points[other, 1] - points[k, 1]) ** 2
            if found == wanted and gap >= away[found - 1]:
                continue
            place = found if found < wanted else wanted - 1
            while place > 0 and away[place - 1] > gap:
                near[place], away[place] = near[place - 1], away[place - 1]
                place -= 1
            near[place], away[place] = other, gap
            found = min(found + 1, wanted)
        for place in range(found):
            other = near[place]
            if segment_free(grid, points[other, 0], points[other, 1], points[k, 0], points[k, 1]):
                edges[count, 0], edges[count, 1] = other, k
                count += 1
    return edges[:count].copy()
