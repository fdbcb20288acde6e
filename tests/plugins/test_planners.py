"""Every planner: valid paths with exact ends, typed failures, bounded budgets, the same path for the same seed."""

import re
import subprocess
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
from planning_cases import PLANNERS, WORDS, digits, planner, problem, room, settings, thesis_problem

from rhs.api.errors import ConfigError, ContractError
from rhs.api.records import PlanReason
from rhs.estimation.paths.shorten import shortened
from rhs.metrics.path_judge import path_valid, polyline_length
from rhs_planners.chance import uniform
from rhs_planners.fast_marching import contours


@pytest.mark.parametrize("name", PLANNERS)
def test_path_is_judged_valid_and_joins_start_and_goal_exactly(name):
    task = problem(room(), (9.3, 1.7), (4.1, 9.2))
    path = shortened(planner(name).plan(task), task)
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


def test_every_planner_gives_the_same_path_in_another_process_and_another_order():
    """One process plans with all of them, backwards and seed 4 before seed 3; here they come forwards, seed 3 alone."""
    code = ("import sys; sys.path.insert(0, sys.argv[1])\n"
            "from planning_cases import PLANNERS, digits\n"
            "for name in PLANNERS[::-1]: digits(name, 4); print(name, digits(name, 3))")
    folder = str(FilePath(__file__).parent)
    out = subprocess.run([sys.executable, "-c", code, folder], capture_output=True, text=True, check=True, timeout=300)
    there = dict(line.split() for line in out.stdout.splitlines())
    assert there == {name: digits(name, 3) for name in PLANNERS}
    assert out.stderr == ""  # OMPL neither warns nor leaks


# What each planner may use at most, and where it says how much it used. fast_marching visits every cell once at most.
BUDGETS = {
    "potential_field": ({"steps": 50}, "walk_steps", 50), "rrt": ({"iterations": 5, "range_m": 0.2}, "iterations", 5),
    "rrt_connect": ({"iterations": 5, "range_m": 0.2}, "iterations", 5),
    "rrt_star": ({"iterations": 5, "extensions": 1, "range_m": 0.2}, "iterations", 10),
    "informed_rrt_star": ({"iterations": 5, "extensions": 1, "range_m": 0.2}, "iterations", 10),
    "bit_star": ({"iterations": 5, "batch": 2}, "iterations", 5), "fmt": ({"iterations": 5, "samples": 5}, "iterations", 5),
    "prm": ({"milestones": 2, "growth": 1, "growth_rounds": 3}, "vertices", 5),
    "prm_star": ({"milestones": 2, "growth": 1, "growth_rounds": 3}, "vertices", 5),
    "astar": ({"expansions": 20}, "expanded", 20), "theta_star": ({"expansions": 20}, "expanded", 20),
}


@pytest.mark.parametrize("name", [name for name in PLANNERS if name != "fast_marching"])
def test_a_small_budget_is_spent_not_exceeded_and_what_is_left_is_no_success(name):
    """OMPL's trees then hold an approximate solution, which it calls true; here it is a failure with a reason."""
    values, what, most = BUDGETS[name.partition("/")[0]]
    path = planner(name, **values).plan(thesis_problem(1))
    assert path.reason is PlanReason.BUDGET_SPENT and not path.found and len(path.points_m) == 0
    assert 0 < path.details[what] <= most
    key, number, more = re.fullmatch(r"planner\.(\w+)=(\d+) spent; try planner\.\1=(\d+)", path.advice).groups()
    assert values.get(key) == int(number) and int(more) == 10 * int(number)
    settings(name, **values | {key: int(more)})  # what it says to type is allowed


def test_every_planner_says_what_its_budget_is():
    assert {*BUDGETS, "fast_marching"} == set(WORDS)


@pytest.mark.parametrize("name", PLANNERS)
def test_an_unreachable_goal_ends_within_the_budget(name):
    path = planner(name).plan(problem(room(), (2.0, 2.0), (10.5, 10.5)))
    assert path.reason is PlanReason.DISCONNECTED and len(path.points_m) == 0
    rounds = getattr(settings(name), "rounds", None)  # nobody is given a second one for a goal that cannot be reached
    first = rounds(10**6)[0] if rounds is not None and not name.startswith("prm") else np.inf
    assert path.details.get("iterations", 0.0) <= first <= 20_000 or first == np.inf
    assert path.details.get("growths", 0.0) == 0.0 and path.advice == ""


def test_a_tree_that_has_no_path_yet_is_given_more_samples():
    """Seed 136 does not meet the gap of map 4 in its first 5000 samples."""
    alone = planner("informed_rrt_star", 136, extensions=0).plan(thesis_problem(4))
    assert alone.reason is PlanReason.BUDGET_SPENT and alone.details["iterations"] == 5000
    more = planner("informed_rrt_star", 136).plan(thesis_problem(4))
    assert more.found and more.details["iterations"] == 10_000


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


