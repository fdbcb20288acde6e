"""How far it is from each cell of a grid to the nearest thing, the ways between cells, and the grid with larger ones."""

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


def neighbours(open_: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The pairs of open cells (H, W) bool that touch, at a corner too: numbers of the one and of the other (E,), in the
    order of np.argwhere(open_), and how far apart their middles are (E,), in cells."""
    number = np.cumsum(open_).reshape(open_.shape) - 1
    height, width = open_.shape
    ones, others, apart = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, height - down), slice(max(0, -right), width - max(0, right)))
        there = (slice(down, height), slice(max(0, right), width + min(0, right)))
        both = open_[here] & open_[there]
        ones.append(number[here][both])
        others.append(number[there][both])
        apart.append(np.full(int(both.sum()), float(np.hypot(down, right))))
    return np.concatenate(ones), np.concatenate(others), np.concatenate(apart)


def ways_m(open_: np.ndarray, cell_m: float, start: np.ndarray) -> np.ndarray:
    """(H, W) metres of the shortest way through open cells (H, W) bool of cell_m to each of them from the open cell start
    (row, column); inf where there is none."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    one, other, apart = neighbours(open_)
    count = int(open_.sum())
    graph = coo_array((cell_m * apart, (one, other)), shape=(count, count))
    first = int(np.count_nonzero(open_.ravel()[:np.ravel_multi_index(tuple(start), open_.shape)]))
    out = np.full(open_.shape, np.inf)
    out[open_] = dijkstra(graph.tocsr(), directed=False, indices=first)
    return out


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
