"""Every planner: valid paths with exact ends, typed failures, bounded budgets, the same path for the same seed."""

import subprocess
import sys

import numpy as np
import pytest
from planning_cases import PLANNERS, planner, problem, settings, thesis_problem

from rhs.errors import ConfigError, ContractError
from rhs.judge import path_valid, polyline_length
from rhs.records import PlanReason


def room() -> np.ndarray:
    """12 x 12 free cells, a wall across with one gap, and a sealed chamber in the upper right corner."""
    blocked = np.zeros((12, 12), bool)
    blocked[5, 1:] = True
    blocked[8:, 8] = blocked[8, 8:] = True
    return blocked


@pytest.mark.parametrize("name", PLANNERS)
def test_path_is_judged_valid_and_joins_start_and_goal_exactly(name):
    task = problem(room(), (9.3, 1.7), (4.1, 9.2))
    path = planner(name).plan(task)
    assert path.reason is PlanReason.OK
    for points in (path.points_m, path.raw_m):
        assert np.array_equal(points[0], task.start_m) and np.array_equal(points[-1], task.goal_m)
        assert path_valid(points, task.blocked, 1.0, (0, 0))
    assert polyline_length(path.points_m) <= polyline_length(path.raw_m) + 1e-9


@pytest.mark.parametrize("name", PLANNERS)
def test_failures_say_why(name):
    part = planner(name)
    for start, goal, reason in (
        ((20.0, 1.0), (2.0, 2.0), PlanReason.OUTSIDE),
        ((2.0, 2.0), (np.nan, 2.0), PlanReason.OUTSIDE),
        ((6.5, 5.5), (2.0, 2.0), PlanReason.START_BLOCKED),
        ((2.0, 2.0), (6.5, 5.5), PlanReason.GOAL_BLOCKED),
        ((2.0, 2.0), (10.5, 10.5), PlanReason.DISCONNECTED),
    ):
        path = part.plan(problem(room(), start, goal))
        assert path.reason is reason and not path.found and path.points_m.shape == (0, 2)


@pytest.mark.parametrize("name", PLANNERS)
def test_same_seed_same_path_whatever_was_planned_before(name):
    first = planner(name, 5).plan(thesis_problem(4))
    for other in ("rrt", "prm"):
        planner(other, 1).plan(thesis_problem(3))
    again = planner(name, 5).plan(thesis_problem(4))
    assert np.array_equal(first.raw_m, again.raw_m) and np.array_equal(first.points_m, again.points_m)


@pytest.mark.parametrize("name", PLANNERS)
def test_start_just_inside_a_grown_obstacle_is_set_off_and_said(name):
    blocked = np.zeros((10, 10), bool)
    blocked[4:6, 4:6] = True
    path = planner(name, start_radius_m=0.3).plan(problem(blocked, (0.41, 0.45), (0.95, 0.95), 0.1))
    assert path.found and np.array_equal(path.points_m[0], [0.41, 0.45])
    assert path.details["start_moved_m"] == pytest.approx(0.06)  # to the centre of the cell on the left, (0.35, 0.45)
    assert path_valid(path.points_m[1:], blocked, 0.1, (0, 0))


@pytest.mark.parametrize("name", PLANNERS)
def test_start_is_goal(name):
    path = planner(name).plan(problem(room(), (2.5, 2.5), (2.5, 2.5)))
    assert path.found and polyline_length(path.points_m) == 0.0


def test_paths_are_the_same_in_another_process():
    code = ("import sys; sys.path.insert(0, sys.argv[1])\n"
            "from planning_cases import planner, thesis_problem\n"
            "for n in sys.argv[2:]: print(n, planner(n, 3).plan(thesis_problem(4)).raw_m.tobytes().hex())")
    words = [n for n in PLANNERS if n in ("prm", "rrt_connect", "rrt")]
    folder = str(__import__("pathlib").Path(__file__).parent)
    out = subprocess.run([sys.executable, "-c", code, folder, *words], capture_output=True, text=True, check=True)
    for line in out.stdout.splitlines():
        name, digits = line.split()
        planner("rrt", 9).plan(thesis_problem(3))
        assert planner(name, 3).plan(thesis_problem(4)).raw_m.tobytes().hex() == digits
    assert out.stderr == ""  # OMPL neither warns nor leaks


def test_a_small_budget_is_spent_not_exceeded():
    for name in ("rrt", "rrt_connect"):
        path = planner(name, iterations=5, range_m=0.2).plan(thesis_problem(1))
        assert path.reason is PlanReason.BUDGET_SPENT and path.details["iterations"] <= 5
    path = planner("potential_field", steps=50).plan(thesis_problem(1))
    assert path.reason is PlanReason.BUDGET_SPENT and path.details["walk_steps"] == 50


@pytest.mark.parametrize("name", PLANNERS)
def test_a_corner_is_never_cut(name):
    """Two blocked cells that touch corner to corner close the diagonal for every planner."""
    blocked = np.zeros((4, 4), bool)
    blocked[1, :2] = blocked[2, 2:] = True
    path = planner(name).plan(problem(blocked, (0.5, 0.5), (3.5, 3.5)))
    assert path.reason is PlanReason.DISCONNECTED


def test_potential_field_walks_as_many_steps_as_the_thesis_where_nothing_is_trapped():
    assert planner("potential_field").plan(thesis_problem(2)).details["walk_steps"] == 80
    assert planner("potential_field").plan(thesis_problem(3)).details["walk_steps"] == 121


def test_shortening_reaches_the_optimum_where_all_ways_round_are_equal():
    path = planner("rrt_connect", 2).plan(thesis_problem(3))
    assert 10 * polyline_length(path.points_m) == pytest.approx(126.49268769, rel=1e-4)


def test_native_rrt_connect_is_valid_and_repeats_itself():
    for number in (1, 3, 4):
        task = thesis_problem(number)
        a, b = (planner("rrt_connect", 7, backend="native").plan(task) for _ in range(2))
        assert a.found and np.array_equal(a.raw_m, b.raw_m)
        assert path_valid(a.points_m, task.blocked, task.resolution_m, task.origin_m)


def test_malformed_grids_are_refused():
    with pytest.raises(ContractError, match="expected"):
        planner("prm").plan(problem(np.zeros((3, 3), bool), (1, 1), (2, 2)).__class__(
            np.zeros((3, 3)), 1.0, (0.0, 0.0), np.ones(2), np.ones(2)))


@pytest.mark.parametrize(("name", "key", "value"), [
    ("prm", "milestones", 0), ("rrt", "goal_bias", 1.5), ("rrt", "range_m", float("nan")), ("fmt", "samples", -5),
    ("rrt_connect", "backend", "fast"), ("potential_field", "trail", float("inf")), ("bit_star", "batch", 0),
])
def test_settings_out_of_range_are_refused_by_name(name, key, value):
    with pytest.raises(ConfigError, match=f"planner.{name}.{key}"):
        settings(name, **{key: value})
