"""The errors a user can meet, and the checks of a setting's value: what a plugin raises and calls."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rhs.base.errors import (
    ConfigError,
    ContractError,
    EngineError,
    PluginError,
    RecordingError,
    RhsError,
    check_choice,
    check_range,
    check_ranges,
    unit_of,
)

__all__ = ["Bounded", "ConfigError", "ContractError", "EngineError", "PluginError", "RecordingError", "RhsError",
           "check_choice", "check_range", "check_ranges", "limits_of", "one_of", "within"]

T = TypeVar("T")


def within(default: T, low: float, high: float, *, below: str = "", unit: str = "") -> T:
    """A number of a `Bounded` settings dataclass with the closed range [low, high] that it keeps: `share: float =
    within(0.5, 0.0, 1.0)`. A default of None is not looked at, nor is None where somebody types it. below: a setting of the
    same class that is larger. unit: said of the range where the end of the name does not tell it (`check_ranges`)."""
    limits = {"range": (low, high)} | ({"below": below} if below else {}) | ({"unit": unit} if unit else {})
    return dataclasses.field(default=default, metadata=limits)


def one_of(default: str, *others: str) -> str:
    """A word of a `Bounded` settings dataclass and the others that may stand in its place."""
    return dataclasses.field(default=default, metadata={"words": (default, *others)})


def limits_of(cls: type, kind: str) -> dict[str, Any]:
    """What the settings of a class keep to, by name. kind: `range`, `below`, `unit` (see `within`) or `words` (`one_of`)."""
    fields = [item for base in reversed(cls.__mro__) for item in vars(base).get("__dataclass_fields__", {}).values()]
    return {item.name: item.metadata[kind] for item in fields if kind in item.metadata}


class Bounded:
    """Settings whose numbers keep the ranges, and whose words are among those, that stand beside their defaults (`within`,
    `one_of`). A dataclass with a `__post_init__` of its own calls this one; one that gives another default keeps the range.

    Raises ConfigError naming the key, the value and what it may be (`check_ranges`, `check_choice`); whoever reads a
    configuration puts the key that they stand under before it.
    """

    def __post_init__(self) -> None:
        units = limits_of(type(self), "unit")
        for name, (low, high) in limits_of(type(self), "range").items():
            if (value := getattr(self, name)) is not None:
                check_range("", name, value, low=low, high=high, unit=units.get(name) or unit_of(name))
        for name, words in limits_of(type(self), "words").items():
            check_choice("", name, getattr(self, name), words)
        for low, high in limits_of(type(self), "below").items():
            if getattr(self, low) >= getattr(self, high):
                raise ConfigError(f"{low}={getattr(self, low)} is not below {high}={getattr(self, high)}")
