"""Boxes, moved things and people that a run adds to any world by number, drawn by its seed: dials of how much is otherwise
than on the survey.

The first of seven are the first of eight: each has a generator of its own, so that more is never something else. Those of
a world stay where they are.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from rhs.api.floorplan import World, after, truth_grid
from rhs.api.randomness import generator
from rhs.base.errors import ConfigError

from .clearance import clearance_of
from .random.furniture import FREE_STANDING
from .random.obstacles import movable, rearranged, with_box
from .random.people import drawn_person

DRAWS = 4  # of people, for each that is asked for

log = logging.getLogger("rhs.worlds")


def with_counted(world: World, seed: int, *, obstacles: int = 0, moved: int = 0, people: int = 0) -> World:
    """The world with so many boxes more beside the survey's way and behind its corners, things that are moved or taken
    away, and people who walk about, from the patrol's beginning on. None stands where the robot waits or on a place, and
    none cuts a place off. Where there is no room for so many, there are fewer, and that is said. Raises ConfigError where
    there is room for none."""
    came, began = world, len(world.obstacles)
    for number in range(obstacles if len(world.route_m) > 1 and world.places else 0):
        came = with_box(came, generator(seed, f"counted obstacle {number}"))
    _check("obstacle_count", obstacles, len(came.obstacles) - began,
           f"beside the survey's way through {world.name}, with all ways left open, there is room for")
    came = _moved(came, moved, seed)
    return _peopled(came, people, seed)


def _moved(world: World, count: int, seed: int) -> World:
    """Chairs, crates, bins and the like, in an order that the seed draws."""
    if not count:
        return world
    things = [box for box in movable(world)
              if box.name not in {*world.changes.removed, *(one[0] for one in world.changes.moved)}]
    order = generator(seed, "counted moves").permutation(len(things))[:count]
    for index in order.tolist():
        world = rearranged(world, things[index], generator(seed, f"counted move {things[index].name}"))
    _check("moved_count", count, len(order), f"of what is moved ({', '.join(FREE_STANDING)}) {world.name} has")
    return world


def _peopled(world: World, count: int, seed: int) -> World:
    if not count:
        return world
    grid = truth_grid(after(world))
    clearance = np.asarray(clearance_of(grid), float)
    people = list(world.moving.people)
    for number in range(1, DRAWS * count + 1):
        if len(people) - len(world.moving.people) == count:
            break
        person = drawn_person(world, generator(seed, f"counted person {number}"), number, grid, clearance)
        if person is not None:
            people.append(replace(person, name=f"counted {person.name}"))
    _check("people_count", count, len(people) - len(world.moving.people),
           f"on free ways of 2.5 to 12 m in {world.name} there is room for")
    return replace(world, moving=replace(world.moving, people=tuple(people)))


def _check(key: str, asked: int, found: int, what: str) -> None:
    """Say it where fewer were found than were asked for, and refuse it where there are none: it would do nothing."""
    if asked and not found:
        raise ConfigError(f"{key}={asked}: {what} none; leave it out, or name another world")
    if found < asked:
        log.warning("%s=%d: %s %d", key, asked, what, found)
