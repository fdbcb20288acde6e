"""The independent judge of paths: is a path free, and how short could one have been?

Shares nothing with the planners: they walk from cell to cell (Amanatides and Woo 1987); the judge clips every segment
column by column and asks which open cells it overlaps. The optimum is the Euclidean shortest path, found on the
visibility graph over convex corners of blocked cells (Lozano-Perez and Wesley 1979), exact for cell obstacles.

Touching: a path may touch blocked cells and run along their sides, since the shortest path does. It may not pass
between two blocked cells that meet, whether along a common side or through a common corner. Outside the grid is
blocked. Everything is decided to 1e-7 of a cell: a path that deep inside a blocked cell still touches it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.records import PlanningProblem


def opened(problem: PlanningProblem, start_radius_m: float) -> PlanningProblem:
    """The problem as it is judged. A robot may find itself where its centre may not be (an obstacle seen too late, a belief
    a little off): if the start lies in blocked cells alone, those within `start_radius_m` of it do not count, for the path
    and for the optimum alike. Whether it does is found here; nobody is asked."""
    x, y = _to_cells(problem.start_m, problem.resolution_m, problem.origin_m)[0]
    grid = _padded(problem.blocked)
    rows, columns = grid.shape
    if not (1.0 <= x <= columns - 1.0 and 1.0 <= y <= rows - 1.0):
        return problem
    here = grid[int(np.ceil(y)) - 1: int(np.floor(y)) + 1, int(np.ceil(x)) - 1: int(np.floor(x)) + 1]
    if (here == 0).any():  # some cell whose closure holds the start is free
        return problem
    i, j = np.arange(1, columns - 1), np.arange(1, rows - 1)[:, None]
    gap_x, gap_y = np.maximum(np.maximum(i - x, x - i - 1.0), 0.0), np.maximum(np.maximum(j - y, y - j - 1.0), 0.0)
    near = np.hypot(gap_x, gap_y) * problem.resolution_m <= start_radius_m + 1e-9
    return replace(problem, blocked=np.asarray(problem.blocked, bool) & ~near)


def path_valid(points, blocked: np.ndarray, resolution: float, origin) -> bool:
    """True if the polyline `points` (N, 2) metres stays off the inside of every blocked cell of `blocked` (H, W) bool.

    origin: metres of the corner of cell (0, 0). False for an empty path, a NaN, or a point outside the grid.
    """
    from .judge_kernels import polyline_free

    cells = _to_cells(points, resolution, origin)
    if len(cells) == 0 or not np.isfinite(cells).all():
        return False
    return bool(polyline_free(_padded(blocked), cells))


def shortest_length_m(blocked: np.ndarray, resolution: float, origin, points) -> float:
    """Least length in metres of a path through `points` (N, 2) metres in their order; NaN if there is none."""
    return Optimum(blocked, resolution, origin).length_m(points)


class Optimum:
    """Euclidean shortest paths over one grid; corners are found once and serve every query."""

    def __init__(self, blocked: np.ndarray, resolution: float, origin):
        from .judge_kernels import convex_corners

        self._resolution, self._origin = float(resolution), np.asarray(origin, float)
        self._grid = _padded(blocked)
        self._corners, self._quadrants = convex_corners(self._grid)

    def path_m(self, start, goal) -> np.ndarray:
        """(N, 2) metres, the shortest path from start to goal; empty (0, 2) if there is none."""
        from .judge_kernels import point_free, visibility_search

        ends = _to_cells([start, goal], self._resolution, self._origin)
        if not np.isfinite(ends).all() or not all(point_free(self._grid, *end) for end in ends):
            return np.empty((0, 2))
        cells = visibility_search(self._grid, self._corners, self._quadrants, ends)
        return (cells - 1.0) * self._resolution + self._origin if len(cells) else np.empty((0, 2))

    def length_m(self, points) -> float:
        """Least length in metres through `points` in order; NaN if a leg has no path."""
        total = 0.0
        for start, goal in zip(points[:-1], points[1:], strict=True):
            path = self.path_m(start, goal)
            if not len(path):
                return float("nan")
            total += polyline_length(path)
        return total


def polyline_length(points) -> float:
    """Length of a polyline (N, 2), in the unit of its points."""
    return float(np.linalg.norm(np.diff(np.asarray(points, float), axis=0), axis=1).sum())


def _to_cells(points, resolution: float, origin) -> np.ndarray:
    """(N, 2) x, y in cells of the padded grid; values within 1e-9 of a cell border are put on it."""
    cells = (np.asarray(points, float).reshape(-1, 2) - np.asarray(origin, float)) / resolution + 1.0
    near = np.rint(cells)
    return np.where(np.abs(cells - near) < 1e-9, near, cells)


def _padded(blocked: np.ndarray) -> np.ndarray:
    """The grid as bytes with one blocked cell all round, so that outside needs no case of its own."""
    return np.pad(np.asarray(blocked, bool), 1, constant_values=True).astype(np.uint8)
