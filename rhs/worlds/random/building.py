"""A building by family and number: drawn, turned, led through, furnished with obstacles, checked; drawn again if it fails.

A pure function of the family, its number and the word after `+`: everything comes from generators named after them, and
every coordinate is rounded to a tenth of a millimetre. The obstacles have a generator of their own: `+plain` is the same
building without them. So have the people, the barriers, and the things that are moved.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.floorplan import Box, Wall, World, after, truth_grid
from rhs.api.grid import OccupancyGrid
from rhs.api.randomness import generator
from rhs.api.robot_shape import footprint_of
from rhs.base.errors import ConfigError, RhsError

from ..tour import tour_on
from ..world_checks import check_world
from .askew import draw_non_manhattan
from .hall import draw_hall
from .looks import looks
from .loops import draw_ladder, draw_loop
from .names import parse
from .obstacles import movable, with_drawn_barriers, with_drawn_moves, with_drawn_obstacles
from .people import with_drawn_people
from .rooms import draw_home, draw_office
from .shapes import edges_of, nearest_gap_m, turned, within
from .sketch import Room, Sketch

DRAWINGS: Mapping[str, Callable[[Sketch], None]] = {
    "loop": draw_loop, "ladder": draw_ladder, "office": draw_office, "home": draw_home, "hall": draw_hall,
    "non_manhattan": draw_non_manhattan}
MOST_DRAWS = 60  # of one building; about one in five is drawn twice
MARGIN_M = 0.1  # the survey keeps the robot's radius and this from everything
CELL_M = 0.1
PITCH_DEG = 15.0  # a level camera at 0.9 m sees the floor from 2.3 m on, one that looks down so far from 1.2 m
NEAR_M = 1.3  # a place may be moved so far to where the robot can stand
AREA_M2 = (18.0, 110.0)  # free floor, furniture taken off: a patrol of a minute or two


class Unfit(RhsError):
    """What was drawn is no building to drive in; the next one is drawn."""


class _Drawn:
    """Stands for the lines of a file in the words of the checks."""

    def __init__(self, name: str) -> None:
        self.name = name

    def where(self, key: str = "") -> str:
        """The building, for want of a line."""
        return f"{self.name}: {key}"


def random_world(name: str, seed: int = 0, robot: Mapping[str, Any] | None = None) -> World:
    """The building of `random:FAMILY[+WORD][/NUMBER]` (rhs.worlds.random.names); without a number its number is `seed`.
    robot: of rhs.worlds.world.load_world, in place of the one that was drawn with it.

    Raises ConfigError for a family that is not there, and for a robot that cannot be led through it."""
    named = parse(name)
    world = _world(named.family, named.word, seed if named.number is None else named.number)
    if robot:
        footprint = footprint_of(robot.get("footprint_m", ()), "footprint_m")
        radius_m = robot.get("robot_radius_m", world.robot_radius_m) if footprint is None else footprint.radius_m
        world = _checked(replace(world, robot_radius_m=radius_m, footprint=footprint,
                                 camera_height_m=robot.get("camera_height_m", world.camera_height_m)))
    return world


@lru_cache(maxsize=4)
def _world(family: str, word: str, number: int) -> World:
    """The first draw that keeps all rules."""
    last: RhsError | None = None
    for draw in range(MOST_DRAWS):
        try:
            world = _plain(family, number, draw)
            name = f"random:{family}{'+' if word else ''}{word}/{number}"
            world = replace(world, name=name, path=Path(name))
            rng = generator(number, f"obstacles of {family} {draw}")
            if (not word or "obstacles" in word) and (rng.uniform() < 0.5 or "obstacles" in word):
                world = _checked(with_drawn_obstacles(world, rng))
            if word == "shut":
                world = _checked(_shut(world, generator(number, f"barriers of {family} {draw}")))
            if "moved" in word:
                world = _checked(_rearranged(world, generator(number, f"moves of {family} {draw}")))
            if "people" in word:
                rng = generator(number, f"people of {family} {draw}")
                world = _checked(with_drawn_people(world, rng, *free_space(after(world))))
            return world
        except (Unfit, ConfigError) as error:
            last = error
    raise RhsError(f"random:{family}/{number}: none of {MOST_DRAWS} draws is a building to drive in; the last one: {last}")


def _checked(world: World) -> World:
    check_world(world, _Drawn(world.name))
    return world


def _shut(world: World, rng: np.random.Generator) -> World:
    """Raises Unfit where no barrier cuts a place off."""
    world = with_drawn_barriers(world, rng)
    if not world.obstacles:
        raise Unfit("no place of it can be cut off")
    return world


def _rearranged(world: World, rng: np.random.Generator) -> World:
    """Raises Unfit where nothing stands that could be moved: the next draw may have something."""
    if not movable(world):
        raise Unfit("nothing in it can be moved")
    return with_drawn_moves(world, rng)


def _plain(family: str, number: int, draw: int) -> World:
    """One draw without obstacles. Raises Unfit or ConfigError where it breaks a rule."""
    rng = generator(number, f"building of {family} {draw}")
    sketch = Sketch(rng, looks(rng), robot_radius_m=round(float(rng.uniform(0.18, 0.3)), 3),
                    robot_height_m=round(float(rng.uniform(0.5, 1.25)), 3))
    DRAWINGS[family](sketch)
    at_angle = family != "non_manhattan" and sketch.chance(0.5)
    angle = sketch.draw(-0.78, 0.78) if at_angle or family == "non_manhattan" else 0.0
    world = _laid_out(sketch, angle, np.array([sketch.draw(0.0, 1.0), sketch.draw(0.0, 1.0)]))
    world = _led_through(world, sketch)
    check_world(world, _Drawn(f"random:{family}/{number}"))
    return world


def _laid_out(sketch: Sketch, angle: float, shift: np.ndarray) -> World:
    """The walls and boxes of a sketch in world coordinates; start, places and route are still to come."""
    def placed(points: np.ndarray) -> np.ndarray:
        moved: np.ndarray = (turned(points, angle) + shift).round(4)
        return moved

    def moved(box: Box) -> Box:
        width, depth, height = (round(length, 4) for length in box.size_m)
        return replace(box, centre_m=_pair(placed(np.array(box.centre_m))), size_m=(width, depth, height),
                       yaw_rad=round(box.yaw_rad + angle, 6), bottom_m=round(box.bottom_m, 4))

    walls: tuple[Wall, ...] = tuple(replace(wall, points_m=placed(wall.points_m)) for wall in sketch.walls)
    if any((np.hypot(*np.diff(wall.points_m, axis=0).T) < 0.02).any() for wall in walls):
        raise Unfit("a wall of no length")
    sketch.rooms = [Room(r.name, _pair(placed(np.array(r.spot_m))), placed(r.floor_m), r.kind) for r in sketch.rooms]
    sketch.doors_m = [_pair(placed(np.array(door))) for door in sketch.doors_m]
    look = sketch.looks
    spot = sketch.rooms[0].spot_m
    return World("", Path(), (*spot, 0.0), sketch.robot_radius_m, sketch.robot_height_m, walls,
                 tuple(moved(box) for box in sketch.boxes), (), (), np.array([spot]), look.paintings, look.floor,
                 look.ceiling, int(sketch.rng.integers(2**31)), camera_pitch_deg=PITCH_DEG)


def _pair(point: np.ndarray) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _led_through(world: World, sketch: Sketch) -> World:
    """Start, survey and places: a round tour that begins in a drawn room, and a place in three to six of the rooms."""
    rng = sketch.rng
    home = sketch.rooms[int(rng.integers(len(sketch.rooms)))]
    grid, clearance = free_space(world, home)
    need = world.robot_radius_m + MARGIN_M
    where = _standing(grid, clearance, need + 0.05, home.spot_m)
    others = [room for room in sketch.rooms if room is not home]
    try:
        tour = tour_on(grid, clearance, need, start=where, places=[(room.name, *room.spot_m) for room in others])
    except ConfigError as error:
        raise Unfit(str(error)) from error
    area = float((grid.probability == 0.0).sum()) * CELL_M**2
    if not AREA_M2[0] <= area <= AREA_M2[1]:
        raise Unfit(f"{area:.0f} square metres of free floor")
    _check_clearance(tour.route_m, world, need)
    count = min(len(others), int(rng.integers(2, 6)))
    if count < 2:
        raise Unfit("fewer than three places")
    kept = sorted(int(index) for index in rng.permutation(len(others))[:count])
    return replace(world, start=tour.start, route_m=tour.route_m, places=(*(tour.places[i] for i in kept), tour.places[-1]))


def _check_clearance(route_m: np.ndarray, world: World, need_m: float) -> None:
    """The route keeps its distance, measured to the walls and boxes themselves, every 2 cm."""
    pieces = [a + np.linspace(0.0, 1.0, 2 + int(np.hypot(*(b - a)) / 0.02))[:, None] * (b - a)
              for a, b in zip(route_m[:-1], route_m[1:], strict=True)]
    least = float(nearest_gap_m(np.concatenate(pieces), solid_m(world)).min())
    if least < need_m:
        raise Unfit(f"the survey comes within {least:.3f} m of something")


def solid_m(world: World) -> np.ndarray:
    """(S, 2, 2) every wall and every side of a box, however high it hangs."""
    return np.concatenate([wall.segments_m for wall in world.walls] + [edges_of(box.corners_m) for box in world.boxes])


def free_space(world: World, home: Room | None = None) -> tuple[OccupancyGrid, np.ndarray]:
    """(the true plan, clearance (H, W)): metres from the middle of each free cell to the nearest wall or box; 0 where the
    cell is not free."""
    if home is not None:
        touching = truth_grid(world, CELL_M)
        spot = _standing(touching, (~touching.occupied()).astype(float), 0.5, home.spot_m)
        world = replace(world, start=(*spot, 0.0))
    grid = truth_grid(world, CELL_M)
    free = grid.free()
    if not free.any():
        raise Unfit("nothing is free round the start")
    clearance = np.zeros(grid.shape)
    clearance[free] = nearest_gap_m(grid.centres(np.argwhere(free)), solid_m(world))
    for box in world.boxes:
        cells = np.argwhere(free)
        hidden = cells[within(grid.centres(cells), box.corners_m)]
        clearance[hidden[:, 0], hidden[:, 1]] = 0.0
    return grid, clearance


def _standing(grid: OccupancyGrid, clearance_m: np.ndarray, need_m: float, spot_m: tuple[float, float],
              ) -> tuple[float, float]:
    """The middle of the cell with clearance enough that is nearest to the spot. Raises Unfit if that is far."""
    cells = np.argwhere(clearance_m >= need_m)
    if not len(cells):
        raise Unfit("there is no room to stand")
    centres = grid.centres(cells)
    gaps = ((centres - np.array(spot_m)) ** 2).sum(axis=1).round(6)
    best = int(np.argmin(gaps))
    if gaps[best] > NEAR_M**2:
        raise Unfit(f"no room to stand near ({spot_m[0]:.1f}, {spot_m[1]:.1f})")
    x, y = centres[best].round(4)
    return float(x), float(y)
