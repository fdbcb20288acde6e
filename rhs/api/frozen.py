"""Records whose arrays nobody can write to: what one part does to its copy must not reach another."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

Value = TypeVar("Value")


def freeze(value: Value) -> Value:
    """The same value; every array in it, in its records and sequences, can no longer be written to."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, (tuple, list)):
        for item in value:
            freeze(item)
    elif isinstance(value, Mapping):
        for item in value.values():
            freeze(item)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        for item in dataclasses.fields(value):
            freeze(getattr(value, item.name))
    return value
