"""Is a straight line free? Exact walk from cell to cell (Amanatides and Woo, "A fast voxel traversal algorithm", 1987).

Coordinates are cells of a grid with a blocked border, cell (i, j) covering [i, i+1) x [j, j+1); both ends must lie on
the grid. Every cell the line enters must be free; where it goes exactly through a corner, both cells beside it must be
free too, so that a path never slips between two blocked cells.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numba.core import types

from rhs.api.jit import typed

GRID = types.Array(types.uint8, 2, "C", readonly=True)
POINTS = types.Array(types.float64, 2, "C", readonly=True)
NEW_POINTS = types.Array(types.float64, 2, "C")


@typed(nb.boolean(GRID, nb.float64, nb.float64, nb.float64, nb.float64))
def segment_free(grid: np.ndarray, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Every cell entered on the way from (x0, y0) to (x1, y1) is free; the same answer for the way back."""
    if x0 > x1 or (x0 == x1 and y0 > y1):
        x0, y0, x1, y1 = x1, y1, x0, y0
    i, j = int(np.floor(x0)), int(np.floor(y0))
    if grid[j, i]:
        return False
    steps_x, steps_y = abs(int(np.floor(x1)) - i), abs(int(np.floor(y1)) - j)
    dx, dy = x1 - x0, y1 - y0
    sign_x, sign_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    per_x = 1.0 / abs(dx) if steps_x else np.inf
    per_y = 1.0 / abs(dy) if steps_y else np.inf
    next_x = ((i + 1 - x0) if dx > 0 else (x0 - i)) * per_x if steps_x else np.inf
    next_y = ((j + 1 - y0) if dy > 0 else (y0 - j)) * per_y if steps_y else np.inf
    while steps_x or steps_y:
        if next_x == next_y and (grid[j, i + sign_x] or grid[j + sign_y, i]):
            return False
        if next_x <= next_y:
            i += sign_x
            steps_x -= 1
            next_x = next_x + per_x if steps_x else np.inf
        else:
            j += sign_y
            steps_y -= 1
            next_y = next_y + per_y if steps_y else np.inf
        if grid[j, i]:
            return False
    return True


@typed(nb.boolean(GRID, POINTS))
def polyline_free(grid: np.ndarray, points: np.ndarray) -> bool:
    """Every segment of the polyline (N, 2) is free."""
    for k in range(len(points) - 1):
        if not segment_free(grid, points[k, 0], points[k, 1], points[k + 1, 0], points[k + 1, 1]):
            return False
    return True


@typed(NEW_POINTS(POINTS, nb.float64, nb.float64, nb.float64))
def scaled(points: np.ndarray, step: float, x: float, y: float) -> np.ndarray:
    """(N, 2) times step plus (x, y)."""
    out = np.empty(points.shape)
    for k in range(len(points)):
        out[k, 0], out[k, 1] = points[k, 0] * step + x, points[k, 1] * step + y
    return out
