"""A flat map pulled up into walls: the outline of the room that a robot can be in, as polylines.

The outline runs along the sides of cells, the room on its left, so that occupied cells are as thick as in the map and doors
as wide. It is simplified by Douglas and Peucker, "Algorithms for the reduction of the number of points", Cartographica
10(2), 1973 (OpenCV's approxPolyDP) with a tolerance of one cell: then the staircase of an oblique wall is a straight piece
again, and no point of a wall is further than a cell from where the map has it. What is unknown is outside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.floorplan import Mesh, Person, Wall
from rhs.api.grid import OccupancyGrid, configuration_space, inflate
from rhs.base.errors import ConfigError

TOLERANCE_CELLS = 0.99  # a straight wall drawn in cells strays from its line by less than one
HEIGHT_M = 2.6
LEAK_M = 0.1  # a gap in a wall, a cell of the true plan; no door
LEAST_SHUT_M2 = 2.0  # of a room that is spoken of; inside the outline of a bed a small robot's middle has less
INDOORS = 0.1  # least share of the roomiest room that one indoors must have to be preferred: no cupboard
DOORS_M = 1.4  # wider than most doors
ENCLOSED = 1.0 / 3.0  # least share of what a drawing covers that lies behind its doors, if paper lies before them
INDOORS_M2 = 10.0  # room for the robot's middle indoors for which the roomiest room is paper, if it holds the corners


@dataclass(frozen=True, eq=False)
class Building:
    """What a file of somebody else holds. stand_m: (2,) a point in its room, far from everything. camera_height_m: of a
    robot that sees its walls. people: who walks there."""

    walls: tuple[Wall, ...]
    stand_m: np.ndarray
    mesh: Mesh | None = None
    camera_height_m: float = 1.2
    people: tuple[Person, ...] = ()


def room_of(grid: OccupancyGrid, radius_m: float, start_m: np.ndarray | None = None) -> np.ndarray:
    """(H, W) bool: the free cells of one room: the one with the start (2,), or else the one that gives a robot of that
    radius most space. A room that reaches the border counts only where there is no other of some size: round a drawn plan
    lies white paper, of any size where it holds three corners of the picture. Nothing where the robot fits nowhere."""
    from scipy.ndimage import label

    free = grid.free()
    rooms, count = label(free)
    if start_m is not None:
        row, column = grid.cells(start_m)[0]
        inside = 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1] and free[row, column]
        return rooms == rooms[row, column] if inside else np.zeros(grid.shape, bool)
    fits = ~configuration_space(~free, radius_m / grid.resolution_m)
    stands, spaces = label(fits)
    if not spaces:
        return np.zeros(grid.shape, bool)
    sizes = np.bincount(stands.ravel(), minlength=spaces + 1)[1:]
    owner = np.zeros(spaces + 1, int)
    owner[stands[fits]] = rooms[fits]
    edge = np.unique(np.concatenate([rooms[0], rooms[-1], rooms[:, 0], rooms[:, -1]]))
    indoors = ~np.isin(owner[1:], edge)
    corners = rooms[[0, 0, -1, -1], [0, -1, 0, -1]]
    paper = np.count_nonzero(corners == owner[1 + int(np.argmax(sizes))]) >= 3
    least = INDOORS * sizes.max()
    least = min(least, INDOORS_M2 / grid.resolution_m**2) if paper else least
    ranked = np.where(indoors, sizes, 0) if np.any(sizes[indoors] >= least) else sizes
    return np.asarray(rooms == owner[1 + int(np.argmax(ranked))])


def behind_doors(grid: OccupancyGrid, room: np.ndarray, radius_m: float) -> np.ndarray:
    """(H, W) bool: of a room that runs out of a door onto the paper round a drawn plan, what lies behind that door: where
    something as wide as DOORS_M does not get to from the edge of the picture. The room itself where no paper lies all
    round, or where less than ENCLOSED of what the walls span, or no room for a robot of that radius, is behind doors."""
    from scipy.ndimage import distance_transform_edt, label

    edge = np.concatenate([room[0], room[-1], room[:, 0], room[:, -1]])
    walls = np.argwhere(grid.occupied())
    if not edge.all() or not len(walls):
        return room
    wide = 0.5 * DOORS_M / grid.resolution_m
    around = int(np.ceil(2.0 * wide))
    spaces, _ = label(distance_transform_edt(np.pad(room, around, constant_values=True)) >= wide)
    outside = inflate(spaces == spaces[0, 0], wide)[around:-around, around:-around]
    inside = room & ~outside
    parts, _ = label(inside)
    fits = inside & ~configuration_space(~inside, radius_m / grid.resolution_m)
    sizes = np.bincount(parts[fits], minlength=1)
    span = np.ptp(walls, axis=0) + 1
    if inside.sum() < ENCLOSED * span[0] * span[1] or len(sizes) < 2:
        return room
    return np.asarray(parts == 1 + int(np.argmax(sizes[1:])))


def shut_m2(grid: OccupancyGrid, at_m: np.ndarray, radius_m: float) -> list[float]:
    """Square metres where a robot of that radius would have room, in each part that nothing wider than LEAK_M leads to from
    at_m (2,) and that does not reach the border; parts of less than LEAST_SHUT_M2 are furniture."""
    from scipy.ndimage import label

    solid = ~grid.free()
    rooms, _ = label(~inflate(solid, 0.5 * LEAK_M / grid.resolution_m))
    fits = ~configuration_space(solid, radius_m / grid.resolution_m)
    edge = np.unique(np.concatenate([rooms[0], rooms[-1], rooms[:, 0], rooms[:, -1]]))
    here = rooms[tuple(grid.cells(at_m)[0])]
    areas = np.bincount(rooms[fits], minlength=1) * grid.resolution_m**2
    return [float(area) for number, area in enumerate(areas)
            if area >= LEAST_SHUT_M2 and number != here and number not in edge]


def shut_words(areas_m2: list[float]) -> str:
    """What is said of parts that are shut off; empty: there are none."""
    if not areas_m2:
        return ""
    return (f"left out, as nothing leads there: {len(areas_m2)} part{'s' if len(areas_m2) > 1 else ''} of "
            f"{sum(areas_m2):.0f} m2 in all (rooms whose doors are drawn shut, or solid blocks; open the doors, or give "
            "start in a world file)")


def outlines(room: np.ndarray) -> list[np.ndarray]:
    """Closed outlines of the cells (H, W) bool, each (N, 2) corners x, y in cells, the last equal to the first: sides of
    cells, the room on the left, none of the pieces in line with the next."""
    ahead = _sides(room)
    loops = []
    while ahead:
        at = first = next(iter(ahead))
        loop, before = [], (0, 0)
        while True:
            ends = ahead[at]
            turn = ends[0]
            if len(ends) > 1:  # where two rooms touch at a corner the outline stays with the cell it follows: leftmost
                turn = max(ends, key=lambda end: before[0] * (end[1] - at[1]) - before[1] * (end[0] - at[0]))
            ends.remove(turn)
            if not ends:
                del ahead[at]
            step = (turn[0] - at[0], turn[1] - at[1])
            if step != before:
                loop.append(at)
            at, before = turn, step
            if at == first:
                break
        corners = np.array([*loop, first], float)
        first_way, last_way = corners[1] - corners[0], corners[0] - corners[-2]
        if first_way[0] * last_way[1] == first_way[1] * last_way[0]:
            corners = np.vstack([corners[1:-1], corners[1]])  # the trace began in the middle of a side
        loops.append(corners)
    return loops


def _sides(room: np.ndarray) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Corner -> corners that a side of a cell leads to, anticlockwise round each cell of the room."""
    padded = np.pad(room, 1)
    inside = padded[1:-1, 1:-1]
    ways = (((-1, 0), (0, 0), (1, 0)), ((0, 1), (1, 0), (1, 1)), ((1, 0), (1, 1), (0, 1)), ((0, -1), (0, 1), (0, 0)))
    ahead: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for (down, right), (ax, ay), (bx, by) in ways:
        beyond = padded[1 + down:padded.shape[0] - 1 + down, 1 + right:padded.shape[1] - 1 + right]
        for row, column in np.argwhere(inside & ~beyond).tolist():
            ahead.setdefault((column + ax, row + ay), []).append((column + bx, row + by))
    return ahead


