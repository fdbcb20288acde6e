"""What of a world file moves by itself: `people`, `doors`, `timed`, `light_s` (worlds/README.md), and where it may."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rhs.api.floorplan import Box, Moving, Person, Surface, Timed, World, distance_m
from rhs.base.errors import ConfigError, check_range

from .world_yaml import Section

LEAF_M = 0.04  # thickness of a door's leaf
DOOR = Surface("wood", (170.0, 130.0, 90.0), 15.0)
Painter = Callable[[Section, Surface], Surface]


def moving_of(file: Section, boxes: Callable[[Section], Box], surface: Painter) -> Moving:
    """What the file says; boxes and surface read one of their sections, and refuse what they do not know of it."""
    people = tuple(_person(section, surface) for section in file.sections("people"))
    doors = tuple(_door(section, surface) for section in file.sections("doors"))
    timed = tuple(_timed(section, boxes) for section in file.sections("timed"))
    light: tuple[tuple[float, float], ...] = ()
    if "light_s" in file.nodes:
        light = _pairs(file, "light_s", rising=False)
        if any(not 0.05 <= value <= 3.0 for _, value in light):
            raise ConfigError(f"{file.where('light_s')}: light_s: expected pairs of seconds and a brightness of 0.05 to 3")
    return Moving(people, (*doors, *timed), light)


def _person(section: Section, surface: Painter) -> Person:
    default = Person("", np.zeros((0, 2)))
    path = section.points("path_m")
    if np.any(np.hypot(*np.diff(np.vstack([path, path[:1]]), axis=0).T) < 1e-3):
        raise ConfigError(f"{section.where('path_m')}: path_m holds the same point twice in a row; it is closed by itself")
    pauses = section.numbers("pauses_s", (), count=len(path) if "pauses_s" in section.nodes else None, low=0.0, high=1e6)
    person = Person(
        section.text("name"), path, section.number("speed_mps", default.speed_mps, low=0.05, high=3.0), tuple(pauses),
        section.number("start_m", 0.0, low=0.0), section.number("width_m", default.width_m, low=0.05, high=1.0),
        section.number("height_m", default.height_m, low=0.1, high=2.5),
        section.number("keep_m", default.keep_m, low=0.1, high=5.0),
        section.number("patience_s", default.patience_s, low=0.0, high=1e6), section.flag("shy", False),
        section.flag("survey", False), surface(section.section("surface"), default.surface))
    section.finish()
    return person


def _door(section: Section, surface: Painter) -> Timed:
    """A leaf that turns about its hinge from where it stands open to where it is closed, at once."""
    name, (x, y) = section.text("name"), section.numbers("hinge_m", count=2)
    width = section.number("width_m", 0.9, low=0.1, high=5.0)
    size = (width, LEAF_M, section.number("height_m", 2.0, low=0.1, high=10.0))
    look = surface(section.section("surface"), DOOR)

    def leaf(key: str) -> Box:
        yaw = float(np.radians(section.number(key, low=-360.0, high=360.0)))
        return Box(name, (x + 0.5 * width * math.cos(yaw), y + 0.5 * width * math.sin(yaw)), size, yaw, 0.0, look)

    closed, wide = leaf("closed_deg"), leaf("open_deg")
    door = Timed(closed, _pairs(section, "closed_s"), section.number("every_s", 0.0, low=0.0), wide)
    section.finish()
    return door


def _timed(section: Section, boxes: Callable[[Section], Box]) -> Timed:
    times, every_s = _pairs(section, "stands_s"), section.number("every_s", 0.0, low=0.0)
    at = section.numbers("otherwise", count=3) if "otherwise" in section.nodes else None
    box = boxes(section)
    other = None if at is None else replace(box, centre_m=(at[0], at[1]), yaw_rad=float(np.radians(at[2])))
    return Timed(box, times, every_s, other)


def _pairs(section: Section, key: str, *, rising: bool = True) -> tuple[tuple[float, float], ...]:
    """[[from, until], ...] seconds; or, not rising, [[seconds, value], ...]. In order of time."""
    pairs = section.points(key, least=1)
    times = pairs.ravel() if rising else pairs[:, 0]
    if times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
        raise ConfigError(f"{section.where(key)}: {key}: {pairs.tolist()}; expected seconds from 0 on, each later than "
                          "the last")
    return tuple((float(a), float(b)) for a, b in pairs)


def walkers(paths_m: Sequence[Sequence[float]]) -> tuple[Person, ...]:
    """People as `people=[[x1,y1,x2,y2,...], ...]` names them: the corners of a closed path each. Raises ConfigError."""
    people = []
    for number, values in enumerate(paths_m, 1):
        if len(values) < 4 or len(values) % 2 or not np.all(np.isfinite(values)):
            raise ConfigError(f"people={list(values)}: expected the corners of a closed path, x1, y1, x2, y2 and so "
                              "on, metres")
        for value in values:
            check_range("people", "path_m", value, low=-1e4, high=1e4, unit="m")
        path = np.array(values, float).reshape(-1, 2)
        if np.any(np.hypot(*np.diff(np.vstack([path, path[:1]]), axis=0).T) < 1e-3):
            raise ConfigError(f"people={list(values)}: the same point twice in a row; the path is closed by itself")
        people.append(Person(f"person_{number}", path))
    return tuple(people)


def path_fault(world: World, person: Person) -> str:
    """What is wrong with a person's path, empty: it touches neither wall nor box. Every 5 cm is looked at."""
    path = person.path_m
    for a, b in zip(path, np.roll(path, -1, axis=0), strict=True):
        for share in np.linspace(0.0, 1.0, 2 + int(np.hypot(*(b - a)) / 0.05)):
            at = a + share * (b - a)
            gap, thing = distance_m(world, at)
            if gap < 0.5 * person.width_m:
                return (f"PATH_OCCUPIED: the path of '{person.name}', {person.width_m:g} m wide, comes within {gap:.2f} m "
                        f"of {thing} at ({at[0]:.2f}, {at[1]:.2f}); lead it round")
    return ""
