"""How wide a way there is to each place: the largest disc that gets there among all that stands, and how sure that is.

By the true outlines, not by cells: they are sampled every 5 mm, and each point of a lattice of 2 cm knows the sample in the
nearest cell that has one. Within half a diagonal of any way there is one from point to neighbouring point of the lattice,
and the other way round, so that radii are right to 0.71 of the lattice, 1.4 cm.
"""

from __future__ import annotations

import numpy as np

from rhs.api.floorplan import World, after
from rhs.api.grid import OccupancyGrid, frame_of

CELL_M, MOST_CELLS = 0.02, 1_000_000  # of the lattice; a building with more has larger ones
SAMPLE_M = 0.005  # between two samples of an outline: a clearance of 0.2 m is right to 0.02 mm
WIDEST_M = 0.8  # ways are told apart up to this radius
STEPS = 10  # halvings of that: 0.8 mm


def reach(world: World, start_m: np.ndarray, *, within_m: float) -> tuple[np.ndarray, float]:
    """((N,) radius of the largest disc that gets from the start (2,) to within within_m of each place, at most WIDEST_M;
    how far off that may be), metres: among walls, boxes and mesh as they stand in the patrol. What moves by itself does not
    count; what hangs over the robot does, as in the true plan (rhs.api.floorplan.truth_grid)."""
    from scipy.ndimage import label

    world = after(world)
    low_x, low_y, high_x, high_y = world.bounds_m
    cell_m = max(CELL_M, float(np.sqrt((high_x - low_x) * (high_y - low_y) / MOST_CELLS)))
    shape, origin = frame_of(world.bounds_m, cell_m)
    lattice = OccupancyGrid(np.zeros(shape, np.float32), cell_m, origin)
    points = lattice.centres(np.indices(shape).reshape(2, -1).T)
    room = _room_m(lattice, points, _outlines(world))
    room[[0, -1]] = room[:, [0, -1]] = 0.0  # no way leads round the building
    here = tuple(np.clip(lattice.cells(start_m)[0], 0, np.array(shape) - 1))
    near = [np.flatnonzero(np.hypot(*(points - place[1:]).T) <= within_m) for place in world.places]

    def got_to(radius_m: float) -> np.ndarray:
        regions, _ = label(room >= radius_m, structure=np.ones((3, 3)))
        own = regions == regions[here] if room[here] >= radius_m else np.zeros(shape, bool)
        return np.array([own.ravel()[cells].any() for cells in near])

    known: dict[float, np.ndarray] = {}
    least, most = np.zeros(len(near)), np.full(len(near), WIDEST_M)
    for _ in range(STEPS):
        middle = 0.5 * (least + most)
        known |= {radius: got_to(radius) for radius in set(middle.tolist()) - set(known)}
        through = np.array([known[radius][k] for k, radius in enumerate(middle.tolist())], bool)
        least, most = np.where(through, middle, least), np.where(through, most, middle)
    return least, float(np.sqrt(0.5)) * cell_m


def _room_m(lattice: OccupancyGrid, points: np.ndarray, outlines: np.ndarray) -> np.ndarray:
    """(H, W) metres from each of the lattice's points (H W, 2) to the outlines (K, 2)."""
    from scipy.ndimage import distance_transform_edt

    shape = lattice.probability.shape
    row, column = np.clip(lattice.cells(outlines), 0, np.array(shape) - 1).T
    sample, empty = np.zeros((*shape, 2)), np.ones(shape, bool)
    sample[row, column] = outlines
    empty[row, column] = False
    nearest = distance_transform_edt(empty, return_distances=False, return_indices=True)
    out: np.ndarray = np.hypot(*np.moveaxis(points.reshape(*shape, 2) - sample[tuple(nearest)], 2, 0))
    return out


def _outlines(world: World) -> np.ndarray:
    """(K, 2) metres: points every SAMPLE_M or less along all that stands, seen from above."""
    closed = [box.corners_m for box in world.boxes] + ([] if world.mesh is None else list(world.mesh.solid_m))
    pieces = [wall.segments_m for wall in world.walls]
    pieces += [np.stack([corners, np.roll(corners, -1, axis=0)], axis=1) for corners in closed]
    sampled = []
    for start, end in np.concatenate(pieces):
        share = np.linspace(0.0, 1.0, int(np.ceil(np.hypot(*(end - start)) / SAMPLE_M)) + 1)[:, None]
        sampled.append(start + share * (end - start))
    points = np.concatenate(sampled)
    return points if world.mesh is None else np.unique(np.round(points / SAMPLE_M), axis=0) * SAMPLE_M
