"""Make a free path shorter without leaving the free cells: string pulling, the same for every planner's path.

Drop points that can be skipped, then slide every bend towards its neighbours as far as sight allows (rope shortening,
after Geraerts and Overmars, "Creating high-quality paths for motion planning", 2007, but without chance). The result
is nearly the shortest path that passes the obstacles on the same sides. No randomness.
"""

from __future__ import annotations

from dataclasses import replace

import numba as nb
import numpy as np

from rhs.api.jit import INNER, typed
from rhs.api.records import Path, PlanningProblem

from .line import GRID, NEW_POINTS, POINTS, polyline_free, scaled, segment_free

_HALVINGS = 12  # bisection steps: a bend is placed to 2e-4 of its segment in one round, and better by the next
_AHEAD = 4  # points looked ahead after a round: what comes into sight by it is near, and long looks cost most
_ENOUGH = 1e-5  # stop when a round gains less than this share of the length
_ROUNDS = 60  # of pulling at most; it stops by itself much earlier


def shortened(path: Path, problem: PlanningProblem) -> Path:
    """The path with points_m pulled tight and raw_m as the planner gave it; the same path where there is nothing to pull:
    no path, one that is not free, or one whose shape its planner asks to keep."""
    given = np.asarray(path.points_m, float)
    short = given if path.keep_shape or not path.found else shorten_m(given, problem)
    return replace(path, points_m=short, raw_m=given)


def shorten_m(points_m: np.ndarray, problem: PlanningProblem) -> np.ndarray:
    """(M, 2) metres: the polyline (N, 2) pulled tight between the same ends; unchanged if it is not free.

    A start in a blocked cell stays joined to the first point in a free cell as it is; from there on it is pulled.
    """
    step, (x, y) = problem.resolution_m, problem.origin_m
    grid = np.pad(np.asarray(problem.blocked, bool), 1, constant_values=True).astype(np.uint8)
    cells = (np.asarray(points_m, float) - (x - step, y - step)) / step
    near = np.rint(2.0 * cells) / 2.0  # borders and middles of cells are met exactly
    cells = np.where(np.abs(cells - near) < 1e-9, near, cells)
    column_row = np.floor(cells)
    if not len(cells) or not ((column_row >= 0) & (column_row < grid.shape[::-1])).all():
        return points_m
    inside = column_row.astype(int)
    begin = int(np.argmin(grid[inside[:, 1], inside[:, 0]]))  # the first point in a free cell
    tail = np.ascontiguousarray(cells[begin:])
    if not polyline_free(grid, tail):
        return points_m
    short = shorten(grid, tail, _ROUNDS)
    if not polyline_free(grid, short):
        return points_m
    pulled = np.vstack([points_m[:begin], scaled(short, step, x - step, y - step)])
    pulled[begin], pulled[-1] = points_m[begin], points_m[-1]
    return pulled


@typed(NEW_POINTS(GRID, POINTS, nb.int64))
def skip_points(grid: np.ndarray, points: np.ndarray, ahead: int) -> np.ndarray:
    """From each point go on to the farthest in sight of the `ahead` next ones (greedy)."""
    keep = np.empty(len(points), np.int64)
    keep[0], count, at = 0, 1, 0
    while at < len(points) - 1:
        to = min(len(points) - 1, at + ahead)
        while to > at + 1 and not segment_free(grid, points[at, 0], points[at, 1], points[to, 0], points[to, 1]):
            to -= 1
        keep[count] = to
        count, at = count + 1, to
    return points[keep[:count]].copy()


@typed(nb.float64(GRID, nb.float64, nb.float64, nb.float64, nb.float64, nb.float64, nb.float64), **INNER)
def _reach(grid: np.ndarray, fx: float, fy: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Largest found share t of the way a -> b from where (fx, fy) is still in sight, by bisection."""
    if segment_free(grid, fx, fy, bx, by):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if segment_free(grid, fx, fy, ax + middle * (bx - ax), ay + middle * (by - ay)):
            low = middle
        else:
            high = middle
    return low


@typed(NEW_POINTS(GRID, POINTS))
def _pull_once(grid: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Each bend split in two where a line across is free, else slid on towards the goal while in sight of the last."""
    out = np.empty((2 * len(points), 2))
    out[0, 0], out[0, 1], count = points[0, 0], points[0, 1], 1
    for k in range(1, len(points) - 1):
        px, py = out[count - 1]
        vx, vy = points[k]
        nx, ny = points[k + 1]
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):  # chord across the bend, the same share of both sides
            t = 0.5 * (low + high)
            if segment_free(grid, vx + t * (px - vx), vy + t * (py - vy), vx + t * (nx - vx), vy + t * (ny - vy)):
                low = t
            else:
                high = t
        ax, ay, bx, by = vx + low * (px - vx), vy + low * (py - vy), vx + low * (nx - vx), vy + low * (ny - vy)
        # what is left of both sides was free before; rounding may say otherwise. A short chord gains less than sliding
        if low > 0.02 and segment_free(grid, px, py, ax, ay) and segment_free(grid, bx, by, nx, ny):
            out[count, 0], out[count, 1] = ax, ay
            count += 1
            out[count, 0], out[count, 1] = bx, by
            count += 1
        else:
            t = _reach(grid, px, py, vx, vy, nx, ny)
            mx, my = (nx, ny) if t == 1.0 else (vx + t * (nx - vx), vy + t * (ny - vy))
            if not segment_free(grid, mx, my, nx, ny):
                mx, my = vx, vy
            out[count, 0], out[count, 1] = mx, my
            count += 1
    out[count, 0], out[count, 1] = points[-1, 0], points[-1, 1]
    return out[: count + 1].copy()


@typed(nb.float64(POINTS))
def length(points: np.ndarray) -> float:
    """Length of a polyline (N, 2)."""
    total = 0.0
    for k in range(len(points) - 1):
        total += np.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
    return total


@typed(NEW_POINTS(GRID, POINTS, nb.int64))
def shorten(grid: np.ndarray, points: np.ndarray, rounds: int) -> np.ndarray:
    """At most `rounds` rounds of pulling, towards the goal and towards the start by turns; never longer than given."""
    if len(points) < 3 or rounds <= 0:
        return points.copy()
    best = skip_points(grid, points, len(points))
    before, idle, flipped = length(best), 0, False
    for _ in range(rounds):
        if len(best) < 3 or idle >= 2:
            break
        trial = skip_points(grid, _pull_once(grid, best), _AHEAD)
        after = length(trial)
        idle = 0 if after < before * (1.0 - _ENOUGH) else idle + 1
        if after < before:
            best, before = trial, after
        best, flipped = best[::-1].copy(), not flipped
    return best[::-1].copy() if flipped else best
