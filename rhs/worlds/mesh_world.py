"""A mesh or scene file as a building: metres and z up, the floor at z = 0, what stands in a robot's way seen from above."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from rhs.api.floorplan import Mesh, Person, Wall
from rhs.api.grid import OccupancyGrid, frame_of
from rhs.base.errors import ConfigError

from .gazebo import fetched
from .map_walls import DOORS_M, HEIGHT_M, Building, no_room, room_of, roomiest_m, shut_m2, shut_words
from .mesh_files import MESHES, Y_UP, MeshFile, read_mesh
from .scene_files import read_scene
from .soup import Part, dressed, sound
from .tour import MARGIN_M, SPARE_M
from .world_yaml import Section

log = logging.getLogger("rhs.worlds")

LEAST_INDOORS_M2 = 2.0  # smaller than most rooms, less what is near their walls
STEP_M = 0.04  # what is lower than this is driven over: carpets, thresholds
PAD_M = 1.0  # free ground round a building that is open to the outside
LEAST_M, MOST_M = 2.0, 300.0  # of a building's longer side in metres
LOW_M, STOREY_M, TALL_STOREY_M = 1.8, (2.2, 4.5), 5.0  # walls too low for a building; as high as in a house; perhaps in feet
LYING, FLAT = 1.5, 0.75  # times the depth: higher perhaps lies on its side, lower does not
FLOORS = 1.2  # times as much as is level as it stands would be level on its side: perhaps it lies there
MOST_STEP_M = 0.02  # between two coordinates that a file can hold
WIDEST_M = 1000.0  # with the ground it stands on
LEVEL, UPRIGHT = 0.99, 0.3  # least |z| of a level face's normal, most of a wall's
BIN_M, SPOT_M = 0.02, 0.25  # heights of one floor differ by less; squares in which its area is counted
TALL_M = 0.3  # of a wall's triangle; the rim of a slab is lower
PLINTH_M = 0.5  # of a house whose floor lies higher than the ground that its scene stands on
MOST_LEVELS = 40  # heights that are looked at, the largest first: a floor is among them
COVERED_M = 1.0  # what has so little room above it is no floor: the underside of a slab, the ground below it
LEANS = 0.05  # share of its length by which the floor of a mesh may be taken to lean: 3 degrees
CAMERA_M = 0.25  # of a household robot: it sees what is taller, also a coffee table, and drives under what is higher


def read_solid(path: Path, file: Section, radius_m: float, start_m: np.ndarray | None) -> Building:
    """The building in a mesh or scene file. Raises ConfigError in one line."""
    said: list[str] = []
    parts, people, on_ground = _upright(path, file, said)
    parts = sound(parts)
    if not parts:
        raise ConfigError(f"{path}: no triangles with an area in this file; expected a building")
    corners, uv, texture, images = dressed(parts)
    wide, deep = np.ptp(corners[..., :2], axis=(0, 1))
    if max(wide, deep) > WIDEST_M:
        raise ConfigError(f"{path}: spans {wide:.4g} x {deep:.4g} m; expected at most {WIDEST_M:g} m (another unit?)")
    floor = floor_m(corners, on_ground)
    corners[..., 2] -= floor
    height = file.number("camera_height_m", camera_m(corners), low=0.1, high=3.0)
    if STEP_M < corners[..., 2].max() <= height:
        raise ConfigError(f"{file.where('camera_height_m')}: a robot {height:g} m high looks over this building of "
                          f"{corners[..., 2].max():.2f} m; write a lower camera_height_m (or another unit_m)")
    solid = solid_of(corners, height, path)
    walls, stand, shut = _enclosed(solid, radius_m, start_m, path)
    if shut:
        said.append(shut)
    if walls:
        said.append(f"open to the outside: a fence is put up {PAD_M:g} m from it")
    if abs(floor) > BIN_M:
        said.append(f"floor found at z = {floor:.2f} m")
    if (rises_m := leaning_m(corners)) > STEP_M:
        said.append(f"its floor leans, by {rises_m:.2g} m from end to end: what is above {STEP_M:g} m is in a robot's way; "
                    "turn the mesh until it is level")
    if said:
        log.warning("%s: %s", path.name, "; ".join(said))
    return Building(walls, stand, Mesh(corners, uv, texture, images, solid), height, people)


def _upright(path: Path, file: Section, said: list[str]) -> tuple[list[Part], tuple[Person, ...], bool]:
    """Parts in metres, z up; who walks; whether the ground is z = 0 by convention, as in SDF and URDF."""
    if path.suffix.lower() not in MESHES:
        scene = read_scene(path)
        if scene.missing:
            names = list(dict.fromkeys(scene.missing))
            said.append(f"left out, as missing or unreadable: {len(names)} files or shapes ({', '.join(names[:3])}"
                        f"{', ...' if len(names) > 3 else ''}){fetched(names)}")
        if scene.robots:
            said.append(f"left out, as robots: {', '.join(scene.robots)}")
        return scene.parts, tuple(scene.people), True
    mesh = read_mesh(path)
    if mesh.missing:
        said.append(f"left out, as missing: {len(set(mesh.missing))} files ({', '.join(sorted(set(mesh.missing))[:3])})")
    low, high = _extent(mesh.parts)
    size = high - low
    up = file.text("up", "" if "up" in file.nodes else _up(mesh, size, said), choices=("y", "z"))
    unit_m = file.number("unit_m", _unit_m(mesh, size, path, said, given="unit_m" in file.nodes), low=1e-6, high=1e3)
    _check_steps(mesh.parts, unit_m, path)
    matrix = (Y_UP if up == "y" else np.eye(4)) @ np.diag([unit_m, unit_m, unit_m, 1.0])
    return [one.moved(matrix) for one in mesh.parts], (), False


def _extent(parts: tuple[Part, ...]) -> tuple[np.ndarray, np.ndarray]:
    corners = np.concatenate([one.corners_m.reshape(-1, 3) for one in parts])
    corners = corners[np.isfinite(corners).all(axis=1)]
    if not len(corners):
        return np.zeros(3), np.zeros(3)
    return corners.min(axis=0), corners.max(axis=0)


def _up(mesh: MeshFile, size: np.ndarray, said: list[str]) -> str:
    """The axis that points up: the format's, or the thinner of y and z, as buildings are wider than high. Said where the
    format does not tell, and where a building would be higher than deep: programs write z up into formats whose y is up. One
    that would be as deep as a storey is high lies on its side, and is stood up."""
    thin = "y" if size[1] < size[2] else "z"
    if mesh.up is None:
        if thin == "y":
            said.append("taken with y up (for another write up: z in a world file)")
        return thin
    if (up := mesh.up) not in ("y", "z"):
        return up
    height, other = (size[1], size[2]) if up == "y" else (size[2], size[1])
    what = f"the format's {up} is up: {height:.4g} high, {size[0]:.4g} x {other:.4g} wide"
    level, across = _level(mesh.parts), "z" if up == "y" else "y"
    if height > LYING * other and mesh.unit_m is not None and STOREY_M[0] <= other * mesh.unit_m <= STOREY_M[1]:
        said.append(f"{what}, as of a storey that lies on its side; taken with {thin} up (if it stood, write up: {up} in a "
                    "world file)")
        return thin
    if height > LYING * other or height > FLAT * other and level[across] > FLOORS * level[up]:
        said.append(f"{what}; if it lies on its side write up: {across} in a world file")
    return up


def _level(parts: Iterable[Part]) -> dict[str, float]:
    """Area of the triangles that lie level if y, or z, points up; floors and ceilings are larger than the walls that face
    one way."""
    across = np.concatenate([np.cross(one.corners_m[:, 1] - one.corners_m[:, 0], one.corners_m[:, 2] - one.corners_m[:, 0])
                             for one in parts])
    area = np.linalg.norm(across, axis=1)
    return {axis: float(np.nansum(area[np.abs(across[:, k]) > LEVEL * area])) for k, axis in ((1, "y"), (2, "z"))}


def _check_steps(parts: Iterable[Part], unit_m: float, path: Path) -> None:
    """Refuse numbers of 32 bits so far from the origin that walls are off by what lies between two of them."""
    for one in parts:
        corners = one.corners_m[np.isfinite(one.corners_m)]
        if not corners.size:
            continue
        far = float(np.abs(corners).max())
        step_m = float(np.spacing(np.float32(far))) * unit_m
        if step_m > MOST_STEP_M and (corners.astype(np.float32) == corners).all():
            raise ConfigError(f"{path}: stands {far:.3g} from the origin, where the 32-bit numbers of this file are "
                              f"{step_m:.2g} m apart: its walls are off by that; move it to the origin where it was written")


def _unit_m(mesh: MeshFile, size: np.ndarray, path: Path, said: list[str], *, given: bool) -> float:
    """Metres of the file's unit: as it says; else metres, or the smaller of millimetre and centimetre that makes a
    building; inches where its walls are too low in centimetres and as high as a storey in inches."""
    unit = mesh.unit_m or 1.0
    longest = float(size.max()) * unit
    found = f"its extents are {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g}"
    if given or LEAST_M <= longest <= MOST_M:
        if not given and mesh.unit_m is None and min(size[1], size[2]) > TALL_STOREY_M:
            said.append(f"{found}: taken as metres (feet? write unit_m: 0.3048 in a world file)")
        return unit
    if mesh.unit_m is None and longest > MOST_M:
        low_m = 0.01 * min(size[1], size[2])
        inches = 0.01 * longest <= MOST_M and low_m < LOW_M and STOREY_M[0] <= 2.54 * low_m <= STOREY_M[1]
        for guess, name in ((0.001, "millimetres"), (0.0254, "inches") if inches else (0.01, "centimetres")):
            if LEAST_M + 1.0 <= longest * guess <= MOST_M:
                said.append(f"{found}: taken as {name} (for another unit write unit_m in a world file)")
                return guess
    raise ConfigError(f"{path}: {found}, which is no building of {LEAST_M:g} to {MOST_M:g} m; give unit_m in a world file "
                      "(worlds/README.md)")


def _normals_z(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) |z| of the unit normals, and the areas."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(across, axis=1)
    return np.abs(across[:, 2]) / twice, 0.5 * twice


def floor_m(corners: np.ndarray, on_ground: bool) -> float:
    """z of the floor: the lowest of the heights at which much of the building is level, and that has room above it. Zero, by
    convention, for what stands on the ground (on_ground), unless a slab up to PLINTH_M above it lies under half of it."""
    low, high = float(corners[..., 2].min()), float(corners[..., 2].max())
    standing = on_ground and low <= 0.1 and high >= 0.3
    steep, area = _normals_z(corners)
    tall, tops = (steep < UPRIGHT) & (np.ptp(corners[..., 2], axis=1) > TALL_M), corners[..., 2].max(axis=1)
    walls = corners[tall] if tall.any() else corners
    (x0, y0), (x1, y1) = walls[..., :2].min(axis=(0, 1)).tolist(), walls[..., :2].max(axis=(0, 1)).tolist()
    shape = (max(1, int(np.ceil((y1 - y0) / SPOT_M))), max(1, int(np.ceil((x1 - x0) / SPOT_M))))
    flat, areas = corners[steep > LEVEL], area[steep > LEVEL]
    level = np.round(flat[:, 0, 2] / BIN_M).astype(int)
    largest = sorted(np.unique(level).tolist(), key=lambda b: -float(areas[level == b].sum()))[:MOST_LEVELS]
    spots = {b: _spots(flat[level == b], shape, (x0, y0)) for b in largest}
    most = max((int(s.sum()) for s in spots.values()), default=0)
    for b in sorted(spots):
        above = [s for c, s in spots.items() if STEP_M < (c - b) * BIN_M < COVERED_M]
        roofed = spots[b] & np.logical_or.reduce(above) if above else np.zeros(shape, bool)
        if tall.any() and area[tall & (tops > b * BIN_M + TALL_M)].sum() < 0.1 * area[tall].sum():
            continue  # the tops of walls
        if standing and (not STEP_M < b * BIN_M <= PLINTH_M or spots[b].mean() < 0.5):
            continue
        if spots[b].sum() >= 0.25 * most and roofed.sum() < 0.5 * spots[b].sum():
            return float(np.median(flat[level == b, 0, 2]))
    return 0.0 if standing else low


def leaning_m(corners: np.ndarray) -> float:
    """How much the floor rises from one end of the building to the other, if it is one that leans, as of a scan that was
    levelled by eye. corners (N, 3, 3): the floor at z = 0; its ends may be LEANS higher or lower."""
    wide_m = float(np.ptp(corners[..., :2], axis=(0, 1)).max())
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    steep, _ = _normals_z(corners)
    lowest = (steep > LEVEL) & (np.abs(corners[..., 2]).max(axis=1) < min(LEANS * wide_m, COVERED_M))
    if not lowest.any():
        return 0.0
    up = (across * np.sign(across[:, 2:]))[lowest]
    # of most of it, by the median: a ramp is no floor that leans
    slopes = [np.quantile(up[:, k] / up[:, 2], 0.5, weights=up[:, 2], method="inverted_cdf") for k in (0, 1)]
    return float(np.linalg.norm(slopes)) * wide_m


def _spots(triangles: np.ndarray, shape: tuple[int, int], origin: tuple[float, float]) -> np.ndarray:
    """(H, W) bool: squares of SPOT_M that level triangles touch."""
    from rhs.api.footprints import outlines_between, touch

    touched = np.zeros(shape, bool)
    touch(outlines_between(triangles, -np.inf, np.inf), SPOT_M, float(origin[0]), float(origin[1]), touched)
    return touched


def camera_m(corners: np.ndarray) -> float:
    """Height of the camera where nobody says: CAMERA_M, or lower where the walls are: six tenths of what nine tenths of them
    reach."""
    steep, area = _normals_z(corners)
    upright = (steep < UPRIGHT) & (corners[..., 2].max(axis=1) > STEP_M)
    if not upright.any():
        return CAMERA_M
    reached = np.quantile(corners[upright][..., 2].max(axis=1), 0.9, weights=area[upright], method="inverted_cdf")
    return float(np.clip(0.05 * np.floor(0.6 * reached / 0.05 + 1e-9), 0.15, CAMERA_M))


def solid_of(corners: np.ndarray, height_m: float, path: Path) -> np.ndarray:
    """(P, 5, 2) outlines of what stands higher than a step and lower than the robot."""
    from rhs.api.footprints import outlines_between

    solid = outlines_between(corners, STEP_M, height_m)
    if not len(solid):
        raise ConfigError(f"{path}: nothing stands between {STEP_M:g} and {height_m:g} m above the floor; expected walls "
                          "(another floor, unit or up axis? see worlds/README.md)")
    return solid


def _enclosed(solid: np.ndarray, radius_m: float, start_m: np.ndarray | None,
              path: Path) -> tuple[tuple[Wall, ...], np.ndarray, str]:
    """A fence if the robot could leave, a point with room round it, and what to say of rooms that nothing leads to."""
    from rhs.api.footprints import touch

    (x0, y0), (x1, y1) = (solid.min(axis=(0, 1)) - PAD_M).tolist(), (solid.max(axis=(0, 1)) + PAD_M).tolist()
    step = 0.1 if (x1 - x0) * (y1 - y0) < 40_000.0 else 1.0  # larger worlds are refused by their checks
    shape, origin = frame_of((x0, y0, x1, y1), step)
    touched = np.zeros(shape, bool)
    touch(solid, step, *origin, touched)
    grid = OccupancyGrid(touched.astype(np.float32), step, origin)
    room = room_of(grid, radius_m, start_m)
    if not room.any():
        raise no_room(str(path), grid, radius_m, start_m)
    outside = room[0].any() or room[-1].any() or room[:, 0].any() or room[:, -1].any()
    x0, y0, x1, y1 = np.floor(10 * x0) / 10, np.floor(10 * y0) / 10, np.ceil(10 * x1) / 10, np.ceil(10 * y1) / 10
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
    fence = (Wall("fence", corners, HEIGHT_M),) if outside else ()
    stand = roomiest_m(grid, _indoors(grid, room) if outside else room, radius_m + MARGIN_M + SPARE_M)
    return fence, stand, shut_words(shut_m2(grid, stand if start_m is None else start_m, radius_m))


def _indoors(grid: OccupancyGrid, room: np.ndarray) -> np.ndarray:
    """(H, W) bool: the cells of a room that is open to the outside which lie behind its doors: where something wider than a
    door does not get to from outside. The room itself where there is no such place of some size."""
    from scipy.ndimage import distance_transform_edt, label

    wide = round(DOORS_M / grid.resolution_m)
    around = np.pad(~grid.occupied(), 2 * wide, constant_values=True)
    spaces, _ = label(distance_transform_edt(around) >= 0.5 * DOORS_M / grid.resolution_m)
    cut = spaces[2 * wide:-2 * wide, 2 * wide:-2 * wide]
    inside = room & (cut > 0) & (cut != spaces[0, 0])
    return inside if inside.sum() * grid.resolution_m**2 >= LEAST_INDOORS_M2 else room

