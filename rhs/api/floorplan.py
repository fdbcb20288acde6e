"""What a world is: walls, boxes, places, route; and its true plan as a grid.

All lengths in metres, angles in radians, world frame: x east, y north, z up, the floor at z = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .grid import OccupancyGrid, frame_of
from .records import WorldFacts
from .robot_shape import Footprint

OBSTACLE_HEIGHT_M = 1.8  # of boxes that are put in by x, y, width and depth alone


@dataclass(frozen=True)
class Surface:
    """How a surface looks. recipe: plaster, brick, wood, carpet, tiles or plain; colour: mean RGB, 0..255;
    roughness: amplitude of the pattern in grey levels; fold: 1, 2 or 4, rotational symmetry about the middle."""

    recipe: str = "plaster"
    colour: tuple[float, float, float] = (200.0, 195.0, 185.0)
    roughness: float = 12.0
    fold: int = 1


@dataclass(frozen=True)
class Blank:
    """A stretch of a wall with neither painting nor pattern: from_m to to_m along segment number `segment`."""

    segment: int
    from_m: float
    to_m: float


@dataclass(frozen=True, eq=False)
class Wall:
    """A wall standing on a polyline. points_m (N, 2); height in metres; `paintings`: whether any hang on it.

    twins (N-1,): segments of this wall with the same number look the same; empty: all differ.
    """

    name: str
    points_m: np.ndarray
    height_m: float
    surface: Surface = field(default_factory=Surface)
    paintings: bool = True
    twins: tuple[int, ...] = ()
    blanks: tuple[Blank, ...] = ()

    @property
    def segments_m(self) -> np.ndarray:
        """(N-1, 2, 2) start and end of each straight piece."""
        return np.stack([self.points_m[:-1], self.points_m[1:]], axis=1)


@dataclass(frozen=True)
class Box:
    """A box on the floor or above it: centre x, y; size along its own axes and up; yaw; height of its underside."""

    name: str
    centre_m: tuple[float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    bottom_m: float = 0.0
    surface: Surface = field(default_factory=lambda: Surface(recipe="wood", colour=(150.0, 110.0, 70.0)))

    @property
    def corners_m(self) -> np.ndarray:
        """(4, 2) corners of its footprint, counter-clockwise."""
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(self.size_m[:2])
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        corners: np.ndarray = half[:, :1] * (c, s) + half[:, 1:] * (-s, c) + np.array(self.centre_m)
        return corners


@dataclass(frozen=True)
class Paintings:
    """unique: how many different ones exist; density 0..1: share of the hanging places in use; spacing_m: distance
    between hanging places; width_m, height_m: least and greatest size; middle_m: of the picture above the floor."""

    unique: int = 1000
    density: float = 1.0
    spacing_m: float = 2.0
    width_m: tuple[float, float] = (0.8, 1.5)
    height_m: tuple[float, float] = (0.7, 1.1)
    middle_m: float = 1.4


@dataclass(frozen=True, eq=False)
class Mesh:
    """A building as somebody else drew it, in metres, floor at z = 0.

    corners_m (N, 3, 3): triangles, seen from both sides; uv (N, 3, 2): u right, v up, 0..1 over the image and on in copies
    of it; texture (N,): which of images, each (H, W, 3) uint8 RGB. solid_m (P, 5, 2): convex outlines, seen from above, of
    what stands in a robot's way (rhs.api.footprints)."""

    corners_m: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    images: tuple[np.ndarray, ...]
    solid_m: np.ndarray


@dataclass(frozen=True)
class Light:
    """Of the patrol against the survey's, which lights everything alike. brightness: factor on all colours. lamp_rad: where
    a lamp stands, as an angle in the world; what faces it is brighter by LAMP_SHARE, what faces away darker."""

    brightness: float = 1.0
    lamp_rad: float | None = None


LAMP_SHARE = 0.3


@dataclass(frozen=True)
class Changes:
    """What is otherwise on patrol than it was on the survey, besides the world's obstacles. removed: names of boxes;
    moved: (name of a box, x m, y m, yaw rad)."""

    removed: tuple[str, ...] = ()
    moved: tuple[tuple[str, float, float, float], ...] = ()
    light: Light = Light()


