"""Every registered plugin keeps the contract of its kind, whoever wrote it."""

from __future__ import annotations

import dataclasses
import math
import typing
from pathlib import Path

import pytest

from rhs.api.contracts import DEGRADE, KINDS
from rhs.api.errors import ConfigError
from rhs.config import registry
from rhs.testing.checks import checks

CASES = [pytest.param(kind, name, check, id=f"{kind}-{name}-{label}") for kind in (*KINDS, DEGRADE)
         for name in registry.names(kind) for label, check in checks(kind).items()]


@pytest.mark.parametrize(("kind", "name", "check"), CASES)
def test_plugin(kind, name, check, tmp_path: Path):
    if (why := registry.failure(kind, name)) is not None:
        pytest.skip(why)
    check(registry.load(kind, name)(), tmp_path)


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in (*KINDS, DEGRADE) for name in registry.names(kind)])
def test_ours_refuse_numbers_that_make_no_sense(kind, name):
    """In words of their own; of others rhs.api.settings refuses what is not finite."""
    if registry.failure(kind, name) is not None:
        pytest.skip("cannot be used here")
    settings = registry.load(kind, name)()
    hints = typing.get_type_hints(type(settings))
    for item in dataclasses.fields(settings):
        bad: tuple[float, ...] = {float: (math.nan, math.inf, -math.inf), int: (10**15, -(10**15))}.get(hints[item.name], ())
        for value in bad:
            try:
                dataclasses.replace(settings, **{item.name: value})
            except ConfigError as error:
                assert item.name in str(error), f"the refusal of {item.name}={value} does not name it: {error}"
            else:
                raise AssertionError(f"{item.name}={value} was accepted")
