"""Views taken ahead are those taken in line; what goes wrong comes out where it would; no thread is left."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import pandas
import pytest
from fakes.rhs_fakes import parts
from fakes.rhs_fakes.room import Room
from installing import FAKES, installed

import rhs
from rhs.config import registry
from rhs.config.compose import compose_config
from rhs.patrol import eyes as module
from rhs.recording.reader import Reading
from rhs.sweeps.sweep import job_of

LIGHT = ["task=survey", "source=eager", "sensor=eager", "odometry=fake", "loop_closer=fake", "mapper=fake", "recording=off",
         "pictures=off"]
FAILS = ("lead", "clearance_m", "truth", "sense")


class Eager(Room):
    """Notes in which threads it was asked, and how far; fails at one view, in one way."""

    leads_ahead = True

    def __init__(self, settings: Any, context: Any) -> None:
        super().__init__(settings, context)
        self.threads: set[str] = set()
        SEEN.append(self)

    def fail(self, where: str) -> None:
        if self.settings.fails == where and self.index == self.settings.at:
            raise OSError(f"no {where}")

    def lead(self) -> Any:
        self.threads.add(threading.current_thread().name)
        capture = super().lead()
        self.fail("lead")
        return capture

    def truth(self) -> Any:
        self.fail("truth")
        return super().truth()

    def clearance_m(self) -> tuple[float, bool]:
        self.fail("clearance_m")
        return super().clearance_m()


SEEN: list[Eager] = []


class EagerWheel:
    """The sensor, which fails when its source says so."""

    senses_ahead = True

    def __init__(self, inner: Any) -> None:
        self.inner = inner

    def sense(self, capture: Any) -> Any:
        SEEN[-1].fail("sense")
        return self.inner.sense(capture)


@dataclass
class EagerSource(parts.FakeSource):
    fails: str = ""
    at: int = 0

    def build(self, context: Any) -> Any:
        return Eager(self, context)


@dataclass
class EagerSensor(parts.FakeSensor):
    def build(self, context: Any) -> Any:
        return EagerWheel(super().build(context))


@pytest.fixture(autouse=True)
def eager():
    with installed(FAKES):
        rhs.register("source", "eager", EagerSource)
        rhs.register("sensor", "eager", EagerSensor)
        yield
    registry._by_hand.clear()
    registry.forget()
    SEEN.clear()
    assert no_thread()


def no_thread() -> bool:
    return not any(thread.name == "ahead" for thread in threading.enumerate())


def table(folder: Any) -> str:
    steps = pandas.read_csv(folder / "steps.csv")
    return steps[[name for name in steps.columns if not name.endswith("_ms")]].to_csv()


@pytest.mark.parametrize("fails", FAILS)
def test_a_failure_comes_out_at_the_step_it_would_and_leaves_the_same_row(tmp_path, fails):
    rows, steps = [], []
    for word in ("off", "on"):
        folder = tmp_path / word
        row = rhs.run([*LIGHT, f"ahead={word}", f"source.fails={fails}", "source.at=4", f"output={folder}"], quiet=True)
        assert SEEN[-1].threads == {"ahead" if word == "on" else "MainThread"}
        rows.append({name: value for name, value in row.items() if not name.endswith(("_ms", "_mb", "_factor", "folder"))})
        steps.append(table(folder))
    assert rows[0]["status"] == "failed" and f"no {fails}" in rows[0]["reason"] and "step 3" in rows[0]["reason"]
    assert [str(v) for v in rows[0].values()] == [str(v) for v in rows[1].values()] and steps[0] == steps[1]


def test_no_more_than_a_few_views_wait(tmp_path):
    steps = rhs.steps([*LIGHT, "ahead=on", "source.views=40", f"output={tmp_path / 'run'}"])
    next(steps)
    for _ in range(200):
        if SEEN[-1].index >= 1 + module.MOST:
            break
        threading.Event().wait(0.01)
    threading.Event().wait(0.05)
    assert SEEN[-1].index == 1 + module.MOST
    assert not no_thread()
    steps.close()  # abandoned


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_an_end_from_outside_leaves_no_thread_and_a_closed_source(tmp_path, error):
    steps = rhs.steps([*LIGHT, "ahead=on", "source.views=40", f"output={tmp_path / 'run'}"])
    next(steps)
    with pytest.raises(error):
        steps.throw(error("enough"))
    assert no_thread() and SEEN[-1].closed


def test_parts_that_do_not_say_so_and_one_processor_are_taken_in_line(monkeypatch):
    class Part:
        leads_ahead = senses_ahead = False

    monkeypatch.setattr(module, "processors", lambda: 2)
    eager = Eager.__new__(Eager)
    wheel = EagerWheel(None)
    assert module.looks_ahead("auto", eager, wheel) and module.looks_ahead("on", eager, wheel)
    assert not module.looks_ahead("off", eager, wheel)
    assert not module.looks_ahead("on", Part(), wheel) and not module.looks_ahead("on", eager, Part())
    monkeypatch.setattr(module, "processors", lambda: 1)
    assert not module.looks_ahead("auto", eager, wheel) and module.looks_ahead("on", eager, wheel)


def test_the_jobs_of_a_sweep_do_not_look_ahead_unless_they_are_told_to():
    for words, wanted in (([], "off"), (["ahead=on"], "on")):
        assert job_of(compose_config([*LIGHT[:1], *words]), [], []).config.ahead == wanted


def test_the_survey_of_the_simulator_is_the_same_ahead_and_in_line(tmp_path):
    words = ["world=tests/golden/room.yaml", "task=survey", "source.image_width=160", "source.pitch_roll_deg=1",
             "pictures=off", "degrade=low_light", "seed=3"]
    found = []
    for word in ("off", "on"):
        folder = tmp_path / word
        row = rhs.run([*words, f"ahead={word}", f"output={folder}"], quiet=True)
        assert row["status"] == "ok"
        messages = [(message.channel.topic, message.log_ns, bytes(message.data)) for message in Reading(folder / "run.mcap")]
        found.append((table(folder), messages, (folder / "map.pgm").read_bytes(), (folder / "closure.json").read_text()))
    assert found[0][0] == found[1][0] and len(found[0][1]) > 100
    assert found[0][1] == found[1][1] and found[0][2] == found[1][2]
