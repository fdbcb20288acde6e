"""Compiled: what stands of a triangle mesh between two heights, seen from above, as convex outlines; and the plan that they
make. Imported only where a world has a mesh.

An outline is (5, 2) corners x, y in metres: a triangle cut by two level planes has five at most; fewer are filled up with
the last one. Cut after Sutherland and Hodgman, "Reentrant polygon clipping", CACM 17(1), 1974.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from .jit import typed

MEET_M = 1e-6  # as of walls and boxes: rhs.api.floorplan
CORNERS = 5
I64, F64 = nb.int64, nb.float64
SOLID = nb.types.Array(F64, 3, "C")
TABLE = nb.types.Array(F64, 2, "C")
CELLS = nb.types.Array(nb.boolean, 2, "C")


@typed(I64(TABLE, I64, I64, F64, TABLE))
def _cut(polygon: np.ndarray, count: int, sign: int, height_m: float, out: np.ndarray) -> int:
    """Corners of the polygon (N, 3) on one side of a level plane (sign 1: above, -1: below), to out; how many."""
    kept = 0
    for i in range(count):
        j = (i + 1) % count
        a, b = sign * (polygon[i, 2] - height_m), sign * (polygon[j, 2] - height_m)
        if a >= 0.0:
            out[kept] = polygon[i]
            kept += 1
        if (a > 0.0 and b < 0.0) or (a < 0.0 and b > 0.0):
            share = a / (a - b)
            for k in range(3):
                out[kept, k] = polygon[i, k] + share * (polygon[j, k] - polygon[i, k])
            kept += 1
    return kept


@typed(I64(SOLID, F64, F64, SOLID))
def _between(triangles_m: np.ndarray, low_m: float, high_m: float, out: np.ndarray) -> int:
    """Outlines of what lies between the heights, to out; how many."""
    found = 0
    above, both = np.empty((6, 3)), np.empty((6, 3))
    for n in range(len(triangles_m)):
        count = _cut(triangles_m[n], 3, 1, low_m, above)
        count = _cut(above, count, -1, high_m, both) if count > 0 else 0
        if count > 0:
            for k in range(CORNERS):
                out[found, k, 0], out[found, k, 1] = both[min(k, count - 1), 0], both[min(k, count - 1), 1]
            found += 1
    return found


@typed(nb.boolean(TABLE, F64, F64, F64))
def _meets(corners: np.ndarray, x: float, y: float, half_m: float) -> bool:
    """Whether no side of the outline parts it from the square about (x, y); the square's own sides are not asked."""
    for k in range(CORNERS):
        ax, ay = corners[k]
        bx, by = corners[(k + 1) % CORNERS]
        length = np.hypot(bx - ax, by - ay)
        if length < 1e-12:
            continue
        across_x, across_y = -(by - ay) / length, (bx - ax) / length
        least, most = np.inf, -np.inf
        for i in range(CORNERS):
            along = across_x * (corners[i, 0] - x) + across_y * (corners[i, 1] - y)
            least, most = min(least, along), max(most, along)
        reach = half_m * (abs(across_x) + abs(across_y)) + (MEET_M if most - least <= 2.0 * MEET_M else -MEET_M)
        if least > reach or most < -reach:
            return False
    return True


@typed(nb.void(SOLID, F64, F64, F64, CELLS))
def touch(solid_m: np.ndarray, resolution_m: float, x0_m: float, y0_m: float, touched: np.ndarray) -> None:
    """Set the cells (H, W) whose inside an outline meets, by separating axes; origin (x0_m, y0_m). An outline without
    thickness that runs along the border between two rows of cells touches both."""
    height, width = touched.shape
    half = 0.5 * resolution_m
    for n in range(len(solid_m)):
        corners = solid_m[n]
        left, right = corners[:, 0].min(), corners[:, 0].max()
        low, high = corners[:, 1].min(), corners[:, 1].max()
        wide = -MEET_M if right - left > 2.0 * MEET_M else MEET_M
        tall = -MEET_M if high - low > 2.0 * MEET_M else MEET_M
        first_column = max(int(np.floor((left - x0_m - wide) / resolution_m)), 0)
        last_column = min(int(np.floor((right - x0_m + wide) / resolution_m)), width - 1)
        first_row = max(int(np.floor((low - y0_m - tall) / resolution_m)), 0)
        last_row = min(int(np.floor((high - y0_m + tall) / resolution_m)), height - 1)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                x, y = x0_m + (column + 0.5) * resolution_m, y0_m + (row + 0.5) * resolution_m
                if not touched[row, column] and _meets(corners, x, y, half):
                    touched[row, column] = True


@typed(F64(SOLID, F64, F64, F64))
def nearest_m(solid_m: np.ndarray, x: float, y: float, within_m: float) -> float:
    """Metres from a point to the nearest outline, 0 inside one; within_m when none is nearer than that."""
    best = within_m * within_m
    for n in range(len(solid_m)):
        corners = solid_m[n]
        left, right, low, high = corners[0, 0], corners[0, 0], corners[0, 1], corners[0, 1]
        for k in range(1, CORNERS):
            left, right = min(left, corners[k, 0]), max(right, corners[k, 0])
            low, high = min(low, corners[k, 1]), max(high, corners[k, 1])
        dx, dy = max(left - x, x - right, 0.0), max(low - y, y - high, 0.0)
        if dx * dx + dy * dy >= best:
            continue
        turns_left, turns_right = False, False
        for k in range(CORNERS):
            ax, ay = corners[k]
            ex, ey = corners[(k + 1) % CORNERS, 0] - ax, corners[(k + 1) % CORNERS, 1] - ay
            px, py = x - ax, y - ay
            squared = ex * ex + ey * ey
            share = min(max((px * ex + py * ey) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
            best = min(best, (px - share * ex) ** 2 + (py - share * ey) ** 2)
            side = ex * py - ey * px
            turns_left |= side > 0.0
            turns_right |= side < 0.0
        if turns_left != turns_right:
            return 0.0
    return float(np.sqrt(best))


def outlines_between(triangles_m: np.ndarray, low_m: float, high_m: float) -> np.ndarray:
    """(P, 5, 2) outlines of the parts of triangles (N, 3, 3) whose height is from low_m to high_m."""
    triangles = np.ascontiguousarray(triangles_m, np.float64)
    z = triangles[..., 2]
    triangles = np.ascontiguousarray(triangles[(z.max(axis=1) >= low_m) & (z.min(axis=1) <= high_m)])
    out = np.empty((len(triangles), CORNERS, 2))
    return out[: _between(triangles, low_m, high_m, out)].copy()
