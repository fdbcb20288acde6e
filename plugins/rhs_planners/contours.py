"""What a grid planner searched, as lines for a picture: the tree of predecessors, or the contours of a field."""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.jit import typed

_LEVELS = 30  # contours from the least to the largest value
_SIDE = 400  # cells of a field looked at along its longer side: a picture shows no more
_BRANCHES = 4000
_LINES = nb.types.Array(nb.float64, 3, "C")


def branches(parent: np.ndarray, columns: int) -> np.ndarray:
    """(E, 2, 2) cells: from a cell's centre to its predecessor's. parent: cell numbers, -1 where nobody came."""
    reached = np.flatnonzero(parent >= 0)
    reached = reached[:: max(1, len(reached) // _BRANCHES)]
    ends = np.stack([reached, parent[reached]], axis=1)
    return np.stack([ends % columns + 0.5, ends // columns + 0.5], axis=-1)


def contours(field: np.ndarray) -> np.ndarray:
    """(E, 2, 2) cells: contour lines of a field (H, W) between cell centres; where it is infinite there are none."""
    every = max(1, max(field.shape) // _SIDE)
    seen = np.ascontiguousarray(field[::every, ::every])
    finite = seen[np.isfinite(seen)]
    if not len(finite):
        return np.empty((0, 2, 2))
    levels = np.linspace(finite.min(), finite.max(), _LEVELS + 2)[1:-1]
    return _trace(seen, levels) * every + 0.5


@typed(_LINES(nb.types.Array(nb.float64, 2, "C"), nb.types.Array(nb.float64, 1, "C")))
def _trace(field, levels):
    """Marching triangles: both triangles of every square of four values are crossed by a level in two sides or none."""
    rows, columns = field.shape
    out, count = np.empty((1024, 2, 2)), 0
    x, y, value = np.empty(4), np.empty(4), np.empty(4)
    for j in range(rows - 1):
        for i in range(columns - 1):
            for k in range(4):  # lower left, lower right, upper right, upper left
                x[k], y[k] = i + (k == 1 or k == 2), j + (k >= 2)
                value[k] = field[int(y[k]), int(x[k])]
            if not np.isfinite(value.sum()):
                continue
            for level in levels:
                if level < value.min() or level >= value.max():
                    continue
                for triangle in ((0, 1, 2), (0, 2, 3)):
                    found = 0
                    if count == len(out):
                        out = np.concatenate((out, np.empty_like(out)))
                    for side in range(3):
                        a, b = triangle[side], triangle[(side + 1) % 3]
                        if (value[a] <= level) != (value[b] <= level) and found < 2:
                            share = (level - value[a]) / (value[b] - value[a])
                            out[count, found, 0] = x[a] + share * (x[b] - x[a])
                            out[count, found, 1] = y[a] + share * (y[b] - y[a])
                            found += 1
                    count += found == 2
    return out[:count].copy()
