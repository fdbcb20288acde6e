"""What a world must keep before anything runs in it: names, size; start, places and route where a robot can stand."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from rhs.api.floorplan import Person, World, after, distance_m, truth_grid
from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

from .world_moving import path_fault

MAX_AREA_M2 = 40_000.0  # a grid of 4 million cells at 0.1 m


class Located(Protocol):
    """What a world was read from: says where a key stands, for the words of a refusal."""

    def where(self, key: str, /) -> str:
        """Such as `my.yaml:12`."""
        ...


def check_world(world: World, file: Located) -> None:
    """Refuse a world that is too large, and a start, place or route where the robot cannot stand."""
    check_extent(world, file)
    _check_names(world, file)
    if np.hypot(*(world.route_m[0] - np.array(world.start[:2]))) > 1e-6:
        raise ConfigError(f"{file.where('route_m')}: route_m begins at {world.route_m[0].tolist()}; "
                          f"expected the start {list(world.start[:2])}")
    _check_point(world, file, "start", np.array(world.start[:2]), "START")
    free = _true_plan(world).probability == 0.0
    if free[0].any() or free[-1].any() or free[:, 0].any() or free[:, -1].any() or not free.any():
        raise ConfigError(f"{file.where('start')}: START_OUTSIDE_MAP: start {list(world.start[:2])} is not enclosed by "
                          "walls; move it inside or close the gap")
    for name, x, y in world.places:
        _check_point(world, file, f"place '{name}'", np.array([x, y]), "GOAL")
        if not _reached(world, np.array([[x, y]])).all():
            raise ConfigError(f"{file.where('places')}: GOAL_OUTSIDE_MAP: place '{name}' ({x:g}, {y:g}) cannot be "
                              "reached from the start; move it into the building")
    _check_route(world, file)
    _check_moving(world, file)


def _check_names(world: World, file: Located) -> None:
    for key, things in (("walls", world.walls), ("boxes", world.boxes + world.obstacles)):
        names = [thing.name for thing in things]
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise ConfigError(f"{file.where(key)}: two {key} are named '{twice[0]}'; give each its own name")
    for name, _, _ in world.places:
        if not re.fullmatch(r"\w[\w .-]{0,60}", str(name)):  # pictures are named after their places
            raise ConfigError(f"{file.where('places')}: the place {str(name)[:60]!r} needs a plain name: letters, digits, "
                              "spaces, dots and dashes")


def check_extent(world: World, file: Located) -> None:
    """Refuse a world whose grids would be too large."""
    x_min, y_min, x_max, y_max = world.bounds_m
    if (x_max - x_min) * (y_max - y_min) > MAX_AREA_M2:
        raise ConfigError(f"{file.where('walls')}: the walls span {x_max - x_min:g} x {y_max - y_min:g} m; "
                          f"expected at most {MAX_AREA_M2:g} square metres (another unit, or a map's resolution?)")


def _check_moving(world: World, file: Located) -> None:
    names = [person.name for person in world.moving.people] + [timed.box.name for timed in world.moving.timed]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"{file.where('people')}: two things that move are named '{twice[0]}'; give each its own name")
    for person in world.moving.people:
        if fault := walk_fault(world, person):
            raise ConfigError(f"{file.where('people')}: {fault}")


def walk_fault(world: World, person: Person) -> str:
    """What is wrong with a person's path, on the survey or on the patrol; empty: nothing."""
    if not _true_plan(world).inside(person.path_m).all() or not _reached(world, person.path_m).all():
        return f"PATH_OUTSIDE_MAP: the path of '{person.name}' is not in the building, where the robot could come"
    return path_fault(world, person) or path_fault(after(world), person)


def _check_route(world: World, file: Located) -> None:
    for x, y in world.route_m:
        _check_point(world, file, f"route point [{x:g}, {y:g}]", np.array([x, y]), "ROUTE")
    legs = {f"the leg from {a.tolist()} to {b.tolist()} goes through":
            a + np.linspace(0.0, 1.0, 2 + int(np.hypot(*(b - a)) / 0.05))[:, None] * (b - a)
            for a, b in zip(world.route_m[:-1], world.route_m[1:], strict=True)}
    for leg, points in legs.items():
        if not _reached(world, points).all():
            raise ConfigError(f"{file.where('route_m')}: ROUTE_OCCUPIED: {leg} a wall or a box; lead it round")
    timed = tuple(box for timed in world.moving.timed if (box := timed.at(0.0)) is not None)
    come = tuple(box for box in after(world).boxes if box not in world.boxes) + timed
    for end in (world.route_m[0], world.route_m[-1]):
        distance, thing = distance_m(replace(world, walls=(), boxes=come, mesh=None), end)
        if distance < world.robot_radius_m:
            of = {f"box '{box.name}'": key for key, boxes in (("obstacles", world.obstacles), ("timed", timed))
                  for box in boxes}
            key = of.get(thing, "changes")
            raise ConfigError(f"{file.where(key)}: {thing} is put in {distance:.2f} m from the robot at "
                              f"the end of the survey {end.tolist()}; the robot's radius is {world.robot_radius_m:g} m")
    standing = replace(world, walls=(), boxes=timed, mesh=None)
    for leg, points in legs.items() if timed else ():
        distance, thing = min(distance_m(standing, point) for point in points)
        if distance <= 0.0:
            raise ConfigError(f"{file.where('route_m')}: ROUTE_OCCUPIED: {leg} {thing}, which is there in the survey "
                              "as at 0 s; lead it round, or have it stand elsewhere then")


@lru_cache(maxsize=1)  # the many points of one route are looked up in one plan
def _true_plan(world: World) -> OccupancyGrid:
    return truth_grid(world)


def _reached(world: World, points_m: np.ndarray) -> np.ndarray:
    """(N,) bool: the point lies in the building, in no wall and no box."""
    grid = _true_plan(world)
    cells = grid.cells(points_m)
    free: np.ndarray = grid.probability[cells[:, 0], cells[:, 1]] == 0.0
    return free


def _check_point(world: World, file: Located, what: str, point: np.ndarray, code: str) -> None:
    key = {"START": "start", "GOAL": "places", "ROUTE": "route_m"}[code]
    x_min, y_min, x_max, y_max = world.bounds_m
    x, y = point
    if not (x_min <= x <= x_max and y_min <= y <= y_max):
        raise ConfigError(f"{file.where(key)}: {code}_OUTSIDE_MAP: {what} ({x:g}, {y:g}) lies outside the walls, which "
                          f"span x {x_min:g}..{x_max:g}, y {y_min:g}..{y_max:g}")
    distance, thing = distance_m(world, point)
    if distance < world.robot_radius_m:
        raise ConfigError(f"{file.where(key)}: {code}_OCCUPIED: {what} ({x:g}, {y:g}) is {distance:.2f} m from "
                          f"{thing}; the robot's radius is {world.robot_radius_m:g} m")
