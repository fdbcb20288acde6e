"""Whatever fails once a run has begun is a row with the true reason; evaluation and drawing only add to it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from fakes.rhs_fakes import parts
from installing import CHOICE, FAKES, installed

import rhs
from rhs.api.errors import ConfigError
from rhs.runfolder.row import canonical_hash, read_row


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


BASE: dict[str, Any] = {word.partition("=")[0]: "fake" for word in CHOICE} | {"source.views": 3, "pictures": "off"}


class Wrapped:
    """A part that is another one but for what a subclass changes."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


@dataclass
class NoTruth(parts.FakeSource):
    views: int = 3

    def build(self, context: Any) -> Any:
        class Source(Wrapped):
            def truth(self) -> None:
                return None

        return Source(super().build(context))


@dataclass
class FlatMapper(parts.FakeMapper):
    """Its cells have no size."""

    def build(self, context: Any) -> Any:
        class Mapper(Wrapped):
            def grid(self) -> Any:
                return replace(self.inner.grid(), resolution_m=0.0)

        return Mapper(super().build(context))


@dataclass
class Unbuildable(parts.FakeMapper):
    def build(self, context: Any) -> Any:
        raise ZeroDivisionError("cannot be built")


class Mute(Exception):
    def __str__(self) -> str:
        raise RuntimeError("no text")


@dataclass
class MuteMapper(parts.FakeMapper):
    def build(self, context: Any) -> Any:
        class Mapper(Wrapped):
            def update(self, *arguments: Any) -> None:
                raise Mute

        return Mapper(super().build(context))


@dataclass
class ClosingBadly(parts.FakeSource):
    views: int = 3

    def build(self, context: Any) -> Any:
        class Source(Wrapped):
            def close(self) -> None:
                raise SystemExit(0)

        return Source(super().build(context))


@dataclass
class PoseOnly(parts.FakeLocaliser):
    def build(self, context: Any) -> Any:
        class Localiser(Wrapped):
            def update(self, *arguments: Any) -> Any:
                return self.inner.update(*arguments).map_from_body

        return Localiser(super().build(context))


@pytest.mark.parametrize(("changed", "status", "reason"), [
    ({"localiser": PoseOnly()}, "failed", "(HASH)): what it returned is of type ndarray; expected a Belief"),
    ({"source": NoTruth()}, "ok", ""), ({"mapper": FlatMapper()}, "failed", ""),
    ({"mapper": MuteMapper()}, "failed", "Mute"),
    ({"mapper": Unbuildable()}, "failed", "cannot be built"), ({"source": ClosingBadly()}, "failed", "SystemExit"),
])
def test_a_row_stands_whatever_happens(tmp_path, changed, status, reason):
    row = rhs.run({**BASE, **changed, "output": str(tmp_path / "run")}, quiet=True)
    read = read_row(tmp_path / "run" / "row.json")
    assert read["status"] == row["status"] == status
    assert reason in re.sub(r"\([0-9a-f]{12}\)", "(HASH)", str(read["reason"]))
    assert read["success"] == (0.0 if status == "failed" else row["success"]) and "pid" not in read


def test_a_picture_that_fails_is_named_in_the_row_and_costs_nothing_else(tmp_path, monkeypatch):
    from rhs.reports import report

    def broken(folder: Any) -> None:
        raise SystemExit("no ink $^$")

    plain = rhs.run({**BASE, "output": str(tmp_path / "a")}, quiet=True)
    monkeypatch.setattr(report, "pictures", broken)
    row = rhs.run({**BASE, "pictures": "on", "output": str(tmp_path / "b")}, quiet=True)
    assert row["status"] == "ok" and "no ink" in row["picture_failures"]
    assert canonical_hash(read_row(tmp_path / "a" / "row.json")) == canonical_hash(read_row(tmp_path / "b" / "row.json"))
    assert plain["status"] == "ok"


def test_an_evaluation_that_fails_leaves_the_outcome(tmp_path, monkeypatch):
    def broken(folder: Any, task: str) -> None:
        raise MemoryError("too large")

    monkeypatch.setattr("rhs.patrol.run.evaluate", broken)
    row = rhs.run({**BASE, "output": str(tmp_path / "run")}, quiet=True)
    assert row["status"] == "ok" and "too large" in read_row(tmp_path / "run" / "row.json")["metric_failures"]


def test_an_overwriting_run_has_the_row_of_a_fresh_one(tmp_path):
    rhs.run({**BASE, "output": str(tmp_path / "run"), "seed": 5}, quiet=True)
    rhs.run({**BASE, "output": str(tmp_path / "run"), "overwrite": True, "task": "survey", "seed": 1}, quiet=True)
    rhs.run({**BASE, "output": str(tmp_path / "fresh"), "task": "survey", "seed": 1}, quiet=True)
    again, fresh = (read_row(tmp_path / name / "row.json") for name in ("run", "fresh"))
    assert canonical_hash(again) == canonical_hash(fresh) and "missions" not in again  # nor a mission of the patrol before
    assert not (tmp_path / "run" / "missions.json").exists()


def test_a_refusal_before_anything_ran_keeps_the_earlier_run(tmp_path):
    rhs.run({**BASE, "output": str(tmp_path / "run"), "seed": 5}, quiet=True)
    with pytest.raises(ConfigError, match="does not exist|no such|neither"):
        rhs.run({**BASE, "output": str(tmp_path / "run"), "overwrite": True, "world": "nowhere"}, quiet=True)
    assert read_row(tmp_path / "run" / "row.json")["seed"] == 5
    assert np.isclose(read_row(tmp_path / "run" / "row.json")["success"], 1.0)
