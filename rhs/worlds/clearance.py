"""How far it is from each cell of a grid to the nearest thing, and the same grid with larger cells."""

from __future__ import annotations

import numpy as np

from rhs.api.grid import OccupancyGrid


def clearance_of(grid: OccupancyGrid) -> np.ndarray:
    """(H, W) metres from the middle of each cell to the nearest edge of a cell that is not free; the outside is not."""
    from scipy.ndimage import distance_transform_edt

    free = np.pad(grid.free(), 1)
    nearest = distance_transform_edt(free, return_distances=False, return_indices=True)
    gaps = np.maximum(np.abs(nearest - np.indices(free.shape)) - 0.5, 0.0)
    clearance: np.ndarray = np.sqrt(gaps[0] ** 2 + gaps[1] ** 2)[1:-1, 1:-1] * grid.resolution_m
    return clearance


def coarser(grid: OccupancyGrid, most_cells: int) -> OccupancyGrid:
    """The grid with cells so large that there are at most that many; a cell is free where all it covers is."""
    factor = int(np.ceil(np.sqrt(grid.probability.size / most_cells)))
    if factor <= 1:
        return grid
    rows, columns = (-(-size // factor) for size in grid.shape)
    free = np.zeros((rows * factor, columns * factor), bool)
    free[: grid.shape[0], : grid.shape[1]] = grid.free()
    whole = free.reshape(rows, factor, columns, factor).all(axis=(1, 3))
    probability = np.where(whole, 0.0, 1.0).astype(np.float32)
    return OccupancyGrid(probability, grid.resolution_m * factor, grid.origin_m)
