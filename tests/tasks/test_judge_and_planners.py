"""Judge and planners share no code; on random grids they must agree, also where the start is blocked."""

import sys
from pathlib import Path as FilePath

import numpy as np
import pytest

from rhs.api.records import Path, PlanReason
from rhs.estimation.paths.shorten import shorten_m, shortened
from rhs.metrics.path_judge import Optimum, opened, path_valid, polyline_length
from rhs.metrics.planning import path_values

sys.path.insert(0, str(FilePath(__file__).parents[1] / "plugins"))
from planning_cases import planner, problem


def sampled(points, blocked) -> bool:
    """Free as far as 4000 samples a segment show: none lies inside a blocked cell or outside the grid (cells of 1)."""
    for a, b in zip(points[:-1], points[1:], strict=True):
        at = a + np.linspace(0.0, 1.0, 4001)[:, None] * (b - a)
        if (at < 0).any() or (at > blocked.shape[::-1]).any():
            return False
        i, j = np.minimum(np.floor(at).astype(int), np.array(blocked.shape[::-1]) - 1).T
        deep = (np.abs(at - np.rint(at)) > 1e-3).all(axis=1)  # not on a side, which may be touched
        if (blocked[j, i] & deep).any():
            return False
    return True


@pytest.mark.parametrize("seed", range(5))
def test_random_polylines_are_judged_as_dense_samples_say(seed):
    rng = np.random.default_rng(seed)
    blocked = rng.random((12, 15)) < 0.1
    answers = []
    for _ in range(300):
        points = np.cumsum(np.vstack([rng.uniform(2.0, 10.0, 2), rng.normal(0.0, 1.5, (2, 2))]), axis=0)
        judged = path_valid(points, blocked, 1.0, (0.0, 0.0))
        assert judged == sampled(points, blocked), points.tolist()
        answers.append(judged)
    assert 60 < sum(answers) < 240


@pytest.mark.parametrize("name", ["astar", "theta_star", "fast_marching", "rrt_connect", "prm", "potential_field"])
def test_no_path_beats_the_optimum_and_every_path_is_valid(name):
    """40 random grids; every third start stands in a blocked cell. path_values raises where a valid path is too short."""
    rng = np.random.default_rng(17)
    found = blocked_starts = 0
    for number in range(40):
        blocked = rng.random((25, 25)) < 0.22
        free, taken = np.argwhere(~blocked), np.argwhere(blocked)
        from_ = taken if number % 3 == 0 else free
        start, goal = from_[rng.integers(len(from_))], free[rng.integers(len(free))]
        task = problem(blocked, 0.1 * (start[::-1] + rng.random(2)), 0.1 * (goal[::-1] + rng.random(2)), 0.1)
        path = shortened(planner(name, number).plan(task), task)
        values = path_values(path, task, start_radius_m=0.3)
        if path.found:
            found += 1
            blocked_starts += int(blocked[tuple(start)])
            assert values["plan_valid"] == 1.0, values["plan_failure"]
            assert values["plan_above_optimum_pct"] >= 0.0 and values["plan_above_optimum_raw_pct"] >= 0.0
            assert values["plan_length_m"] <= values["plan_length_raw_m"] + 1e-12
    assert found >= 15 and blocked_starts >= 4


def test_shortening_leaves_alone_what_is_not_free_or_wants_its_shape():
    blocked = np.zeros((10, 10), bool)
    blocked[4:6, :8] = True
    task = problem(blocked, (1.5, 1.5), (1.5, 8.5))
    through = np.array([[1.5, 1.5], [3.5, 2.5], [1.5, 8.5]])
    assert np.array_equal(shorten_m(through, task), through)
    outside = np.array([[1.5, 1.5], [30.0, 5.0], [1.5, 8.5]])
    assert np.array_equal(shorten_m(outside, task), outside)
    assert shorten_m(np.empty((0, 2)), task).shape == (0, 2)
    round_it = np.array([[1.5, 1.5], [9.0, 1.5], [9.0, 8.5], [1.5, 8.5]])
    short = shortened(Path(PlanReason.OK, round_it), task)
    assert np.array_equal(short.raw_m, round_it) and polyline_length(short.points_m) < polyline_length(round_it)
    assert path_valid(short.points_m, blocked, 1.0, (0, 0))
    assert np.array_equal(shortened(Path(PlanReason.OK, round_it, keep_shape=True), task).points_m, round_it)


def test_shortening_treats_a_strangers_path_as_our_own():
    """A staircase of single cells round a block comes out as long as the shortest path, to a thousandth."""
    blocked = np.zeros((40, 40), bool)
    blocked[10:30, 10:30] = True
    task = problem(blocked, (5.5, 5.5), (34.5, 34.5), 1.0)
    right = [(x + 0.5, 5.5) for x in range(5, 35)] + [(34.5, y + 0.5) for y in range(6, 35)]
    short = shorten_m(np.array(right), task)
    best = Optimum(task.blocked, 1.0, (0.0, 0.0)).length_m([task.start_m, task.goal_m])
    assert polyline_length(short) == pytest.approx(best, rel=1e-3)


def test_what_is_opened_is_what_lies_within_the_radius_of_a_blocked_start():
    blocked = np.ones((9, 9), bool)
    task = problem(blocked, (4.5, 4.5), (8.5, 8.5), 1.0)
    free = ~opened(task, 1.0).blocked
    assert int(free.sum()) == 9  # its own cell, four at 0.5 m, four whose corners are at 0.71 m
    assert int((~opened(task, 0.0).blocked).sum()) == 1
    assert opened(problem(~blocked, (4.5, 4.5), (8.5, 8.5)), 1.0).blocked.sum() == 0
    outside = problem(blocked, (-1.0, 4.5), (8.5, 8.5), 1.0)
    assert opened(outside, 3.0) is outside
