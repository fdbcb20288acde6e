"""Who walks about in a drawn building: one to three people, now and then a pet, each there and back on a way with room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.floorplan import Person, World, after
from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

from ..tour import Ground
from ..world_moving import path_fault
from .looks import surface

PETS = 0.25  # share of the walkers that are one
ROOM_M = 0.12  # between a walker's side and the walls
WAY_M = (2.5, 12.0)  # of the walk, one way
TRIES = 40


def with_drawn_people(world: World, rng: np.random.Generator, grid: OccupancyGrid,
                      clearance: np.ndarray) -> World:
    """The world with one to three people on free ways. grid, clearance: as in `drawn_person`."""
    drawn = [drawn_person(world, rng, number, grid, clearance) for number in range(1, int(rng.integers(1, 4)) + 1)]
    people = tuple(person for person in drawn if person is not None)
    return replace(world, moving=replace(world.moving, people=people))


def drawn_person(world: World, rng: np.random.Generator, number: int, grid: OccupancyGrid,
                 clearance: np.ndarray) -> Person | None:
    """Somebody who walks there and back on a free way and stops at both ends for up to eight seconds; None if all draws
    fail. Nobody begins within 1.5 m of the robot that waits for its patrol. Pets are shy: a level camera at a metre sees
    nothing so low nearer than two metres. grid, clearance (H, W): the free space of the patrol, metres to the nearest
    thing."""
    person = _walker(rng, number)
    try:
        ground = Ground(grid, clearance, 0.5 * person.width_m + ROOM_M, world.start)
    except ConfigError:
        return None
    for _ in range(TRIES):
        way = _way(ground, rng)
        if way is None or np.hypot(*(way[0] - world.route_m[-1])) < 1.5:
            continue
        drawn = replace(person, path_m=np.vstack([way, way[-2:0:-1]]), pauses_s=_pauses(len(way), rng))
        if not path_fault(after(world), drawn):
            return drawn
    return None


def _walker(rng: np.random.Generator, number: int) -> Person:
    """Somebody without a way."""
    look = surface(rng, ("carpet", "brick", "plaster"), light=(60.0, 190.0), rough=(15.0, 35.0))
    pet, pace = rng.uniform() < PETS, round(float(rng.uniform(0.4, 1.1)), 3)
    width, height = ((0.2, 0.35), (0.25, 0.45)) if pet else ((0.36, 0.5), (1.5, 1.9))
    return Person(f"{'pet' if pet else 'person'} {number}", np.zeros((0, 2)), pace, (),
                  width_m=round(float(rng.uniform(*width)), 3), height_m=round(float(rng.uniform(*height)), 3),
                  keep_m=round(float(rng.uniform(0.3, 0.6)), 3), 
                  patience_s=round(float(rng.uniform(1.0, 4.0)), 2), shy=pet, surface=look)


def _way(ground: Ground, rng: np.random.Generator) -> np.ndarray | None:
    """(N, 2) the way between two drawn places, metres; None if it is too short or too long."""
    stops = rng.integers(len(ground.cells), size=2)
    if stops[0] == stops[1] or not np.isfinite(ground.ways_m(stops)).all():
        return None
    way = ground.straightened(np.array([int(stops[0]), *ground.way(int(stops[0]), int(stops[1]))]))
    length = float(np.hypot(*np.diff(way, axis=0).T).sum())
    return way if WAY_M[0] <= length <= WAY_M[1] else None


def _pauses(count: int, rng: np.random.Generator) -> tuple[float, ...]:
    """Seconds at each corner there and back: only where the way turns round."""
    pauses = [0.0] * (2 * count - 2)
    pauses[0], pauses[count - 1] = (round(float(rng.uniform(0.0, 8.0)), 2) for _ in range(2))
    return tuple(pauses)
