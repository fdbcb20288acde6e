"""Default budgets on maps that nobody chose: sampling planners find the way, and what they cannot find ends soon."""

import sys
import time
from pathlib import Path as FilePath

import numpy as np
import pytest
from planning_cases import planner, problem, settings

from rhs.api.records import PlanReason
from rhs.metrics.path_judge import path_valid

sys.path.insert(0, str(FilePath(__file__).parents[1] / "benchmarks"))
import planning_maps

SAMPLING = ("rrt_connect", "rrt", "rrt_star", "informed_rrt_star", "bit_star", "fmt")


def drawn(kind: str, seed: int):
    rng = np.random.default_rng([seed, 77])
    return planning_maps.question(planning_maps.KINDS[kind](rng), planning_maps.STEP_M, rng)


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLING)
def test_default_budgets_reach_the_goal_on_random_maps(name):
    """Maps of 30 m x 30 m, one question each, unseen before; one may fail. A maze costs the star planners half a minute."""
    solved, kinds = 0, [kind for kind in planning_maps.KINDS if kind != "maze" or not name.endswith("rrt_star")]
    for kind in kinds:
        task = drawn(kind, 4321)
        path = planner(name, 1).plan(task)
        assert path.found or path.reason is PlanReason.BUDGET_SPENT and "try planner." in path.advice
        solved += path.found and path_valid(path.points_m, task.blocked, task.resolution_m, task.origin_m)
    assert solved >= len(kinds) - 1


@pytest.mark.parametrize("name", SAMPLING)
def test_budgets_grow_with_the_free_cells_and_typed_numbers_stay(name):
    small, large = (sum(settings(name).rounds(cells)) for cells in (5_000, 200_000))
    assert small < large and large >= 600_000
    assert sum(settings(name).rounds(10**9)) < 5_000_000  # there is an end to it
    typed = settings(name, iterations=4000, **({"extensions": 0} if "star" in name and "bit" not in name else {}))
    assert sum(typed.rounds(200_000)) == 4000


@pytest.mark.parametrize("free_m", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("name", [*SAMPLING, "prm"])
def test_a_way_is_found_where_little_of_the_grid_is_free(name, free_m):
    """A robot that begins to explore knows a corridor of 5 m in a plan of 20 x 20 m: 0.6 to 4 % of it are free."""
    blocked = np.ones((400, 400), bool)
    blocked[100:100 + round(free_m / 0.05), 200:300] = False
    for seed in range(5):
        path = planner(name, seed).plan(problem(blocked, (205.5, 105.5), (295.5, 104.5)))
        assert path.found, (seed, path.reason)


@pytest.mark.parametrize("name", [*SAMPLING, "prm"])
def test_a_goal_without_a_way_is_given_up_after_the_first_round(name):
    """300 x 300 cells, cut in two: a flood fill says so, and the scaled budget is not spent on it."""
    blocked = np.zeros((300, 300), bool)
    blocked[150] = True
    began = time.process_time()
    path = planner(name).plan(problem(blocked, (20.5, 20.5), (270.5, 270.5)))
    assert path.reason is PlanReason.DISCONNECTED and time.process_time() - began < 10.0


def test_the_compiled_tree_grown_on_is_the_tree_of_one_large_budget():
    task = drawn("office", 12)
    grown = planner("rrt_connect", 3).plan(task)
    at_once = planner("rrt_connect", 3, iterations=900_000).plan(task)
    assert grown.found and np.array_equal(grown.points_m, at_once.points_m)
    assert grown.details["iterations"] == at_once.details["iterations"]


def test_looking_into_squares_finds_the_nearest_vertex():
    from rhs_planners.native_rrt_connect import _add, _nearest

    rng = np.random.default_rng(8)
    trees, parents, sizes = np.empty((3000, 4)), np.full((2, 3000), -1), np.zeros(2, np.int64)
    squares = np.full((2, 8, 11), -1), np.full((2, 3000), -1)
    points = np.vstack([rng.uniform((1.0, 1.0), (60.0, 120.0), (2999, 2)), [[170.0, 2.0]]])  # a corner nobody else is in
    for x, y in points:
        _add(trees, parents, squares, sizes, 1, x, y, 0)
    for x, y in rng.uniform(1.0, (175.0, 127.0), (500, 2)):
        away = ((points - (x, y)) ** 2).sum(axis=1)
        assert _nearest(trees, squares, sizes, 1, x, y)[0] == away.argmin()
