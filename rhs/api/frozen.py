"""Records whose arrays nobody can write to: what one part does to its copy must not reach another."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from enum import Enum
from functools import cache
from typing import TypeVar

import numpy as np

Value = TypeVar("Value")
FEW = 6  # numbers that are printed
_PLAIN = frozenset({float, int, str, bool, type(None)})


def freeze(value: Value) -> Value:
    """The same value; every array in it, in its records and sequences, can no longer be written to."""
    if type(value) in _PLAIN:  # most of what a view holds; asked some hundred times per view
        return value
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, (tuple, list)):
        for item in value:
            freeze(item)
    elif isinstance(value, Mapping):
        for item in value.values():
            freeze(item)
    elif not isinstance(value, type):
        for name in _names(type(value)):  # type: ignore[arg-type]  # every class can be hashed
            freeze(getattr(value, name))
    return value


def owned(value: Value) -> Value:
    """The same value; a copy of an array that is a view of memory which somebody may write to again: a camera that fills one
    buffer over and over would change the views of the past."""
    below: object = value
    while isinstance(below, np.ndarray) and below.base is not None:
        below = below.base
    if not isinstance(value, np.ndarray) or below is value or isinstance(below, bytes):
        return value
    return value.copy()


class Shown:
    """A record that is printed in a line: poses and arrays in short, what is not there left out."""

    def __repr__(self) -> str:
        held = [(name, getattr(self, name)) for name in _names(type(self))]  # type: ignore[arg-type]  # as above
        return f"{type(self).__name__}({', '.join(f'{name}={_in_short(one)}' for name, one in held if one is not None)})"


def _in_short(value: object) -> str:
    if isinstance(value, np.ndarray) and value.shape == (4, 4):
        (x, y, z), yaw_deg = value[:3, 3], np.degrees(np.arctan2(value[1, 0], value[0, 0]))
        return f"<pose at {x:.4g}, {y:.4g}, {z:.4g}, yaw {yaw_deg:.4g} deg>"
    if isinstance(value, np.ndarray) and value.size > FEW:
        return f"<{value.shape} {value.dtype}>"
    if isinstance(value, Enum):
        return f"{type(value).__name__}.{value.name}"
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, (tuple, list, Mapping)) and len(value) > FEW:
        return f"<{len(value)} in a {type(value).__name__}>"
    return " ".join(repr(value).split())


@cache
def _names(kind: type) -> tuple[str, ...]:
    """The fields of a record; none of what is no record."""
    return tuple(field.name for field in dataclasses.fields(kind)) if dataclasses.is_dataclass(kind) else ()
