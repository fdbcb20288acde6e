"""Planners that lie, forge, cheat and dawdle: the row says what is true, and the files say it too."""

import ctypes
import math
import time
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pytest

from rhs.api.records import Path, PlanReason
from rhs.config.compose import compose_config
from rhs.config.parts import Chosen
from rhs.metrics.evaluate import evaluate
from rhs.patrol.run import run_config
from rhs.runfolder.row import read_row
from rhs.worlds.maps import load_map

OPTIMUM_M = 21.96  # of map 1, its start and goal 3.606 m apart as the crow flies through two walls


def line(problem, **words) -> Path:
    """Straight through whatever stands there."""
    points = np.array([problem.start_m, problem.goal_m])
    return Path(PlanReason.OK, points, points, **words)


def claims_a_moved_start(problem, context):
    return line(problem, details={"start_moved_m": 0.001})


def claims_columns(problem, context):
    return line(problem, details={"valid": 1.0, "success": 1.0, "found": 1.0, "optimal_m": 3.6, "above_optimum_pct": 0.0})


def unseals_the_map(problem, context):
    """setflags on the array and on whatever it is a view of."""
    array = problem.blocked
    while array is not None and isinstance(array, np.ndarray):
        array.setflags(write=True)
        array[:] = False
        array = array.base
    return line(problem)


def writes_by_address(problem, context):
    """As C would: nobody asks numpy."""
    ctypes.memset(problem.blocked.ctypes.data, 0, problem.blocked.nbytes)
    ctypes.memset(problem.goal_m.ctypes.data, 0, problem.goal_m.nbytes)
    return Path(PlanReason.OK, np.array([problem.start_m, [5.0, 3.0]]))


def moves_the_ends(problem, context):
    for end in (problem.start_m, problem.goal_m):
        end.setflags(write=True)
        end[:] = problem.start_m
    return Path(PlanReason.OK, np.array([problem.start_m]))


def forges_the_files(problem, context):
    (context.folder / "map.pgm").write_bytes(b"P5\n100 100\n255\n" + bytes([254]) * 10_000)
    (context.folder / "plan.json").write_text("{}")
    return line(problem)


def changes_its_answer_later(problem, context):
    """The points are right when looked at first, and somewhere else afterwards."""
    class Late(np.ndarray):
        def __array_finalize__(self, other):
            pass
    return Path(PlanReason.OK, np.array([problem.start_m, problem.goal_m]).view(Late))


CROSSERS = [claims_a_moved_start, claims_columns, unseals_the_map, writes_by_address, moves_the_ends, forges_the_files,
            changes_its_answer_later]