def simplified(loop: np.ndarray) -> np.ndarray:
    """The closed outline (N, 2) with fewer corners, no point further than TOLERANCE_CELLS from where it was. One that would
    shrink to a line is left as it is."""
    import cv2

    fewer = cv2.approxPolyDP(loop[:-1].astype(np.float32)[:, None], TOLERANCE_CELLS, True)[:, 0].astype(float)
    return loop if len(fewer) < 3 else np.vstack([fewer, fewer[:1]])


def walls_of(grid: OccupancyGrid, room: np.ndarray) -> tuple[Wall, ...]:
    """The walls round the room and round what stands in it, the longest outline first."""
    loops = sorted(map(simplified, outlines(room)), key=lambda loop: -float(np.abs(np.diff(loop, axis=0)).sum()))
    return tuple(Wall(f"wall {number}", loop * grid.resolution_m + np.asarray(grid.origin_m), HEIGHT_M)
                 for number, loop in enumerate(loops, 1))


def no_room(name: str, grid: OccupancyGrid, radius_m: float, start_m: np.ndarray | None,
            advice: str = "") -> ConfigError:
    """What to say of a building in which the robot does not fit; advice: what may be wrong with the picture."""
    if start_m is not None:
        return ConfigError(f"{name}: no free space at the start ({start_m[0]:g}, {start_m[1]:g})")
    return ConfigError(f"{name}: no room for a robot of radius {radius_m:g} m (found {int(grid.free().sum())} free cells of "
                       f"{grid.resolution_m:g} m); {advice or 'correct the scale, or type source.robot_radius_m='}")


def roomiest_m(grid: OccupancyGrid, room: np.ndarray, need_m: float = 0.0) -> np.ndarray:
    """(2,) the middle of the cell of a room that is furthest from its edge, in the largest part of the room that keeps
    need_m from the edge: a robot that needs so much is not put where it cannot get out."""
    from scipy.ndimage import distance_transform_edt, label

    space = distance_transform_edt(np.pad(room, 1))[1:-1, 1:-1]
    parts, count = label(space * grid.resolution_m >= need_m + 0.5 * grid.resolution_m, structure=np.ones((3, 3)))
    if count > 1:
        space = np.where(parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:])), space, 0.0)
    middle: np.ndarray = grid.centres(np.array([np.unravel_index(np.argmax(space), room.shape)]))[0]
    return middle
