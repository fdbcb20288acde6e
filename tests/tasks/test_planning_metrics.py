"""Columns of the planning task on paths that can be measured by hand."""

import numpy as np
import pytest

from rhs.api.errors import RhsError
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.metrics.planning import above_optimum_pct, clearance_min_m, path_values, smoothness, steps_8
from rhs.worlds.planning_question import class_of


def problem(blocked, start, goal, step=0.5):
    return PlanningProblem(np.asarray(blocked, bool), step, (0.0, 0.0), np.array(start, float), np.array(goal, float))


def values_of(path, task, **more):
    return path_values(path, task, **more)


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


def test_a_path_that_cuts_through_or_misses_the_goal_is_found_but_no_success():
    blocked = np.zeros((4, 4), bool)
    blocked[1:3, 1:3] = True
    task = problem(blocked, (0.25, 0.25), (1.75, 1.75))
    through = np.array([[0.25, 0.25], [1.75, 1.75]])
    short = np.array([[0.25, 0.25], [1.75, 0.25]])
    for points, words in ((through, "not free between (0.250, 0.250) and (1.750, 1.750) m"),
                          (short, "end at the goal (1.750, 1.750) m but at (1.750, 0.250) m")):
        values = values_of(Path(PlanReason.OK, points, points), task)
        assert (values["plan_found"], values["plan_valid"], values["plan_success"]) == (1, 0.0, 0)
        assert values["plan_reason"] == "invalid" and words in values["plan_failure"]
        for name in ("plan_length_m", "plan_above_optimum_pct", "plan_clearance_min_m", "plan_smoothness", "plan_bends"):
            assert np.isnan(values[name]), name


def test_a_free_path_made_of_one_that_is_not_is_not_valid():
    """What the planner gave is judged, not only what became of it."""
    blocked = np.zeros((4, 4), bool)
    blocked[1:3, 1:3] = True
    task = problem(blocked, (0.25, 0.25), (1.75, 1.75))
    round_it = np.array([[0.25, 0.25], [1.75, 0.25], [1.75, 1.75]])
    assert values_of(Path(PlanReason.OK, round_it, round_it[[0, 2]]), task)["plan_valid"] == 0.0


def pocket():
    """4 x 4 cells of 0.5 m, the first one blocked, the start in it, 0.1 m from the way out."""
    blocked = np.zeros((4, 4), bool)
    blocked[0, 0] = True
    return problem(blocked, (0.4, 0.25), (1.75, 0.25))


def test_the_way_out_of_a_blocked_start_is_found_by_the_judge_not_told_by_the_planner():
    points = np.array([[0.4, 0.25], [0.75, 0.25], [1.75, 0.25]])
    for details in ({}, {"start_moved_m": 0.35}):
        values = values_of(Path(PlanReason.OK, points, points, details=details), pocket(), start_radius_m=0.3)
        assert values["plan_valid"] == 1.0 and values["plan_above_optimum_pct"] == pytest.approx(0.0)
        assert values["plan_length_m"] == pytest.approx(1.35) == values["plan_optimal_m"]


def test_a_blocked_start_is_left_within_the_radius_or_not_at_all():
    """Out of a blocked strip 1 m wide: 0.4 m are too far with 0.3 m allowed, and right with 0.4 m."""
    blocked = np.zeros((4, 8), bool)
    blocked[:, :2] = True
    task = problem(blocked, (0.6, 1.0), (3.75, 1.0))
    path = Path(PlanReason.OK, *[np.array([[0.6, 1.0], [3.75, 1.0]])] * 2)
    wide = problem(np.pad(blocked, ((0, 0), (1, 0)), constant_values=True), (0.6, 1.0), (3.75, 1.0))
    assert values_of(path, task, start_radius_m=0.3)["plan_valid"] == 1.0  # its own cell reaches to the edge
    assert values_of(path, wide, start_radius_m=0.3)["plan_valid"] == 0.0  # one blocked cell more, 0.4 m away
    assert values_of(path, wide, start_radius_m=0.4)["plan_valid"] == 1.0


def test_claiming_a_moved_start_frees_nothing():
    """A line through the walls, and the words that once switched the judge off: the optimum is the way round."""
    blocked = np.zeros((4, 4), bool)
    blocked[1:3, 1:3] = True
    task = problem(blocked, (0.25, 0.25), (1.75, 1.75))
    line = np.array([[0.25, 0.25], [1.75, 1.75]])
    values = values_of(Path(PlanReason.OK, line, line, details={"start_moved_m": 0.001}), task, start_radius_m=0.3)
    assert values["plan_valid"] == 0.0 and values["plan_success"] == 0
    assert values["plan_optimal_m"] == pytest.approx(2 * np.hypot(1.25, 0.25))


def test_details_cannot_take_the_place_of_a_judged_column():
    line = np.array([[0.25, 0.25], [0.25, 1.75]])
    task = problem(np.zeros((4, 4)), (0.25, 0.25), (1.75, 1.75))
    lies = {"valid": 1.0, "success": 1.0, "length_m": 0.1, "above_optimum_pct": 0.0, "optimal_m": 9.0}
    values = values_of(Path(PlanReason.OK, line, line, details=lies), task)
    assert (values["plan_valid"], values["plan_success"]) == (0.0, 0)
    assert np.isnan(values["plan_length_m"]) and values["plan_optimal_m"] == pytest.approx(1.5 * np.sqrt(2))


def test_a_valid_path_below_the_optimum_is_the_judges_own_fault():
    points = np.array([[0.0, 0.0], [3.0, 4.0]])
    assert above_optimum_pct(points, 5.0, 0.1) == 0.0 and above_optimum_pct(points, 4.0, 0.1) == pytest.approx(25.0)
    assert above_optimum_pct(points, 5.0 + 1e-9, 0.1) == 0.0  # rounding
    for optimum in (5.001, np.nan):
        with pytest.raises(RhsError, match="the judge contradicts itself"):
            above_optimum_pct(points, optimum, 0.1)


def test_a_failure_names_the_knob():
    none = np.empty((0, 2))
    path = Path(PlanReason.BUDGET_SPENT, none, none, advice="planner.iterations=40 spent; try planner.iterations=400")
    values = values_of(path, problem(np.zeros((4, 4)), (0.25, 0.25), (1.75, 1.75)))
    assert values["plan_reason"] == "budget_spent"
    assert values["plan_failure"] == "budget_spent: planner.iterations=40 spent; try planner.iterations=400"


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
