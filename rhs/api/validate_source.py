"""What a source says of its camera and of its world, once, when it is built: see rhs.api.validate for all that follows."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np

from .geometry import Camera
from .records import WorldFacts
from .validate import check_pose
from .validate_fields import _refuse, _short

MOST_RAD = 2.0 * math.pi  # of a heading: more are degrees
LENSES = (0, 4, 5, 8)  # numbers of distortion: none, OpenCV's with or without k3, its rational model


def check_camera(camera: Camera, *, who: str) -> Camera:
    """Sizes are whole numbers above 0, focal lengths above 0, the mount is a pose, the lens one that OpenCV knows.

    Raises ContractError in one line: what was found, what is expected."""
    if not isinstance(camera, Camera):
        _refuse(who, "camera", f"of type {type(camera).__name__}", "a rhs.api.geometry.Camera")
    for name in ("width", "height"):
        size = getattr(camera, name)
        if not isinstance(size, int | np.integer) or size < 1:
            _refuse(who, f"camera.{name}", _short(size), "a whole number of pixels above 0")
    for name in ("fx", "fy", "cx", "cy", "skew", "readout_s"):
        value = getattr(camera, name)
        if not _finite(value) or (name in ("fx", "fy") and value <= 0.0) or (name == "readout_s" and value < 0.0):
            _refuse(who, f"camera.{name}", _short(value), "a finite number" + (" above 0" if name in ("fx", "fy") else ""))
    lens = camera.distortion
    if not isinstance(lens, tuple) or len(lens) not in LENSES or not all(map(_finite, lens)):
        _refuse(who, "camera.distortion", _short(lens), "a tuple of 0, 4, 5 or 8 numbers: k1, k2, p1, p2, k3, k4, k5, k6")
    check_pose(camera.body_from_camera, who=who, field="camera.body_from_camera")
    return camera


def check_facts(facts: WorldFacts, *, who: str) -> WorldFacts:
    """Start, places, bounds and radius are finite numbers in metres and radians, the bounds are in order.

    Raises ContractError in one line: what was found, what is expected."""
    if not isinstance(facts, WorldFacts):
        _refuse(who, "facts", f"of type {type(facts).__name__}", "a rhs.api.records.WorldFacts")
    if not _numbers(facts.start, 3) or abs(facts.start[2]) > MOST_RAD:
        _refuse(who, "facts.start", _short(facts.start), "x, y in metres and a yaw in radians")
    for place in facts.places:
        named = isinstance(place, tuple | list) and len(place) == 3 and isinstance(place[0], str)
        if not named or not _numbers(place[1:], 2):
            _refuse(who, "facts.places", _short(place), "(name, x, y) of each, metres")
    bounds = facts.bounds_m
    if not _numbers(bounds, 4) or not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
        _refuse(who, "facts.bounds_m", _short(bounds), "x_min, y_min, x_max, y_max in metres, in this order")
    if not _finite(facts.robot_radius_m) or facts.robot_radius_m < 0.0:
        _refuse(who, "facts.robot_radius_m", _short(facts.robot_radius_m), "metres, 0 or more")
    return facts


def check_clearance(said: Any, *, who: str) -> tuple[float, bool]:
    """What clearance_m() of a source returned: metres, NaN where unknown, and whether the robot touched something.

    Raises ContractError in one line: what was found, what is expected."""
    pair = isinstance(said, tuple | list) and len(said) == 2
    if not pair or not isinstance(said[0], Real) or not isinstance(said[1], bool | np.bool_):
        _refuse(who, "clearance_m()", _short(said), "(metres or NaN, whether the robot touched something)")
    return float(said[0]), bool(said[1])


def check_provides(provides: Any, *, who: str) -> None:
    """What a source says that it holds after all: None or a set of words. Raises ContractError."""
    words = isinstance(provides, frozenset | set) and all(isinstance(one, str) for one in provides)
    if provides is not None and not words:
        _refuse(who, "provides", _short(provides), "None or a frozenset of words")


def _finite(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and math.isfinite(value)


def _numbers(values: Any, count: int) -> bool:
    return isinstance(values, tuple | list | np.ndarray) and len(values) == count and all(map(_finite, values))