@dataclass(frozen=True, eq=False)
class Person:
    """A person, or a pet, who walks a closed path: an upright cylinder.

    path_m (N, 2): corners; the last is joined to the first. pauses_s: at each corner, or empty. start_m: along the path,
    where the walk begins. keep_m: nearer to the robot's side nobody steps; who would, stands, and after patience_s turns
    round. shy: runs off along the path before a robot that comes as near, at 1 m/s or the own speed.
    survey: walks during the survey too, from its beginning, and makes way for a camera that is led; else is not there."""

    name: str
    path_m: np.ndarray
    speed_mps: float = 0.8
    pauses_s: tuple[float, ...] = ()
    start_m: float = 0.0
    width_m: float = 0.4
    height_m: float = 1.7
    keep_m: float = 0.4
    patience_s: float = 3.0
    shy: bool = False
    survey: bool = False
    surface: Surface = field(default_factory=lambda: Surface("carpet", (70.0, 90.0, 140.0), 30.0))


@dataclass(frozen=True)
class Timed:
    """A box that stands there at times: in each span of stands_s, from (first) until (second), and again every every_s
    (0: once). otherwise: where it is else, None: nowhere. During the survey it is as it is at 0."""

    box: Box
    stands_s: tuple[tuple[float, float], ...]
    every_s: float = 0.0
    otherwise: Box | None = None

    def at(self, now_s: float) -> Box | None:
        """Where it should stand now."""
        now = now_s % self.every_s if self.every_s > 0.0 else now_s
        return self.box if any(low <= now < high for low, high in self.stands_s) else self.otherwise


@dataclass(frozen=True)
class Moving:
    """What moves in a world by itself (rhs.worlds.live moves it); times in seconds since the patrol began.
    light_s: (time, brightness) in order of time, straight lines between; it multiplies the world's light."""

    people: tuple[Person, ...] = ()
    timed: tuple[Timed, ...] = ()
    light_s: tuple[tuple[float, float], ...] = ()

    @property
    def still(self) -> bool:
        """Whether nothing moves."""
        return not (self.people or self.timed or self.light_s)

    def brightness(self, now_s: float) -> float:
        """Factor on all colours now."""
        if not self.light_s:
            return 1.0
        times, values = zip(*self.light_s, strict=True)
        return float(np.interp(now_s, times, values))


@dataclass(frozen=True, eq=False)
class World:
    """A building. start: (x m, y m, yaw rad). places: (name, x m, y m). route_m (N, 2): the survey from the start on.

    obstacles are unknown to the survey and put in when the patrol begins, and `changes` happen then: see `after`. path: the
    file it was read from. mesh: somebody else's building, which may stand there without walls. light: as it is now.
    moving: what moves by itself, which no plan shows. camera_pitch_deg: how far the camera looks down. footprint: of a robot
    that is not round; robot_radius_m is then that of the circle about its turning point that holds it.
    """

    name: str
    path: Path
    start: tuple[float, float, float]
    robot_radius_m: float
    camera_height_m: float
    walls: tuple[Wall, ...]
    boxes: tuple[Box, ...]
    obstacles: tuple[Box, ...]
    places: tuple[tuple[str, float, float], ...]
    route_m: np.ndarray
    paintings: Paintings
    floor: Surface
    ceiling: Surface
    seed: int
    mesh: Mesh | None = None
    changes: Changes = Changes()
    light: Light = Light()
    moving: Moving = Moving()
    camera_pitch_deg: float = 0.0
    footprint: Footprint | None = None

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) of the walls, and of what is solid of a mesh."""
        corners = [wall.points_m for wall in self.walls]
        points = np.concatenate([*corners, *([] if self.mesh is None else [self.mesh.solid_m.reshape(-1, 2)])])
        return (*map(float, points.min(axis=0)), *map(float, points.max(axis=0)))  # type: ignore[return-value]

    def facts(self) -> WorldFacts:
        """What a person commissioning the robot would tell it."""
        return WorldFacts(self.name, self.start, self.places, self.bounds_m, self.robot_radius_m, self.footprint)


def after(world: World) -> World:
    """The world of the patrol: boxes removed and moved, obstacles put in, lit anew. The world itself if nothing changes."""
    if not world.obstacles and world.changes == Changes():
        return world
    moved = {name: (x, y, yaw) for name, x, y, yaw in world.changes.moved}
    boxes = tuple(_stood(box, moved.get(box.name)) for box in world.boxes if box.name not in world.changes.removed)
    return replace(world, boxes=boxes + world.obstacles, obstacles=(), changes=Changes(), light=world.changes.light)


def _stood(box: Box, stand: tuple[float, float, float] | None) -> Box:
    return box if stand is None else replace(box, centre_m=stand[:2], yaw_rad=stand[2])


def mapping_grid_frame(world: World | WorldFacts, resolution_m: float) -> tuple[tuple[int, int], tuple[float, float]]:
    """((rows, columns), origin_m) of every grid of this world, the robot's map and the true plan alike."""
    return frame_of(world.bounds_m, resolution_m)


