"""The size of the robot that a world file, or somebody who drives another one, tells of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rhs.api.robot_shape import LEAST_M, MOST_M, Footprint, footprint_of
from rhs.base.errors import ConfigError

from .world_yaml import Section

RADIUS, FOOTPRINT = SHAPES = ("robot_radius_m", "footprint_m")  # whoever gives one of these keys means no other


def shape_of(file: Section, usual_m: float) -> tuple[float, Footprint | None]:
    """Radius of the circle about its turning point that holds the robot, metres, and its footprint if it is not round.
    usual_m: the radius where nobody says. Raises ConfigError."""
    if FOOTPRINT not in file.nodes:
        return file.number(RADIUS, usual_m, low=LEAST_M, high=MOST_M), None
    if RADIUS in file.nodes:
        raise ConfigError(f"{file.where(FOOTPRINT)}: a robot has a {FOOTPRINT} or a {RADIUS}; leave out one of them")
    footprint = footprint_of(file.points(FOOTPRINT), f"{file.where(FOOTPRINT)}: {FOOTPRINT}")
    assert footprint is not None
    return footprint.radius_m, footprint


def put_robot(file: Section, robot: Mapping[str, Any]) -> Section:
    """The file, with what somebody says of the robot in the place of what stands there."""
    if any(key in robot for key in SHAPES):
        for key in SHAPES:
            file.nodes.pop(key, None)
    return file.put(robot)


def inherit(file: Section, base: Section) -> None:
    """Take from another file the keys that this one lacks, but not the shape of its robot where this one has its own."""
    if any(key in file.nodes for key in SHAPES):
        for key in SHAPES:
            base.nodes.pop(key, None)
    file.inherit(base)
