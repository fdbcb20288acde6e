"""Records whose arrays nobody can write to: what one part does to its copy must not reach another."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, TypeVar

import numpy as np

_PLAIN = {float, int, bool, str, type(None)}  # most of what records hold
Value = TypeVar("Value")


def freeze(value: Value) -> Value:
    """The same value; every array in it, in its records and sequences, can no longer be written to."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    else:
        kind: type = type(value)
        for item in _items_of(kind)(value):
            if type(item) not in _PLAIN:
                freeze(item)
    return value


@cache
def _items_of(kind: type) -> Callable[[Any], Iterable[Any]]:
    """What gives the items of a value of this type: looked up once, as a survey's views are frozen each time one is read."""
    if issubclass(kind, (tuple, list)):
        return iter
    if issubclass(kind, Mapping):
        return lambda value: value.values()
    if dataclasses.is_dataclass(kind):
        names = [item.name for item in dataclasses.fields(kind)]
        return lambda value: [getattr(value, name) for name in names]
    return lambda value: ()


def frozen_copy(array: np.ndarray) -> np.ndarray:
    """A copy that cannot be written to; the original stays its owner's."""
    return freeze(np.array(array))


def with_frozen_copies(record: Any, *names: str) -> Any:
    """A record whose arrays of these names are frozen copies."""
    return dataclasses.replace(record, **{name: frozen_copy(getattr(record, name)) for name in names})
