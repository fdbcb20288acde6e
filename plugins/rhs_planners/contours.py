"""The contours of a field, as lines for a picture."""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import compiled, typed

_LEVELS = 30  # contours from the least to the largest value
_SIDE = 200  # cells of a field looked at along its longer side: a picture shows no more
_LINES = nb.types.Array(nb.float64, 3, "C")


def contours(field: np.ndarray) -> np.ndarray:
    """(E, 2, 2) cells: contour lines of a field (H, W) between cell centres; where it is infinite there are none."""
    every = max(1, max(field.shape) // _SIDE)
    seen = np.ascontiguousarray(field[::every, ::every])
    finite = seen[np.isfinite(seen)]
    if not len(finite):
        return np.empty((0, 2, 2))
    least, step = float(finite.min()), float(finite.max() - finite.min()) / (_LEVELS + 1)
    return _trace(seen, least, step) * every + 0.5 if step > 0.0 else np.empty((0, 2, 2))


@compiled
def _cross(line, i, j, level, triangle):
    """1, and the ends of the line (2, 2) on which a triangle of (x, y, value) over square (i, j) has the level; or 0."""
    found = 0
    for side in range(3):
        (px, py, p), (qx, qy, q) = triangle[side], triangle[(side + 1) % 3]
        if (p <= level) != (q <= level) and found < 2:
            share = (level - p) / (q - p)
            line[found, 0], line[found, 1] = i + px + share * (qx - px), j + py + share * (qy - py)
            found += 1
    return 1 if found == 2 else 0


@typed(_LINES(nb.types.Array(nb.float64, 2, "C"), nb.float64, nb.float64))
def _trace(field, least, step):
    """Marching triangles: both triangles of every square of four values are crossed by a level in two sides or none.
    The levels are least + step, least + 2 step, ..."""
    rows, columns = field.shape
    out, count = np.empty((4096, 2, 2)), 0
    for j in range(rows - 1):
        for i in range(columns - 1):
            a, b, c, d = field[j, i], field[j, i + 1], field[j + 1, i + 1], field[j + 1, i]
            low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
            if not np.isfinite(high):
                continue
            for k in range(max(1, int(np.ceil((low - least) / step))), int(np.ceil((high - least) / step))):
                level = least + k * step
                if count + 2 > len(out):
                    out = np.concatenate((out, np.empty_like(out)))
                corners = ((0.0, 0.0, a), (1.0, 0.0, b), (1.0, 1.0, c), (0.0, 1.0, d))
                count += _cross(out[count], i, j, level, (corners[0], corners[1], corners[2]))
                count += _cross(out[count], i, j, level, (corners[0], corners[2], corners[3]))
    return out[:count].copy()
