"""The advanced thresholds of every part: each says what it means, refuses numbers that make no sense, and is reached by its
key."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Iterator

import pytest

from rhs.api import settings
from rhs.api.contracts import KINDS
from rhs.base.errors import ConfigError
from rhs.config import registry
from rhs.testing.checks import silent_settings

PARTS = [(kind, name) for kind in KINDS for name in registry.names(kind)
         if "advanced" in settings.defaults(registry.load(kind, name))]


def numbers(cls: type, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], type]]:
    """Path and type of every number of a settings class, groups included."""
    hints = typing.get_type_hints(cls)
    for item in dataclasses.fields(cls):
        hint = hints[item.name]
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            yield from numbers(hint, (*path, item.name))
        elif hint in (int, float):
            yield (*path, item.name), hint


def nested(path: tuple[str, ...], value: float) -> dict:
    """{a: {b: value}} of the path a, b."""
    return {path[0]: nested(path[1:], value) if len(path) > 1 else value}


@pytest.mark.parametrize("kind, name", PARTS)
def test_every_advanced_number_refuses_what_makes_no_sense_and_names_its_key(kind, name):
    cls = registry.load(kind, name)
    for path, hint in numbers(cls):
        if path[0] != "advanced":
            continue
        for bad in (math.nan, math.inf) if hint is float else (10**15, -(10**15)):
            with pytest.raises(ConfigError, match=rf"{path[-1]}"):
                settings.make(cls, nested(path, bad), kind)


@pytest.mark.parametrize("kind, name", PARTS)
def test_every_advanced_setting_says_what_it_means(kind, name):
    assert silent_settings(registry.load(kind, name)) == []