def test_finer_cells_do_not_defeat_the_potential_field():
    """Map 1 with every cell cut into 3 x 3, and map 4 into 10 x 10: the trail is heaped at the same distances."""
    for number, times, most in ((1, 3, 2000), (4, 10, 2000)):
        coarse = thesis_problem(number)
        blocked = np.repeat(np.repeat(coarse.blocked, times, axis=0), times, axis=1)
        task = problem(blocked, coarse.start_m, coarse.goal_m, coarse.resolution_m / times, coarse.origin_m)
        path = planner("potential_field").plan(task)
        assert path.found and path.details["walk_steps"] / times < most


def test_shortening_reaches_the_optimum_where_all_ways_round_are_equal():
    path = shortened(planner("rrt_connect", 2).plan(thesis_problem(3)), thesis_problem(3))
    assert 10 * polyline_length(path.points_m) == pytest.approx(126.49268769, rel=1e-4)


def test_compiled_random_numbers_are_even_and_follow_the_published_sequence():
    """splitmix64 from state 0: its first outputs are known (Vigna's reference implementation)."""
    state, shares = np.uint64(0), []
    for _ in range(20_000):
        state, share = uniform(state)
        shares.append(share)
    assert [int(share * 2**53) for share in shares[:2]] == [0xE220A8397B1DCDAF >> 11, 0x6E789E6AA1B965F4 >> 11]
    counts = np.histogram(shares, 20, (0.0, 1.0))[0]
    assert (((counts - 1000.0) ** 2) / 1000.0).sum() < 43.8  # chi-squared with 19 degrees of freedom, 0.1 %
    assert abs(np.corrcoef(shares[:-1], shares[1:])[0, 1]) < 0.025


@pytest.mark.parametrize("name", ["rrt_connect", "prm", "prm_star"])
def test_both_backends_are_one_method(name):
    """Over 20 seeds both find map 4's gap, and neither's raw paths are longer by more than chance explains."""
    means = []
    for backend in ("native", "ompl"):
        paths = [planner(name, 200 + seed, backend=backend).plan(thesis_problem(4)) for seed in range(20)]
        assert all(path.found for path in paths)
        lengths = np.array([polyline_length(path.raw_m) for path in paths])
        means.append((lengths.mean(), lengths.std() / np.sqrt(len(lengths))))
    (a, sa), (b, sb) = means
    assert abs(a - b) < 4.0 * np.hypot(sa, sb)


def test_malformed_grids_are_refused():
    with pytest.raises(ContractError, match="expected"):
        planner("prm").plan(problem(np.zeros((3, 3), bool), (1, 1), (2, 2)).__class__(
            np.zeros((3, 3)), 1.0, (0.0, 0.0), np.ones(2), np.ones(2)))


@pytest.mark.parametrize(("name", "key", "value"), [
    ("prm", "milestones", 0), ("rrt", "goal_bias", 1.5), ("rrt", "range_m", float("nan")), ("fmt", "samples", -5),
    ("rrt_connect", "backend", "fast"), ("prm", "backend", "cpp"), ("rrt_star", "extensions", -1),
    ("potential_field", "trail", float("inf")), ("bit_star", "batch", 0),
])
def test_settings_out_of_range_are_refused_by_name(name, key, value):
    with pytest.raises(ConfigError, match=f"^{key}="):
        settings(name, **{key: value})


def test_contours_of_a_cone_are_circles():
    y, x = np.mgrid[0:41, 0:41]
    lines = contours(np.hypot(x - 20.0, y - 20.0))
    radius = np.hypot(*(lines - 20.5).reshape(-1, 2).T)
    middle = np.hypot(*(lines.mean(axis=1) - 20.5).T)
    steps = np.hypot(20.0, 20.0) / 31  # 30 levels between the least and the largest value
    off = np.abs(middle / steps - np.rint(middle / steps)) * steps
    assert len(lines) > 1000 and np.median(off) < 0.05 and radius.max() < np.hypot(20.0, 20.0)
    assert len(contours(np.full((3, 3), np.inf))) == 0


@pytest.mark.parametrize("name", PLANNERS)
def test_every_planner_shows_what_it_searched(name):
    task = thesis_problem(1)
    lines = planner(name).plan(task).sketch()
    assert len(lines) > 5 and lines.shape[1:] == (2, 2)
    low = np.array(task.origin_m)  # on the map, in metres
    assert (lines >= low - 1e-9).all() and (lines <= low + 10.0 + 1e-9).all()
