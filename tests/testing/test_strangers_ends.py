"""Parts of strangers whose errors cannot be shown, that leave the program where nobody runs, or take its path away."""

import sys
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import rhs
from rhs.api.errors import ConfigError, ContractError
from rhs.api.metric import Metric
from rhs.api.records import Path, PlanReason
from rhs.api.validate import check_closure
from rhs.base.commands import answered
from rhs.cli.main import main
from rhs.config import registry
from rhs.config.compose import compose_config
from rhs.config.slam_parts import SlamCloser
from rhs.metrics.evaluate import evaluate
from rhs.sweeps import running

pytestmark = pytest.mark.usefixtures("afresh")
PLAN = ["task=planning", "world=square_small", "pictures=off"]


class Mute(Exception):
    """An error that fails as it is asked for its text."""

    def __str__(self):
        raise ValueError("no text")


@dataclass
class Mine:
    """Of somebody."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self


def test_an_error_without_a_text_costs_one_figure_and_no_traceback(tmp_path, capsys):
    """Seen: all figures of the run were lost."""
    def mute(run):
        raise Mute

    registry.register("metric", "mine", (Metric("mute_m", "m", "x", "mine", mute, tasks=()),
                                         Metric("kept_m", "m", "x", "mine", lambda run: 2.0, tasks=())))
    values = evaluate(tmp_path, "planning")
    assert values["kept_m"] == 2.0
    assert values["metric_failures"].startswith("mute_m: Mute: (its text cannot be shown) (test_strangers_ends.py:")
    assert answered(lambda: mute(None)) == 1
    assert capsys.readouterr().err.startswith("rhs: Mute: (its text cannot be shown)")


@pytest.mark.parametrize(("error", "says"), [(ValueError(), "ValueError"), (AssertionError(), "AssertionError"),
                                             (SystemExit(0), "SystemExit: 0"), (BaseException("so"), "BaseException: so")])
def test_what_refuses_settings_without_words_is_told_with_its_line(error, says):
    """Seen: `rhs: planner:` and nothing behind it."""
    def refuses(self):
        raise error

    body = {"__post_init__": refuses, "plan": lambda self, problem: 0}
    rhs.register("planner", "mine", dataclass(type("Mine", (Mine,), body)))
    with pytest.raises(ConfigError, match=rf"planner: Mine cannot be made: {says} \(test_strangers_ends.py:"):
        compose_config([*PLAN, "planner=mine"])


def test_a_default_that_no_file_holds_is_named():
    body = {"__annotations__": {"call": Any}, "call": print, "plan": lambda self, problem: 0}
    with pytest.raises(ConfigError, match="planner=mine .*the default of setting call does not fit its type"):
        rhs.register("planner", "mine", dataclass(type("Mine", (Mine,), body)))


@pytest.mark.parametrize("error", [SystemExit(0), Mute()])
def test_an_engine_that_ends_the_program_is_at_fault(error, tmp_path, capsys):
    @dataclass
    class Leaves(Mine):
        def build(self, context):
            raise error

    rhs.register("engine", "mine", Leaves)
    assert main(["-m", *PLAN, "seed=0,1", "engine=mine", f"output={tmp_path / 's'}"]) == 1
    said = capsys.readouterr().err.strip()
    assert said.startswith(f"rhs: engine=mine: {type(error).__name__}: ") and "(test_strangers_ends.py:" in said


def test_a_signal_beside_the_jobs_is_answered(tmp_path, capsys, monkeypatch):
    """Seen: AttributeError, 'Terminated' object has no attribute 'report'."""
    def pressed(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "run_plan", pressed)
    assert main(["-m", *PLAN, "seed=0,1", f"output={tmp_path / 's'}"]) == 130
    assert f"--resume {tmp_path / 's'}" in capsys.readouterr().out


@pytest.mark.parametrize("said", ["fine", None, len, [[1.0], [2.0, 3.0]]])
def test_a_trajectory_that_is_none_is_refused_in_the_name_of_its_slam(said):
    closer = SlamCloser(SimpleNamespace(trajectory=lambda: said))
    with pytest.raises(ContractError, match="^slam=mine: "):
        check_closure(closer.close([]), [], who="slam=mine")


def test_a_part_that_takes_the_path_away_leaves_a_row(tmp_path, monkeypatch):
    """Seen: exit code 2, `rhs is not installed for this Python`, and a row that said running."""
    class Clears(Mine):
        """A planner that goes straight."""

        def plan(self, problem):
            sys.path.clear()
            return Path(PlanReason.OK, np.vstack([problem.start_m, problem.goal_m]))

    monkeypatch.setattr(sys, "path", list(sys.path))
    before = list(sys.path)
    rhs.register("planner", "mine", dataclass(Clears))
    row = rhs.run([*PLAN, "planner=mine", f"output={tmp_path / 'run'}"], quiet=True)
    assert (row["status"], row.get("metric_failures")) == ("ok", None) and sys.path == before
