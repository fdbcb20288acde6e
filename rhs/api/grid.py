"""Occupancy grids: cells and metres, occupancy calls, growth by the robot's radius.

Row index is y, column index is x; `origin_m` is the corner of cell (0, 0), whose centre is half a cell further.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .errors import ConfigError

MOST_CELLS = 50_000_000  # 7000 x 7000: 0.2 GB as float32
MARGIN_CELLS = 2  # round the area to map: a wall on its border, seen with depth noise, must still fall on the grid


def frame_of(
    bounds_m: tuple[float, float, float, float], resolution_m: float
) -> tuple[tuple[int, int], tuple[float, float]]:
    """Shape (rows, columns) and origin (x, y) metres of the one grid everybody draws over an area.

    bounds_m: (x_min, y_min, x_max, y_max). Whole multiples of the resolution are cell *centres*: the corner lies half a
    cell off, so a wall that follows the decimetres falls in one row of cells and not on the border between two. The
    grid reaches MARGIN_CELLS past the bounds on each side. Raises ConfigError for more than MOST_CELLS cells.
    """
    low = np.floor(np.asarray(bounds_m[:2]) / resolution_m + 1e-6) - MARGIN_CELLS
    high = np.ceil(np.asarray(bounds_m[2:]) / resolution_m - 1e-6) + MARGIN_CELLS
    columns, rows = (high - low).astype(int) + 1
    if columns * rows > MOST_CELLS:
        raise ConfigError(f"a map of {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} cells of {resolution_m:g} m takes "
                          f"{4 * columns * rows / 2**30:.1f} GB; expected at most {MOST_CELLS} cells: larger cells or a "
                          f"smaller area")
    x_m, y_m = (low - 0.5) * resolution_m
    return (int(rows), int(columns)), (float(x_m), float(y_m))


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """probability (H, W) float32: chance that the cell is occupied, NaN where never observed."""

    probability: np.ndarray
    resolution_m: float
    origin_m: tuple[float, float]

    def __repr__(self) -> str:
        rows, columns = self.shape
        return (f"OccupancyGrid({columns} x {rows} cells of {self.resolution_m:g} m from x={self.origin_m[0]:.2f} "
                f"y={self.origin_m[1]:.2f}, {np.isfinite(self.probability).mean():.0%} seen)")

    @property
    def shape(self) -> tuple[int, int]:
        return self.probability.shape

    def cells(self, points_m: np.ndarray) -> np.ndarray:
        """(N, 2) integer (row, column) of (N, 2) points x, y in metres; may lie outside the grid."""
        points = np.atleast_2d(np.asarray(points_m, float))
        column_row: np.ndarray = np.floor((points - np.asarray(self.origin_m)) / self.resolution_m + 1e-9).astype(int)
        return column_row[:, ::-1]

    def centres(self, cells: np.ndarray) -> np.ndarray:
        """(N, 2) metres x, y of the centres of (N, 2) (row, column) cells."""
        centres: np.ndarray = (np.atleast_2d(cells)[:, ::-1] + 0.5) * self.resolution_m + np.asarray(self.origin_m)
        return centres

    def inside(self, points_m: np.ndarray) -> np.ndarray:
        """(N,) bool: the point lies on the grid."""
        rc = self.cells(points_m)
        inside: np.ndarray = np.all((rc >= 0) & (rc < np.array(self.shape)), axis=1)
        return inside

    def occupied(self, threshold: float = 0.65) -> np.ndarray:
        """(H, W) bool: observed and at least `threshold` likely to be occupied."""
        with np.errstate(invalid="ignore"):
            return self.probability >= threshold

    def free(self, threshold: float = 0.25) -> np.ndarray:
        """(H, W) bool: observed and less than `threshold` likely to be occupied."""
        with np.errstate(invalid="ignore"):
            return self.probability < threshold

    def blocked(self, radius_m: float, *, free_below: float = 0.25, unknown_is_blocked: bool = True) -> np.ndarray:
        """(H, W) bool: where the centre of a round robot may not be: not free, grown by its radius (thesis 5.5)."""
        obstacle = ~self.free(free_below) if unknown_is_blocked else self.occupied(free_below)
        return configuration_space(obstacle, radius_m / self.resolution_m)


def inflate(obstacle: np.ndarray, radius_cells: float) -> np.ndarray:
    """Cells whose centre is at most `radius_cells` from the centre of an obstacle cell (exact distance transform)."""
    if radius_cells <= 0 or not obstacle.any():
        return obstacle.copy()
    from scipy.ndimage import distance_transform_edt

    near: np.ndarray = distance_transform_edt(~obstacle) <= radius_cells + 1e-9
    return near


def configuration_space(obstacle: np.ndarray, radius_cells: float) -> np.ndarray:
    """(H, W) bool: where the centre of a round robot may not be (Lozano-Perez 1983): obstacle cells grown by its radius,
    and whatever is nearer than the radius to the border, for nobody knows what stands outside the map."""
    blocked = inflate(obstacle, radius_cells)
    strip = max(0, int(np.ceil(radius_cells - 1e-9)))  # cells of which some point is nearer to the border than the radius
    if strip:
        blocked[:strip] = blocked[-strip:] = True
        blocked[:, :strip] = blocked[:, -strip:] = True
    return blocked


def nearest_open(grid: OccupancyGrid, blocked: np.ndarray, goal_m: np.ndarray, within_m: float) -> np.ndarray:
    """(2,) the goal, or the middle of the nearest free cell that still counts as the place: at home nobody has seen what
    lies behind the start. The goal itself where there is none."""
    if grid.inside(goal_m[None])[0] and not blocked[tuple(grid.cells(goal_m[None])[0])]:
        return goal_m
    open_m = grid.centres(np.argwhere(~blocked))
    gaps = np.linalg.norm(open_m - goal_m, axis=1)
    return open_m[np.argmin(gaps)] if len(gaps) and gaps.min() <= within_m else goal_m
