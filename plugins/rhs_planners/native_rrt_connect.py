"""RRT-Connect compiled whole (Kuffner and LaValle, "RRT-Connect: an efficient approach to single-query path planning",
ICRA 2000), for a point on a grid. The method is OMPL's; the difference is that no edge crosses into Python.
Nearest neighbours are found by linear search, which is quickest for the few hundred vertices a tree needs here.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.jit import compiled, typed
from rhs.records import Path, PlanningProblem

from .line import GRID, NEW_POINTS, POINTS, segment_free
from .problem import Ground, already_there, begin, finish

_DRAWS = 128  # samples drawn at a time
_INTS = nb.types.Array(nb.int64, 1, "C")
_PARENTS = nb.types.Array(nb.int64, 2, "C")


class NativeRrtConnect:
    """rhs.contracts.Planner. Settings: rrt_config.RrtConnect."""

    def __init__(self, settings, rng: np.random.Generator):
        self._settings, self._rng, self._ground = settings, rng, Ground()

    def plan(self, problem: PlanningProblem) -> Path:
        task = begin(problem, self._ground, self._settings.start_radius_m)
        if isinstance(task, Path):
            return task
        there = already_there(task)
        if there is not None:
            return finish(task, there, rounds=0, extras={"iterations": 0.0})
        step = self._settings.range_m / problem.resolution_m or 0.2 * float(np.hypot(*problem.blocked.shape))
        trees, parents = np.empty((256, 4)), np.full((2, 256), -1)
        trees[0, :2], trees[0, 2:] = task.start, task.goal
        sizes, tips, used = np.ones(2, np.int64), np.full(2, -1), 0
        while used < self._settings.iterations and tips[0] < 0:
            draws = self._rng.random((min(_DRAWS, self._settings.iterations - used), 2))
            trees, parents, taken = grow(task.grid, trees, parents, sizes, tips, draws, step, used)
            used += taken
        raw = None
        if tips[0] >= 0:
            there = _branch(trees[:, :2].copy(), parents[0], tips[0])
            raw = np.vstack([there[::-1], _branch(trees[:, 2:].copy(), parents[1], tips[1])[1:]])

        def sketch() -> np.ndarray:
            halves = [(trees[:n, 2 * k: 2 * k + 2], parents[k, :n]) for k, n in enumerate(sizes)]
            return np.concatenate([np.stack([points[1:], points[up[1:]]], axis=1) for points, up in halves])

        extras = {"iterations": float(used), "vertices": float(sizes.sum())}
        return finish(task, raw, rounds=self._settings.shorten_rounds, extras=extras, sketch=sketch)


@compiled
def _room(trees, parents, sizes):
    """The arrays, twice as long when one tree has filled them."""
    if max(sizes) < len(trees):
        return trees, parents
    longer, up = np.empty((2 * len(trees), 4)), np.full((2, 2 * len(trees)), -1)
    longer[: len(trees)] = trees
    up[:, : len(trees)] = parents
    return longer, up


@compiled
def _extend(grid, trees, parents, sizes, which, x, y, step):
    """One edge of at most `step` from the nearest vertex towards (x, y); the new vertex, or -1 when stopped."""
    nearest, least = 0, np.inf
    for k in range(sizes[which]):
        away = (trees[k, 2 * which] - x) ** 2 + (trees[k, 2 * which + 1] - y) ** 2
        if away < least:
            nearest, least = k, away
    fx, fy = trees[nearest, 2 * which], trees[nearest, 2 * which + 1]
    share = min(1.0, step / np.sqrt(least)) if least > 0.0 else 1.0
    if share < 1.0:
        x, y = fx + share * (x - fx), fy + share * (y - fy)
    if least == 0.0 or not segment_free(grid, fx, fy, x, y):
        return -1
    new = sizes[which]
    trees[new, 2 * which], trees[new, 2 * which + 1] = x, y
    parents[which, new] = nearest
    sizes[which] = new + 1
    return new


_RESULT = nb.types.Tuple((NEW_POINTS, _PARENTS, nb.int64))


@typed(_RESULT(GRID, NEW_POINTS, _PARENTS, _INTS, _INTS, POINTS, nb.float64, nb.int64))
def grow(grid, trees, parents, sizes, tips, draws, step, before):
    """Two trees, turn about, until they meet or the samples `draws` (N, 2) in [0, 1) are spent.

    trees (M, 4): x, y of either tree side by side; parents (2, M); sizes (2,) and tips (2,), the vertices where they
    meet or -1, are changed in place. before: samples used earlier, which says whose turn it is.
    Returns trees and parents, which may have moved to longer arrays, and the samples used.
    """
    rows, columns = grid.shape
    for k in range(len(draws)):
        near = (before + k) % 2
        x, y = 1.0 + draws[k, 0] * (columns - 2.0), 1.0 + draws[k, 1] * (rows - 2.0)
        trees, parents = _room(trees, parents, sizes)
        new = _extend(grid, trees, parents, sizes, near, x, y, step)
        if new < 0:
            continue
        x, y = trees[new, 2 * near], trees[new, 2 * near + 1]
        far = 1 - near
        while True:  # connect: the other tree comes nearer in steps until it arrives or is stopped
            trees, parents = _room(trees, parents, sizes)
            other = _extend(grid, trees, parents, sizes, far, x, y, step)
            if other < 0:
                break
            if trees[other, 2 * far] == x and trees[other, 2 * far + 1] == y:
                tips[near], tips[far] = new, other
                return trees, parents, k + 1
    return trees, parents, len(draws)


def _branch(points: np.ndarray, parents: np.ndarray, tip: int) -> np.ndarray:
    """(N, 2) from the tip to the root."""
    out = []
    while tip >= 0:
        out.append(points[tip])
        tip = parents[tip]
    return np.array(out)
