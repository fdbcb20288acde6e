"""Exact walks of straight lines over grid cells: marking scans, casting rays, checking segments.

The walk is Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987: every cell a
line passes through is visited once, in order. Coordinates in the compiled functions are *cells*: (metres - origin)
divided by the resolution, so cell (row i, column j) covers i <= y < i + 1 and j <= x < j + 1. Loads numba: import it
when it is needed.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.api.jit import INNER, compiled, inner, typed

FREE, HIT = 1, 2  # marks of one scan; a larger mark wins
_MARKS, _TOUCHED = nb.types.Array(nb.uint8, 2, "C"), nb.types.Array(nb.int32, 2, "C")


@inner
def _walk_start(x0: float, y0: float, dx: float, dy: float) -> tuple[int, int, int, int, float, float, float, float]:
    """Cell, steps, and the lengths along (dx, dy) to the next border and between borders, per axis."""
    big = 1e30
    column, row = int(np.floor(x0)), int(np.floor(y0))
    step_x = 1 if dx > 0 else -1
    step_y = 1 if dy > 0 else -1
    delta_x = abs(1.0 / dx) if dx != 0.0 else big
    delta_y = abs(1.0 / dy) if dy != 0.0 else big
    next_x = ((column + 1 - x0) if dx > 0 else (x0 - column)) * delta_x if dx != 0.0 else big
    next_y = ((row + 1 - y0) if dy > 0 else (y0 - row)) * delta_y if dy != 0.0 else big
    return column, row, step_x, step_y, next_x, next_y, delta_x, delta_y


@typed(nb.int64(_MARKS, _TOUCHED, nb.int64, nb.float64, nb.float64, nb.float64, nb.float64, nb.float64, nb.boolean), **INNER)
def _mark_beam(marks: np.ndarray, touched: np.ndarray, count: int, x0: float, y0: float, dx: float, dy: float,
               length: float, hit: bool) -> int:
    """Mark the cells of one beam; returns the new number of touched cells (listed once each)."""
    rows, columns = marks.shape
    column, row, step_x, step_y, next_x, next_y, delta_x, delta_y = _walk_start(x0, y0, dx, dy)
    end_column, end_row = int(np.floor(x0 + dx * length)), int(np.floor(y0 + dy * length))
    crossings = abs(end_column - column) + abs(end_row - row)
    for crossing in range(crossings + 1):
        mark = HIT if hit and crossing == crossings else FREE
        if 0 <= row < rows and 0 <= column < columns:
            if marks[row, column] == 0:
                touched[count, 0], touched[count, 1] = row, column
                count += 1
            if mark > marks[row, column]:
                marks[row, column] = mark
        if next_x < next_y:
            next_x += delta_x
            column += step_x
        else:
            next_y += delta_y
            row += step_y
    return count


@compiled
def mark_scan(marks: np.ndarray, touched: np.ndarray, origin: np.ndarray, angles: np.ndarray, lengths: np.ndarray,
              hits: np.ndarray) -> int:
    """Mark every cell a scan speaks of, each once: HIT if any beam ends in it on something, else FREE if any passes.

    marks (H, W) uint8, zero on entry (see clear_marks). touched (H * W, 2) int32, filled with (row, column).
    origin (2,): x, y of the beams' common start; lengths (N,), both in cells; angles (N,) radians in the grid's frame;
    hits (N,) bool: the beam ends on something, otherwise its last cell is free as well. Beams of length <= 0 or NaN
    are skipped. Returns the number of touched cells.
    """
    count = 0
    for k in range(len(angles)):
        if lengths[k] > 0.0:
            dx, dy = np.cos(angles[k]), np.sin(angles[k])
            count = _mark_beam(marks, touched, count, origin[0], origin[1], dx, dy, lengths[k], hits[k])
    return count


@compiled
def mark_stretches(marks: np.ndarray, touched: np.ndarray, origin: np.ndarray, angles: np.ndarray, stretches: np.ndarray,
                   ends: np.ndarray) -> int:
    """As mark_scan, of beams that speak of a stretch only: stretches (N, 2) from and to along the beam, in cells, FREE; and
    of the one cell at ends (N,), in cells, HIT, where that is finite."""
    count = 0
    for k in range(len(angles)):
        dx, dy = np.cos(angles[k]), np.sin(angles[k])
        begin, end = stretches[k, 0], stretches[k, 1]
        if end > begin:
            x, y = origin[0] + dx * begin, origin[1] + dy * begin
            count = _mark_beam(marks, touched, count, x, y, dx, dy, end - begin, False)
        if np.isfinite(ends[k]):
            x, y = origin[0] + dx * ends[k], origin[1] + dy * ends[k]
            count = _mark_beam(marks, touched, count, x, y, dx, dy, 0.0, True)
    return count


@compiled
def add_marks(log_odds: np.ndarray, observed: np.ndarray, marks: np.ndarray, touched: np.ndarray, count: int,
              free_step: np.float32, hit_step: np.float32, bound: np.float32) -> None:
    """Add one step per touched cell to log_odds (H, W), clamp to +-bound, note it observed, and clear the marks."""
    for k in range(count):
        row, column = touched[k, 0], touched[k, 1]
        step = hit_step if marks[row, column] == HIT else free_step
        log_odds[row, column] = min(max(log_odds[row, column] + step, -bound), bound)
        observed[row, column] = True
        marks[row, column] = 0


@inner
def _cast(blocked: np.ndarray, x0: float, y0: float, dx: float, dy: float, length: float) -> float:
    """Distance in cells along the unit vector (dx, dy) to the first blocked cell; inf if none within length."""
    rows, columns = blocked.shape
    column, row, step_x, step_y, next_x, next_y, delta_x, delta_y = _walk_start(x0, y0, dx, dy)
    travelled = 0.0
    while travelled <= length:
        if 0 <= row < rows and 0 <= column < columns and blocked[row, column]:
            return travelled
        if next_x < next_y:
            travelled = next_x
            next_x += delta_x
            column += step_x
        else:
            travelled = next_y
            next_y += delta_y
            row += step_y
    return np.inf


@compiled
def _cast_all(blocked: np.ndarray, x0: float, y0: float, angles: np.ndarray, length: float) -> np.ndarray:
    out = np.empty(len(angles))
    for k in range(len(angles)):
        out[k] = _cast(blocked, x0, y0, np.cos(angles[k]), np.sin(angles[k]), length)
    return out


def cast(
    blocked: np.ndarray, grid: OccupancyGrid, start_m: np.ndarray, angles_rad: np.ndarray, max_range_m: float
) -> np.ndarray:
    """(N,) metres from `start_m` (2,) along each map bearing to the border of the first True cell of `blocked` (H, W);
    inf where there is none within max_range_m. Cells outside the grid are never blocked."""
    x0, y0 = (np.asarray(start_m, float) - np.asarray(grid.origin_m)) / grid.resolution_m
    angles = np.ascontiguousarray(angles_rad, float)
    return _cast_all(np.ascontiguousarray(blocked), x0, y0, angles, max_range_m / grid.resolution_m) * grid.resolution_m


def segment_is_free(blocked: np.ndarray, grid: OccupancyGrid, start_m: np.ndarray, end_m: np.ndarray) -> bool:
    """Whether no True cell of `blocked` (H, W) lies under the segment between two (2,) points in metres."""
    gap = np.asarray(end_m, float) - np.asarray(start_m, float)
    length = float(np.hypot(*gap))
    angle = np.array([np.arctan2(gap[1], gap[0])])
    return not np.isfinite(cast(blocked, grid, start_m, angle, length)[0])
