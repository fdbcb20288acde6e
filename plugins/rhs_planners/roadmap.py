"""A roadmap that outlives its map's changes: vertices, edges, which edges are open now, and A* over it."""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import typed
from rhs.estimation.paths.line import GRID, POINTS, segment_free

from .heap import pop, push

_INTS = nb.types.Array(nb.int64, 1, "C", readonly=True)
_PAIRS = nb.types.Array(nb.int64, 2, "C", readonly=True)
_FLAGS = nb.types.Array(nb.uint8, 1, "C")
_OUT = nb.types.Array(nb.int64, 1, "C")
_POINT = nb.types.Array(nb.float64, 1, "C", readonly=True)
_PAIR = nb.types.UniTuple


class Roadmap:
    """Vertices (V, 2) in padded cells and undirected edges (E, 2). Edges cut by an obstacle are kept and may return.

    stale: some were found on another grid and must be tested again.
    """

    def __init__(self, grid: np.ndarray, points: np.ndarray, edges: np.ndarray, *, stale: bool = False):
        self.points, self.edges = points, np.ascontiguousarray(edges, dtype=np.int64)
        self._seen = grid.copy()
        self._open = np.ones(len(self.edges), np.uint8)
        if stale:
            self._mend_box(grid, (0, 0, grid.shape[1], grid.shape[0]))
        self._index()

    def mend(self, grid: np.ndarray) -> tuple[int, int]:
        """Look again at the edges near changed cells of a grid of the same shape; (cut, restored) edges."""
        rows, columns = np.nonzero(self._seen != grid)
        if not len(rows):
            return 0, 0
        before = self._open.copy()
        self._mend_box(grid, (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1))
        self._seen = grid.copy()
        return int((before & ~self._open & 1).sum()), int((self._open & ~before & 1).sum())

    def changed_share(self, grid: np.ndarray) -> float:
        """Share of cells that differ from the grid last seen; 1 for another shape."""
        return float(np.mean(self._seen != grid)) if self._seen.shape == grid.shape else 1.0

    def query(self, grid: np.ndarray, start: np.ndarray, goal: np.ndarray, *, links: int) -> np.ndarray | None:
        """(N, 2) cells of the shortest way over open edges, joining both ends to `links` vertices in sight."""
        if not len(self.points):
            return None
        from_start = _in_sight(grid, self.points, _order(self.points, start), start, links)
        to_goal = _in_sight(grid, self.points, _order(self.points, goal), goal, links)
        chain = _search(self.points, self._offsets, self._others, self._numbers, self._open, (start, goal),
                        (from_start, to_goal))
        return np.vstack([start, self.points[chain], goal]) if len(chain) else None

    def segments(self) -> np.ndarray:
        """(E, 2, 2) cells of the open edges, for pictures."""
        return self.points[self.edges[self._open.astype(bool)]]

    def _mend_box(self, grid, box) -> None:
        _recheck(grid, self.points, self.edges, self._open, np.asarray(box, float))

    def _index(self) -> None:
        """Neighbour lists: vertex v has others[offsets[v]:offsets[v + 1]], reached over edge numbers[...]."""
        ends = np.concatenate([self.edges, self.edges[:, ::-1]])
        number = np.tile(np.arange(len(self.edges)), 2)
        order = np.argsort(ends[:, 0], kind="stable")
        counts = np.bincount(ends[:, 0], minlength=len(self.points))
        self._offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self._others, self._numbers = ends[order, 1].astype(np.int64), number[order].astype(np.int64)


def _order(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    return np.argsort(((points - at) ** 2).sum(axis=1), kind="stable")


@typed(nb.void(GRID, POINTS, _PAIRS, _FLAGS, nb.types.Array(nb.float64, 1, "C")))
def _recheck(grid, points, edges, open_, box):
    """Test again every edge whose bounding box meets box = (x0, y0, x1, y1) cells."""
    for e in range(len(edges)):
        ax, ay = points[edges[e, 0]]
        bx, by = points[edges[e, 1]]
        if max(ax, bx) < box[0] or min(ax, bx) > box[2] or max(ay, by) < box[1] or min(ay, by) > box[3]:
            continue
        open_[e] = segment_free(grid, ax, ay, bx, by)


@typed(_OUT(GRID, POINTS, _INTS, _POINT, nb.int64))
def _in_sight(grid, points, order, at, limit):
    """The first `limit` vertices of `order` that are in sight of `at`."""
    out = np.empty(min(limit, len(order)), np.int64)
    count = 0
    for v in order:
        if count == len(out):
            break
        if segment_free(grid, at[0], at[1], points[v, 0], points[v, 1]):
            out[count] = v
            count += 1
    return out[:count].copy()


@typed(_OUT(POINTS, _INTS, _INTS, _INTS, _FLAGS, _PAIR(_POINT, 2), _PAIR(_OUT, 2)))
def _search(points, offsets, others, numbers, open_, ends, links):
    """A* from ends[0] over links[0], open edges and links[1] to ends[1]; the vertices passed, in order."""
    (start, goal), (from_start, to_goal) = ends, links
    n = len(points)
    cost, parent, last = np.empty(n), np.empty(n, np.int64), np.empty(n)  # last: from a vertex joined to the goal
    for v in range(n):  # np.full takes a quarter of a second to compile
        cost[v], parent[v], last[v] = np.inf, -1, np.inf
    keys, items = np.empty(len(others) + n + 1), np.empty(len(others) + n + 1, np.int64)
    size, best, best_at = 0, np.inf, -1
    for v in to_goal:
        last[v] = np.hypot(points[v, 0] - goal[0], points[v, 1] - goal[1])
    for v in from_start:
        cost[v] = np.hypot(points[v, 0] - start[0], points[v, 1] - start[1])
        ahead = np.hypot(points[v, 0] - goal[0], points[v, 1] - goal[1])
        size = push(keys, items, size, cost[v] + ahead, v)
    while size and keys[0] < best:
        key, u = keys[0], items[0]
        size = pop(keys, items, size)
        ahead = np.hypot(points[u, 0] - goal[0], points[u, 1] - goal[1])
        if key > cost[u] + ahead + 1e-12:
            continue  # an entry made before a shorter way to u was found
        if cost[u] + last[u] < best:
            best, best_at = cost[u] + last[u], u
        for k in range(offsets[u], offsets[u + 1]):
            v = others[k]
            if not open_[numbers[k]]:
                continue
            through = cost[u] + np.hypot(points[v, 0] - points[u, 0], points[v, 1] - points[u, 1])
            if through < cost[v]:
                cost[v], parent[v] = through, u
                ahead = np.hypot(points[v, 0] - goal[0], points[v, 1] - goal[1])
                size = push(keys, items, size, through + ahead, v)
    count, node = 0, best_at
    while node >= 0:
        count, node = count + 1, parent[node]
    chain = np.empty(count, np.int64)
    node = best_at
    for k in range(count - 1, -1, -1):
        chain[k], node = node, parent[node]
    return chain