@dataclass
class Hostile:
    """A planner made of one function (problem, context) -> Path."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()
    act: object = field(default=None)

    def build(self, context):
        outer = self

        class Planner:
            def plan(self, problem):
                if problem.blocked.shape == (8, 8):  # the warm-up
                    return line(problem)
                return outer.act(problem, context)
        return Planner()


def row_of(act, folder, *words):
    folder.mkdir(exist_ok=True)
    config = compose_config(["task=planning", "world=map1", "planner=astar", *words])
    config.parts["planner"] = Chosen("hostile", Plain(act))
    return run_config(config, folder)


class Plain(Hostile):
    """Hostile, but written to config.yaml without the function."""

    def __init__(self, act):
        super().__init__(act)


@pytest.fixture(autouse=True)
def plain_settings(monkeypatch):
    from rhs.api import settings

    before = settings.plain
    monkeypatch.setattr(settings, "plain", lambda value: {} if isinstance(value, Hostile) else before(value))


@pytest.mark.parametrize("act", CROSSERS, ids=lambda act: act.__name__)
def test_a_line_through_the_walls_is_no_success_whatever_is_done_to_hide_it(act, tmp_path):
    row = row_of(act, tmp_path / "a")
    assert row["status"] == "ok", row["reason"]
    assert (row["plan_found"], row["plan_valid"], row["plan_success"], row["plan_reason"]) == (1, 0.0, 0, "invalid")
    assert row["plan_optimal_m"] == pytest.approx(OPTIMUM_M, abs=0.005)
    assert math.isnan(row["plan_above_optimum_pct"]) and math.isnan(row["plan_length_m"])
    honest = load_map("worlds/maps/map1.yaml").occupied()
    assert np.array_equal(load_map(tmp_path / "a" / "map.yaml").occupied(), honest)
    stored = read_row(tmp_path / "a" / "row.json")
    for name, value in evaluate(tmp_path / "a", "planning").items():  # from the files alone
        assert stored[name] == value or (stored[name] is None and math.isnan(value)), name


def test_a_robber_of_the_map_does_not_spoil_it_for_the_next_question(tmp_path):
    honest = row_of(lambda problem, context: line(problem), tmp_path / "a")
    robbed = row_of(unseals_the_map, tmp_path / "b")
    assert honest["plan_optimal_m"] == robbed["plan_optimal_m"]


@pytest.mark.parametrize(("points", "words"), [
    ([[2.0, 1.0], [np.nan, 2.0], [5.0, 3.0]], "not finite"),
    ([[2.0, 1.0], [np.inf, 2.0], [5.0, 3.0]], "not finite"),
    ([[2.0, 1.0, 0.0], [5.0, 3.0, 0.0]], "expected \\(N, 2\\)"),
    (np.zeros((60_000, 2)), "at most"),
    (np.empty((0, 2)), "with 0 points"),
])
def test_what_is_no_path_fails_the_run_in_words(points, words, tmp_path):
    row = row_of(lambda problem, context: Path(PlanReason.OK, np.array(points)), tmp_path / "a")
    assert row["status"] == "failed" and __import__("re").search(words, row["reason"]), row["reason"]


def sleeps(problem, context):
    time.sleep(0.15)
    return line(problem, plan_ms=0.0)


def works_and_stops_the_clock(problem, context):
    """0.15 s of CPU, with a clock of its own in the module time, and a claim of -5 ms."""
    end = process_time() + 0.15
    before = time.process_time, time.perf_counter
    time.process_time = time.perf_counter = lambda: 0.0
    while process_time() < end:
        pass
    time.process_time, time.perf_counter = before
    return line(problem, plan_ms=-5.0, learn_ms=float("nan"))


process_time = time.process_time


class Lazy(Path):
    """A path that is found when somebody looks at it."""

    @property
    def points_m(self):
        time.sleep(0.15)
        return np.array([[2.0, 1.0], [5.0, 3.0]])


def plans_when_looked_at(problem, context):
    path = object.__new__(Lazy)
    for name, value in {"reason": PlanReason.OK, "raw_m": np.empty((0, 2)), "learn_ms": 0.0, "plan_ms": 0.0, "sketch": None,
                        "details": {}, "keep_shape": False, "advice": ""}.items():
        object.__setattr__(path, name, value)
    return path


@pytest.mark.parametrize(("act", "cpu"), [(sleeps, False), (works_and_stops_the_clock, True), (plans_when_looked_at, False)])
def test_times_are_measured_and_claims_stand_beside(act, cpu, tmp_path):
    row = row_of(act, tmp_path / "a")
    assert row["plan_wall_ms"] >= 149.0 and row["plan_again_wall_ms"] >= 149.0
    assert (row["plan_ms"] >= 149.0) == cpu
    assert row["plan_claimed_ms"] in (0.0, -5.0)


def test_what_an_honest_planner_learns_is_the_difference_of_two_calls(tmp_path):
    """Works 0.2 s on the first question and 0.05 s on the second."""
    calls = []

    def act(problem, context):
        end = time.process_time() + (0.05 if calls else 0.2)
        calls.append(1)
        while time.process_time() < end:
            pass
        return line(problem)

    row = row_of(act, tmp_path / "a")
    assert row["plan_ms"] == pytest.approx(200.0, abs=40.0) and row["plan_again_ms"] == pytest.approx(50.0, abs=30.0)
    assert row["plan_learn_ms"] == pytest.approx(150.0, abs=50.0)


def test_the_second_question_gets_the_same_random_numbers(tmp_path):
    drawn = []

    @dataclass
    class Drawing(Plain):
        def __init__(self):
            super().__init__(None)

        def build(self, context):
            class Planner:
                def plan(self, problem):
                    if problem.blocked.shape != (8, 8):
                        drawn.append(context.rng.random())
                    return line(problem)
            return Planner()

    config = compose_config(["task=planning", "world=map1", "planner=astar", "seed=7"])
    config.parts["planner"] = Chosen("hostile", Drawing())
    (tmp_path / "a").mkdir()
    run_config(config, tmp_path / "a")
    assert len(drawn) == 2 and drawn[0] == drawn[1]