def truth_grid(world: World, resolution_m: float = 0.1) -> OccupancyGrid:
    """The true plan: 1 where a wall or box touches the cell, 0 where the robot's centre point could get from the start
    without crossing one, NaN elsewhere (solid cores of the building, outside). That of the patrol: of `after(world)`."""
    touched = touched_cells(world, resolution_m)
    shape, origin = mapping_grid_frame(world, resolution_m)
    grid = OccupancyGrid(np.full(shape, np.nan, np.float32), resolution_m, origin)
    row, column = grid.cells(np.array(world.start[:2]))[0]
    probability = grid.probability.copy()
    if 0 <= row < shape[0] and 0 <= column < shape[1]:
        from scipy.ndimage import label

        regions, _ = label(~touched)
        if regions[row, column] > 0:
            probability[regions == regions[row, column]] = 0.0
    probability[touched] = 1.0
    return OccupancyGrid(probability, resolution_m, origin)


def touched_cells(world: World, resolution_m: float) -> np.ndarray:
    """(H, W) bool in the frame of `mapping_grid_frame`: some wall or box touches the cell.

    A box touches the cells whose inside it meets. So does a wall, which has no thickness; one that runs along the border
    between two rows of cells touches both rows, so that no wall is lost wherever it stands.
    """
    shape, origin = mapping_grid_frame(world, resolution_m)
    touched = np.zeros(shape, bool)
    polygons = [segment for wall in world.walls for segment in wall.segments_m]
    polygons += [box.corners_m for box in world.boxes]
    for polygon in polygons:
        _touch(touched, polygon, resolution_m, origin)
    if world.mesh is not None:
        from .footprints import touch

        touch(world.mesh.solid_m, resolution_m, *origin, touched)
    return touched


_MEET_M = 1e-6  # what meets by less is beside each other: world files are written in decimals, borders computed


def _touch(touched: np.ndarray, polygon: np.ndarray, resolution_m: float, origin: tuple[float, float]) -> None:
    """Set the cells that a convex polygon (N, 2), or a segment, touches: separating axes of polygon and square."""
    half = 0.5 * resolution_m
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    first = np.maximum(np.floor((low - origin) / resolution_m).astype(int) - 1, 0)
    last = np.minimum(np.floor((high - origin) / resolution_m).astype(int) + 2, touched.shape[::-1])
    if np.any(first >= last):
        return
    x = (np.arange(first[0], last[0]) + 0.5) * resolution_m + origin[0]
    y = (np.arange(first[1], last[1]) + 0.5) * resolution_m + origin[1]
    axes = [np.array([1.0, 0.0]), np.array([0.0, 1.0])]
    axes += [np.array([-e[1], e[0]]) / np.hypot(*e) for e in np.diff(polygon, axis=0)]
    meets = np.ones((len(y), len(x)), bool)
    for axis in axes:
        shadow = polygon[:, 0] * axis[0] + polygon[:, 1] * axis[1]
        thin = np.ptp(shadow) <= 2.0 * _MEET_M
        reach = half * np.abs(axis).sum() + (_MEET_M if thin else -_MEET_M)
        centre = axis[0] * x[None, :] + axis[1] * y[:, None]
        meets &= (centre + reach >= shadow.min()) & (centre - reach <= shadow.max())
    touched[first[1] : last[1], first[0] : last[0]] |= meets


def distance_m(world: World, point_m: np.ndarray) -> tuple[float, str]:
    """Distance in metres from a point (2,) to the nearest wall or box, 0 inside a box, and the name of that thing."""
    best, name = np.inf, ""
    for wall in world.walls:
        d = _to_polyline(np.asarray(point_m), wall.points_m)
        if d < best:
            best, name = d, f"wall '{wall.name}'"
    for box in world.boxes:
        c, s = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
        x, y = np.asarray(point_m) - box.centre_m
        local = np.array([c * x + s * y, -s * x + c * y])
        d = float(np.hypot(*np.maximum(np.abs(local) - 0.5 * np.array(box.size_m[:2]), 0.0)))
        if d < best:
            best, name = d, f"box '{box.name}'"
    if world.mesh is not None:
        from .footprints import nearest_m

        d = nearest_m(world.mesh.solid_m, float(point_m[0]), float(point_m[1]), best)
        if d < best:
            best, name = d, "the building"
    return float(best), name


def _to_polyline(point: np.ndarray, points_m: np.ndarray) -> float:
    a, way = points_m[:-1], np.diff(points_m, axis=0)
    along = np.clip(((point - a) * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-12), 0.0, 1.0)
    return float(np.hypot(*(point - a - along[:, None] * way).T).min())
