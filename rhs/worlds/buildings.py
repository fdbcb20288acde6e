"""Somebody else's building: a flat map or a drawn plan pulled up into walls, a mesh, a scene. Where the robot starts, what
it visits and how it is led are proposed where nobody says."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from rhs.api.floorplan import World, truth_grid
from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

from .clearance import clearance_of, coarser, ways_m
from .house_expo import floor_in
from .map_walls import Building, behind_doors, no_room, room_of, roomiest_m, shut_m2, shut_words, walls_of
from .maps import advice_on, load_map, odd_shades, read_header, writing_in
from .mesh_files import MESHES
from .mesh_world import read_solid
from .near_walls import keep_near_walls
from .other_maps import advice_for
from .others.rmf import level_in
from .others.stage import plan_in
from .robot import shape_of
from .scene_files import SCENES
from .tour import MARGIN_M, MOST_CELLS, SPARE_M, Place, Tour, ground_of, propose
from .world_checks import walk_fault
from .world_yaml import FAR_M, Section

log = logging.getLogger("rhs.worlds")

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".webp", ".tif", ".tiff", ".gif")
FOREIGN = (*PICTURES, *MESHES, *SCENES)
MOST_PIECES = 20_000  # of wall: each is a face to draw and a body to touch
RADIUS_M = 0.2  # of the robot where nobody says: a household robot's, such as TurtleBot 3's 0.11 to 0.22 or a Roomba's 0.17
TRY = "try negate: 1 for a dark floor, another resolution or unit, fewer specks, or source.robot_radius_m="
WRITING = 5  # so many small marks in a drawn plan are likely to be a word
APART_M = 0.5  # places that are proposed
LEAST_ROOM_M2 = 1.0  # where a robot's middle has room
LEAST_ROUTE_M = 0.5  # less is no patrol: the robot has room where it stands and nowhere else
MOST_M2 = 1000.0  # of floor that a route of LONGEST_ROUTE_M is looked for on: several times what it passes
LONGEST_ROUTE_M = 60.0  # of a route that is proposed where nobody says: a survey of 60 m is 300 views and its turns
SHORTEST_M, FARTHEST_M = 20.0, 10_000.0  # that somebody may say


def read_building(path: Path, file: Section) -> Building:
    """The building in a file of any format that is read. Raises ConfigError in one line."""
    if not path.is_file():
        raise ConfigError(f"{file.where('building')}: building: there is no file {path}")
    radius_m, _ = shape_of(file, RADIUS_M)
    start_m = np.array(file.numbers("start", count=3, low=-FAR_M, high=FAR_M)[:2]) if "start" in file.nodes else None
    if path.suffix.lower() == ".world" and (plan := plan_in(path)) is not None:
        return building_of(plan, radius_m, start_m, path)
    if path.suffix.lower() in (*MESHES, *SCENES):
        return read_solid(path, file, radius_m, start_m)
    drawn = path.suffix.lower() in PICTURES
    path = _yaml_of(path) if drawn else path
    if path.suffix.lower() == ".xacro":
        raise ConfigError(f"{path}: a xacro is a recipe of a file; expand it first: xacro {path.name} > "
                          f"{Path(path.stem).stem}.urdf")
    if path.suffix.lower() == ".json" and (floor := floor_in(path)) is not None:
        return building_of(floor, radius_m, start_m, path)
    if path.suffix.lower() not in (".yaml", ".yml"):
        if advice := advice_for(path):
            raise ConfigError(f"{path}: {advice}")
        raise ConfigError(f"{path}: no building is read from {path.suffix or 'such'} files; expected a map (.yaml), a plan "
                          f"({', '.join(PICTURES)}), a scene ({', '.join(SCENES)}) or a mesh ({', '.join(MESHES)})")
    if not drawn and (level := level_in(path)) is not None:
        return building_of(level, radius_m, start_m, path)
    map_from_image = _map_from_image(path)
    if start_m is not None:
        start_m = (np.linalg.inv(map_from_image) @ (*start_m, 1.0))[:2]
    grid = load_map(path, origin=(0.0, 0.0, 0.0), turned=False)
    if odd := odd_shades(path):
        log.warning("%s: %s", path.name, odd)
    if drawn and (marks := writing_in(grid)) >= WRITING:
        log.warning("%s: %d marks of less than 1 m stand apart from every wall, and are built: if they are writing, write "
                    "marks_m: 1 in %s", path.stem, marks, path.name)
    return _turned(building_of(known_part(grid), radius_m, start_m, path, advice=partial(advice_on, path)), map_from_image)


def _map_from_image(path: Path) -> np.ndarray:
    """(3, 3) that turns a map, read as if it had no yaw, about its corner: walls are turned, not cells, and doors stay as
    wide as they are."""
    x, y, yaw = read_header(path, origin=(0.0, 0.0, 0.0)).origin
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, x - c * x + s * y], [s, c, y - s * x - c * y], [0.0, 0.0, 1.0]])


def _turned(building: Building, map_from_image: np.ndarray) -> Building:
    def turned(points_m: np.ndarray) -> np.ndarray:
        out: np.ndarray = points_m @ map_from_image[:2, :2].T + map_from_image[:2, 2]
        return out

    if np.array_equal(map_from_image, np.eye(3)):
        return building
    return replace(building, stand_m=turned(building.stand_m),
                   walls=tuple(replace(wall, points_m=turned(wall.points_m)) for wall in building.walls))


def _yaml_of(picture: Path) -> Path:
    """The file beside a picture that says how large a pixel is."""
    path = picture.with_suffix(".yaml")
    if not path.is_file():
        raise ConfigError(f"{picture}: nobody says how large this plan is; write {path.name} beside it with the lines "
                          f"`image: {picture.name}` and `resolution: 0.05` (metres a pixel)")
    return path


def known_part(grid: OccupancyGrid) -> OccupancyGrid:
    """The grid without the unknown round what is known, where that is most of it: maps are saved on large grey sheets."""
    known = ~np.isnan(grid.probability)
    rows, columns = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return grid
    (top, left), (bottom, right) = (max(0, rows[0] - 1), max(0, columns[0] - 1)), (rows[-1] + 2, columns[-1] + 2)
    part = grid.probability[top:bottom, left:right]
    if 2 * part.size > grid.probability.size:
        return grid
    x, y = grid.origin_m
    return OccupancyGrid(part.copy(), grid.resolution_m, (x + left * grid.resolution_m, y + top * grid.resolution_m))


def building_of(grid: OccupancyGrid, radius_m: float, start_m: np.ndarray | None, path: Path,
                advice: Callable[[], str] = str) -> Building:
    """The room of a flat map that holds the start, or the roomiest one. Raises ConfigError where the robot does not fit;
    advice: what may then be wrong with its picture."""
    room = room_of(grid, radius_m, start_m)
    if not room.any():
        raise no_room(str(path), grid, radius_m, start_m, advice())
    if start_m is None and (inside := behind_doors(grid, room, radius_m)).sum() < room.sum():
        room = inside
        log.warning("%s: its doors to the paper round it are shut (to drive there too give start in a world file)",
                    path.name)
    stand = roomiest_m(grid, room, radius_m + MARGIN_M + SPARE_M)
    if said := shut_words(shut_m2(grid, stand if start_m is None else start_m, radius_m)):
        log.warning("%s: %s", path.name, said)
    walls = walls_of(grid, room)
    pieces = sum(len(wall.points_m) - 1 for wall in walls)
    if pieces > MOST_PIECES:
        raise ConfigError(f"{path}: {pieces} pieces of wall, at most {MOST_PIECES} are pulled up; clean the map of specks")
    return Building(walls, stand)


def longest_route_m(file: Section) -> float:
    """How long a route may be that is proposed: survey_m of the file, metres. Raises ConfigError where none is proposed."""
    if "survey_m" in file.nodes and "route_m" in file.nodes:
        raise ConfigError(f"{file.where('route_m')}: the survey is written already (route_m), survey_m is of one that is "
                          "proposed; leave out one of them")
    return file.number("survey_m", LONGEST_ROUTE_M, low=SHORTEST_M, high=FARTHEST_M)


def settled(world: World, building: Building, file: Section) -> World:
    """The world with a start, places and a route: those that the file gives, the others proposed."""
    given = {key for key in ("start", "places", "route_m") if key in file.nodes}
    if "start" not in given and "route_m" in given:
        raise ConfigError(f"{file.where('route_m')}: route_m without start; write start: [x, y, degrees] where it begins")
    if given == {"start", "places", "route_m"}:
        return world
    x, y = (round(float(value), 4) for value in building.stand_m)
    inside = world if "start" in given else replace(world, start=(x, y, 0.0))
    start: tuple[float, ...] = world.start if "start" in given else (x, y)
    places: int | tuple[Place, ...] = world.places if "places" in given else 4
    floor = grid = truth_grid(inside)
    try:
        left = rooms_left_m2(grid, world.robot_radius_m, start)
        if left:  # half a cell decides whether a door is wide enough
            grid = truth_grid(inside, 0.5 * grid.resolution_m)
            left = rooms_left_m2(grid, world.robot_radius_m, start)
        if left and 4 * grid.probability.size <= MOST_CELLS:  # walls askew fill more cells than they are thick
            finer = truth_grid(inside, 0.5 * grid.resolution_m)
            still = rooms_left_m2(finer, world.robot_radius_m, start)
            grid, left = (finer, still) if len(still) < len(left) else (grid, left)
        if isinstance(places, int):
            need_m, floor = world.robot_radius_m + MARGIN_M + SPARE_M, grid
            grid, start = keep_near_walls(grid, start, need_m, given=not given.isdisjoint(("start", "route_m")))
        tour = short_tour(grid, world.robot_radius_m, start=start, places=places, name=world.name,
                          longest_m=longest_route_m(file), floor=floor)
    except ConfigError as error:
        what = f"; {TRY}" if isinstance(places, int) else ""
        raise ConfigError(f"{world.path}: {error}{what}") from error
    if length_m(tour.route_m) < LEAST_ROUTE_M:
        x, y = tour.start[:2]
        raise ConfigError(f"{world.path}: a robot of radius {world.robot_radius_m:g} m has nowhere to go from ({x:.2f}, "
                          f"{y:.2f}); {TRY}")
    if left:
        log.warning("%s: the route leaves out %d room%s of %.0f m2 in all, with no door of %.2f m to it; a smaller robot: "
                    "source.robot_radius_m=", world.name, len(left), "s" if len(left) > 1 else "", sum(left),
                    2.0 * (world.robot_radius_m + MARGIN_M))
    return replace(world, start=world.start if "route_m" in given else tour.start,
                   places=world.places if "places" in given else on_route(tour.places, tour.route_m),
                   route_m=world.route_m if "route_m" in given else tour.route_m)


def rooms_left_m2(grid: OccupancyGrid, radius_m: float, start: tuple[float, ...]) -> list[float]:
    """Square metres where a robot of that radius has room, in each part of a plan that it cannot get to from its start with
    MARGIN_M to spare; parts of less than LEAST_ROOM_M2 are no room."""
    from scipy.ndimage import label

    coarse = coarser(grid, MOST_CELLS)
    wide = clearance_of(coarse) >= radius_m + MARGIN_M + SPARE_M
    regions, _ = label(wide, structure=np.ones((3, 3)))
    cells = np.argwhere(wide)
    if not len(cells):
        return []
    gaps_m = np.hypot(*(coarse.centres(cells) - start[:2]).T)
    areas_m2 = np.bincount(regions.ravel())[1:] * coarse.resolution_m**2
    here = int(regions[tuple(cells[np.argmin(gaps_m)])])
    return [float(area) for number, area in enumerate(areas_m2, 1) if number != here and area >= LEAST_ROOM_M2]


def peopled(world: World, building: Building) -> World:
    """The world with those who walk in the building; whose way leads through a wall is left out, and that is said."""
    people, left = list(world.moving.people), []
    for person in building.people:
        if person.name in {other.name for other in people} or walk_fault(world, person):
            left.append(person.name)
        else:
            people.append(person)
    if left:
        log.warning("%s: left out, as they walk through walls or outside: %s", world.name, ", ".join(left[:5]))
    return replace(world, moving=replace(world.moving, people=tuple(people)))


def on_route(places: tuple[Place, ...], route_m: np.ndarray) -> tuple[Place, ...]:
    """Each place moved to the nearest point of the route (N, 2): a camera that looks ahead has not seen all that lies beside
    its way. One that thereby comes within APART_M of another, or of the last, is left out."""
    a, along = route_m[:-1], np.diff(route_m, axis=0)
    squared = np.maximum((along * along).sum(axis=1), 1e-12)
    moved: list[Place] = []
    for name, x, y in (places[-1], *places[:-1]):  # the last is home
        share = np.clip((((x, y) - a) * along).sum(axis=1) / squared, 0.0, 1.0)
        feet = a + share[:, None] * along
        foot = feet[np.argmin(np.hypot(*(feet - (x, y)).T))].round(4)
        if all(math.dist(foot, other[1:]) >= APART_M for other in moved):
            moved.append((name, float(foot[0]), float(foot[1])))
    return (*moved[1:], moved[0])


def short_tour(grid: OccupancyGrid, radius_m: float, *, start: tuple[float, ...], places: int | tuple[Place, ...],
               name: str, longest_m: float = LONGEST_ROUTE_M, floor: OccupancyGrid | None = None) -> Tour:
    """A tour of what lies near its start, in a large building; says so. longest_m bounds its length where no places
    (name, x, y) are given that it must pass. floor: the whole of it, where grid leaves out the middle of halls."""
    if not isinstance(places, int):
        tour = propose(grid, radius_m, start=start, places=places)
        if (found_m := length_m(tour.route_m)) > longest_m:
            log.warning("%s: the route that is proposed passes all places and sees all floor: %.0f m, some %d views (for a "
                        "shorter one give route_m)", name, found_m, _views(found_m))
        return tour
    part = _nearest_floor(grid, np.array(start[:2]), MOST_M2 * longest_m / LONGEST_ROUTE_M)
    tour = propose(part, radius_m, start=start, places=places)
    whole_m = length_m(tour.route_m)
    if whole_m <= longest_m and part is grid:
        return tour
    away_m = ways_m(part.free(), part.resolution_m, part.cells(np.array(tour.start[:2]))[0])
    reach_m, found_m = float(away_m[np.isfinite(away_m)].max()), whole_m
    while found_m > longest_m:
        reach_m *= max(0.5, min(0.9, longest_m / found_m))
        near = np.where(away_m <= reach_m, grid.probability, np.nan).astype(np.float32)
        tour = propose(OccupancyGrid(near, grid.resolution_m, grid.origin_m), radius_m, start=tour.start, places=places)
        found_m = length_m(tour.route_m)
    if part is not grid:  # as much longer as there is more floor
        whole_m *= ground_of(grid, radius_m, tour.start).reached_m2 / ground_of(part, radius_m, tour.start).reached_m2
    ground = ground_of(grid if floor is None else floor, radius_m, tour.start)
    but = "" if floor is None or floor is grid else " but the middle of halls"
    type_m = min(FARTHEST_M, 10.0 * math.ceil(0.1 * whole_m))
    log.warning("%s: the route that is proposed, %.0f m within %.0f m of the start, sees %.0f %% of the %.0f m2 that the "
                "robot can get to, and the places lie on it; for all of it%s type source.survey_m=%.0f (some %d views)",
                name, found_m, reach_m, 100.0 * ground.share_seen(tour.route_m), ground.reached_m2, but, type_m,
                _views(whole_m))
    return tour


def _views(route_m: float) -> int:
    """That a survey of so many metres takes, its turns included: about ten a metre."""
    return 100 * math.ceil(0.1 * route_m)


def _nearest_floor(grid: OccupancyGrid, start_m: np.ndarray, most_m2: float) -> OccupancyGrid:
    """The grid, free only in the most_m2 whose ways from start_m (2,) are shortest; itself where it has no more."""
    start = grid.cells(start_m)[0]
    if grid.free().sum() * grid.resolution_m**2 <= most_m2 or not grid.free()[tuple(start)]:
        return grid
    away_m = ways_m(grid.free(), grid.resolution_m, start)
    count = int(most_m2 / grid.resolution_m**2)
    reach_m = np.partition(away_m.ravel(), count)[count]
    near = np.where(away_m <= reach_m, grid.probability, np.nan).astype(np.float32)
    return OccupancyGrid(near, grid.resolution_m, grid.origin_m)


def length_m(route_m: np.ndarray) -> float:
    """Metres along a polyline (N, 2)."""
    return float(np.hypot(*np.diff(route_m, axis=0).T).sum())
