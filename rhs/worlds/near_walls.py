"""The ground of a wide hall from which its walls are seen: there a survey is led, and begins. In the middle of a hall wider
than a camera sees all it knows of is floor, and no two views of it can be told apart from far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.grid import OccupancyGrid

from .clearance import clearance_of

FAR_M = 3.0  # led along a wall at this distance a camera of 57 degrees sees it from 6.3 m on; a Kinect sees 8 m
ROOM_M = 1.0  # from walls, of a start that is proposed in place of one too far from them


def keep_near_walls(grid: OccupancyGrid, start: tuple[float, ...], need_m: float, *,
                    given: bool) -> tuple[OccupancyGrid, tuple[float, ...]]:
    """The grid without the free ground that lies further than FAR_M from everything (unknown there), and a start on what is
    left, the nearest with ROOM_M. Both as they are where nothing is so wide, or where the start is given and what is left
    does not hold it.

    start: (x, y, ...) metres, where a robot has room that needs need_m to each side."""
    from scipy.ndimage import label

    clearance_m = clearance_of(grid)
    ways, _ = label(clearance_m >= need_m, structure=np.ones((3, 3)))
    if not ways.any():  # whoever proposes a tour says so
        return grid, start
    within = ways == ways[_nearest(grid, ways > 0, start)]
    far = within & (clearance_m > FAR_M)
    if not far.any():
        return grid, start
    left = replace(grid, probability=np.where(far, np.float32(np.nan), grid.probability))
    room_m = np.where(within, clearance_of(left), 0.0)
    parts, _ = label(room_m >= need_m, structure=np.ones((3, 3)))
    if not parts.any():
        return grid, start
    largest = parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    if largest[tuple(grid.cells(np.array(start[:2]))[0])]:
        return left, start
    if given:
        return grid, start
    roomy = largest & (room_m >= min(ROOM_M, float(room_m[largest].max())))
    x, y = grid.centres(np.array([_nearest(grid, roomy, start)]))[0]
    return left, (round(float(x), 4), round(float(y), 4))


def _nearest(grid: OccupancyGrid, cells: np.ndarray, point_m: tuple[float, ...]) -> tuple[int, int]:
    """(row, column) of the nearest of these cells (H, W) bool to a point."""
    chosen = np.argwhere(cells)
    row, column = chosen[int(np.argmin(np.hypot(*(grid.centres(chosen) - np.array(point_m[:2])).T)))]
    return int(row), int(column)
