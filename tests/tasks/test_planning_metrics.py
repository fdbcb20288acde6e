"""Columns of the planning task on paths that can be measured by hand."""

import numpy as np
import pytest

from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.metrics.path_judge import Optimum
from rhs.metrics.planning import clearance_min_m, path_values, smoothness, steps_8
from rhs.worlds.planning_question import class_of


def problem(blocked, start, goal, step=0.5):
    return PlanningProblem(np.asarray(blocked, bool), step, (0.0, 0.0), np.array(start, float), np.array(goal, float))


def values_of(path, task, classes=()):
    return path_values(path, task, optimum=Optimum(task.blocked, task.resolution_m, task.origin_m), classes=classes)


def test_a_detour_round_one_block():
    """Grid 4 x 4 of 0.5 m, the middle blocked; along the bottom and up: 2.0 m where 1.5 m * sqrt(2) would be straight."""
    blocked = np.zeros((4, 4), bool)
    blocked[1:3, 1:3] = True
    task = problem(blocked, (0.25, 0.25), (1.75, 1.75))
    points = np.array([[0.25, 0.25], [1.75, 0.25], [1.75, 1.75]])
    values = values_of(Path(PlanReason.OK, points, points), task)
    shortest = 2 * np.hypot(1.25, 0.25)  # over the corner (1.5, 0.5)
    assert values["plan_success"] == 1 and values["plan_valid"] == 1.0 and values["plan_reason"] == "ok"
    assert values["plan_length_m"] == 3.0 and values["plan_optimal_m"] == pytest.approx(shortest)
    assert values["plan_above_optimum_pct"] == pytest.approx(100 * (3.0 / shortest - 1))
    assert values["plan_steps"] == 6 and values["plan_bends"] == 1
    assert values["plan_clearance_min_m"] == pytest.approx(0.25)


def test_a_failure_has_reasons_not_zeros():
    task = problem(np.zeros((4, 4)), (0.25, 0.25), (1.75, 1.75))
    none = np.empty((0, 2))
    values = values_of(Path(PlanReason.BUDGET_SPENT, none, none), task)
    assert values["plan_success"] == 0 and values["plan_reason"] == "budget_spent"
    for name in ("plan_valid", "plan_length_m", "plan_above_optimum_pct", "plan_steps", "plan_clearance_min_m"):
        assert np.isnan(values[name]), name
    assert values["plan_optimal_m"] == pytest.approx(1.5 * np.sqrt(2))


def test_a_path_that_cuts_through_or_misses_the_goal_is_not_valid():
    blocked = np.zeros((4, 4), bool)
    blocked[1:3, 1:3] = True
    task = problem(blocked, (0.25, 0.25), (1.75, 1.75))
    through = np.array([[0.25, 0.25], [1.75, 1.75]])
    short = np.array([[0.25, 0.25], [1.75, 0.25]])
    assert values_of(Path(PlanReason.OK, through, through), task)["plan_valid"] == 0.0
    assert values_of(Path(PlanReason.OK, short, short), task)["plan_valid"] == 0.0


def test_the_step_out_of_a_grown_obstacle_is_not_judged():
    blocked = np.zeros((4, 4), bool)
    blocked[0, 0] = True
    task = problem(blocked, (0.4, 0.25), (1.75, 0.25))
    points = np.array([[0.4, 0.25], [0.75, 0.25], [1.75, 0.25]])
    values = values_of(Path(PlanReason.OK, points, points, details={"start_moved_m": 0.35}), task)
    assert values["plan_valid"] == 1.0 and values["plan_above_optimum_pct"] == pytest.approx(0.0)


def test_steps_are_moves_between_neighbour_cells():
    assert steps_8(np.array([[0.0, 0.0], [8.0, 8.0]]), 0.1) == 80
    assert steps_8(np.array([[0.0, 0.0], [0.3, 0.1], [0.3, 0.5]]), 0.1) == 7
    assert np.isnan(steps_8(np.empty((0, 2)), 0.1))


def test_smoothness_of_a_right_angle_by_hand():
    assert smoothness(np.array([[0.0, 0.0], [2.0, 0.0], [5.0, 0.0]])) == 0.0
    assert smoothness(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]])) == pytest.approx((np.pi / 5.0) ** 2)


def test_clearance_is_exact_to_corners_and_sides():
    blocked = np.zeros((10, 10), bool)
    blocked[4, 4] = True  # the square [4, 5] x [4, 5]
    task = problem(blocked, (0.5, 0.5), (9.5, 9.5), step=1.0)
    assert clearance_min_m(np.array([[0.0, 2.5], [10.0, 2.5]]), task) == pytest.approx(1.5)
    assert clearance_min_m(np.array([[0.0, 7.0], [7.0, 0.0]]), task) == pytest.approx(1.0 / np.sqrt(2))
    assert clearance_min_m(np.array([[6.0, 7.0]]), task) == pytest.approx(np.hypot(1, 2))
    assert clearance_min_m(np.array([[0.0, 0.0], [1.0, 0.0]]), problem(np.zeros((3, 3)), (0, 0), (1, 0))) == np.inf


def test_classes_are_the_gates_a_path_crosses():
    gates = (("left", np.array([[0.0, 5.0], [4.0, 5.0]])), ("right", np.array([[6.0, 5.0], [10.0, 5.0]])))
    assert class_of(np.array([[2.0, 0.0], [2.0, 9.0]]), gates) == "left"
    assert class_of(np.array([[5.0, 0.0], [7.0, 4.0], [7.0, 9.0]]), gates) == "right"
    assert class_of(np.array([[5.0, 0.0], [5.0, 9.0]]), gates) == ""
    assert class_of(np.array([[2.0, 0.0], [2.0, 9.0], [8.0, 9.0], [8.0, 0.0]]), gates) == "left+right"
