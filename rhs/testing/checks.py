"""Checks for plugin authors: does a part keep its contract (rhs.contracts)?

    from rhs.testing import check_plugin
    check_plugin("planner", MyPlanner())

runs every check of that kind on settings of yours and raises AssertionError naming the fact that does not hold.
`checks(kind)` gives them one by one for a parametrised test. A part is built several times, always from the settings;
nothing is simulated except for a source that can be driven.
"""

from __future__ import annotations

import dataclasses
import math
import tempfile
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rhs.api.contracts import KINDS
from rhs.base.errors import ConfigError
from rhs.config.documented import field_docs, summary

from . import estimators as testing_estimators
from . import planners as testing_planners
from . import sources as testing_sources

Check = Callable[[Any, Path], None]


def check_plugin(kind: str, settings: Any) -> None:
    """Run all checks of a kind on an instance of the plugin's dataclass. Raises AssertionError."""
    for name, check in checks(kind).items():
        with tempfile.TemporaryDirectory() as folder:
            try:
                check(settings, Path(folder))
            except AssertionError as error:
                raise AssertionError(f"{kind} {type(settings).__name__}: {name.replace('_', ' ')}: {error}") from error


def checks(kind: str) -> dict[str, Check]:
    """Name -> check(settings, folder) for a kind of part."""
    if kind not in KINDS:
        raise ConfigError(f"kind={kind}: expected one of {', '.join(KINDS)}")
    own = {"source": testing_sources.SOURCE, "sensor": testing_sources.SENSOR,
           "odometry": testing_estimators.ODOMETRY, "loop_closer": testing_estimators.LOOP_CLOSER,
           "localiser": testing_estimators.LOCALISER, "mapper": testing_planners.MAPPER,
           "planner": testing_planners.PLANNER}[kind]
    return {check.__name__: check for check in (*SETTINGS, *own)}


def says_what_it_is(settings: Any, folder: Path) -> None:
    assert summary(type(settings)), "write a docstring: --help shows its first paragraph"


def says_what_every_setting_means(settings: Any, folder: Path) -> None:
    silent = silent_settings(type(settings))
    assert not silent, f"write a string literal after each of these settings saying what it means: {', '.join(silent)}"


def silent_settings(cls: type, owner: str = "") -> list[str]:
    """The settings without a meaning, those of nested groups included; a group says what it is by its own docstring."""
    hints, meanings, out = typing.get_type_hints(cls), field_docs(cls), []
    for item in dataclasses.fields(cls):
        hint = hints[item.name]
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            out += ([] if summary(hint) else [owner + item.name]) + silent_settings(hint, f"{owner}{item.name}.")
        elif item.init and not meanings.get(item.name):
            out.append(owner + item.name)
    return out


def declares_what_it_needs_and_provides(settings: Any, folder: Path) -> None:
    for word in ("needs", "provides"):
        value = getattr(type(settings), word, None)
        assert isinstance(value, frozenset), f"{word} must be a ClassVar[frozenset[str]], found {type(value).__name__}"


def refuses_numbers_that_make_no_sense(settings: Any, folder: Path) -> None:
    hints = typing.get_type_hints(type(settings))
    for item in dataclasses.fields(settings):
        bad = {float: (math.nan, math.inf, -math.inf), int: (10**15, -(10**15))}.get(hints[item.name], ())
        for value in bad:
            try:
                dataclasses.replace(settings, **{item.name: value})
            except ConfigError as error:
                assert item.name in str(error), f"the refusal of {item.name}={value} does not name it: {error}"
            else:
                raise AssertionError(f"{item.name}={value} was accepted; check it in __post_init__ (rhs.errors.check_range)")


SETTINGS: tuple[Check, ...] = (says_what_it_is, says_what_every_setting_means, declares_what_it_needs_and_provides,
                               refuses_numbers_that_make_no_sense)
