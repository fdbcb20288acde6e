"""The roadmap: learnt once, repaired when cells change, restored when they change back."""

import numpy as np
from planning_cases import planner, problem, thesis_problem

from rhs.api.records import PlanReason
from rhs.metrics.path_judge import path_valid


def two_doors() -> np.ndarray:
    """40 x 40 cells, a wall with a door near each end; the lower one is nearer for a start and goal down there."""
    blocked = np.zeros((40, 40), bool)
    blocked[:, 20] = True
    blocked[8:12, 20] = blocked[32:36, 20] = False
    return blocked


def test_second_query_learns_nothing():
    part = planner("prm")
    first = part.plan(thesis_problem(1))
    second = part.plan(thesis_problem(1))
    assert first.details["learnt"] == 1 and second.details["learnt"] == 0
    assert first.details["vertices"] == second.details["vertices"]
    assert second.learn_ms < 0.1 * first.learn_ms


def test_closed_door_cuts_edges_and_the_way_goes_through_the_other():
    part, open_map, closed_map = planner("prm", 1), two_doors(), two_doors()
    closed_map[8:12, 20] = True
    ends = (5.0, 10.0), (35.0, 10.0)
    direct = part.plan(problem(open_map, *ends))
    round_ = part.plan(problem(closed_map, *ends))
    assert round_.found and round_.details["learnt"] == 0 and round_.details["edges_cut"] > 0
    assert path_valid(round_.points_m, closed_map, 1.0, (0, 0))
    assert round_.points_m[:, 1].max() > 32 > direct.points_m[:, 1].max()
    back = part.plan(problem(open_map, *ends))
    assert back.details["edges_restored"] == round_.details["edges_cut"] and back.details["learnt"] == 0
    assert np.allclose(back.points_m, direct.points_m)


def test_both_doors_closed_is_disconnected_without_growing():
    part, shut = planner("prm"), two_doors()
    shut[:, 20] = True
    path = part.plan(problem(shut, (5.0, 10.0), (35.0, 10.0)))
    assert path.reason is PlanReason.DISCONNECTED and path.details["growths"] == 0


def test_too_small_a_roadmap_grows_until_it_joins():
    path = planner("prm", 2, milestones=2, growth=50).plan(thesis_problem(1))
    assert path.found and path.details["growths"] >= 1


def test_growing_is_bounded():
    path = planner("prm", 2, milestones=2, growth=1, growth_rounds=3).plan(thesis_problem(1))
    assert path.reason is PlanReason.BUDGET_SPENT and path.details["vertices"] <= 5


def test_another_map_is_learnt_anew():
    part = planner("prm")
    part.plan(thesis_problem(1))
    assert part.plan(thesis_problem(3)).details["learnt"] == 1
