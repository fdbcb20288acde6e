"""Which runs count, and for how many."""

import numpy as np
import pytest

from rhs.reports.observations import (
    clusters,
    failures_told,
    independent,
    judged,
    numbers,
    reasons,
    succeeded,
)
from rhs.reports.summary import as_text, summarise
from rhs.reports.table import frame


def table(*rows):
    plain = {"status": "ok", "reason": "", "world": "map1", "planner": "astar", "seed": 0}
    return frame({str(k): plain | row for k, row in enumerate(rows)})


def plan(seed=0, length_m=12.0, **more):
    return {"task": "planning", "seed": seed, "plan_success": 1, "plan_valid": 1.0, "plan_reason": "ok",
            "plan_length_m": length_m, "plan_optimal_m": 10.0, "plan_ms": 1.0 + seed, "config_hash": f"h{seed}", **more}


def test_thirty_seeds_of_a_planner_without_randomness_are_one_run():
    found = table(*(plan(seed) for seed in range(30)), *(plan(seed, 12.0 + seed, planner="prm") for seed in range(30)))
    view = summarise(found, columns=["plan_length_m"]).set_index("planner")
    assert tuple(view.loc["astar", ["runs", "independent", "complete", "plan_length_m"]]) == (30, 1, "1.00", "12")
    assert tuple(view.loc["prm", ["runs", "independent"]]) == (30, 30) and "[" in view.loc["prm", "plan_length_m"]
    assert "count once" in as_text(summarise(found))


def test_runs_of_other_problems_or_settings_are_not_repetitions():
    found = table(plan(0), plan(1), plan(0, **{"planning.scenario": 5}), plan(0, **{"planner.samples": 7}),
                  plan(0, world="b"))
    assert len(set(independent(found))) == 4
    assert len(set(independent(table(plan(0), plan(1, 13.0), plan(2))))) == 3  # one differs: it draws random numbers


def test_a_run_done_twice_is_one():
    """Of the same five runs in two sweeps the interval was that of ten."""
    once = [plan(seed, 12.0 + seed, planner="prm", config_hash=f"hash{seed}") for seed in range(5)]
    one, two = (summarise(table(*rows), columns=["plan_length_m"]).iloc[0] for rows in (once, once + once))
    assert (two["runs"], two["independent"]) == (10, 5)
    assert (two["complete"], two["plan_length_m"]) == (one["complete"], one["plan_length_m"])


def test_spl_by_hand():
    """Anderson et al. 2018: 10 / 12, 0 for a failure, 1 at the optimum and below it (an optimum is never beaten)."""
    found = table(plan(0), plan(1, 10.0), plan(2, 9.0), plan(3, None, plan_success=0, plan_valid=None, plan_reason="no"),
                  plan(4, 9.0, plan_valid=0.0))
    np.testing.assert_allclose(sorted(judged(found)["spl"]), [0.0, 0.0, 10 / 12, 1.0, 1.0])


def test_spl_of_a_patrol_and_of_a_run_without_a_path():
    patrol = {"task": "patrol", "places_total": 2, "path_length_m": 20.0, "path_optimal_m": 15.0}
    found = judged(table(patrol | {"places_visited": 2}, patrol | {"places_visited": 1, "seed": 1},
                         {"task": "survey", "tracked_share": 1.0, "seed": 2}))
    by_seed = found.set_index("seed")
    np.testing.assert_allclose(by_seed["spl"], [0.75, 0.0, np.nan])
    assert np.isnan(by_seed.loc[1, "path_length_m"])  # a patrol that ended half-way is not a short one


def test_par2_by_hand():
    """The longest run of the problem took 8 ms: a failure counts 16, on another problem twice its own longest."""
    fails = {"plan_success": 0, "plan_valid": None, "plan_length_m": None, "plan_reason": "budget_spent"}
    found = judged(table(plan(0, plan_ms=4.0, plan_learn_ms=1.0), plan(1, plan_ms=8.0), plan(2, plan_ms=0.1, **fails),
                         plan(3, world="b", plan_ms=2.0, **fails))).set_index("seed").sort_index()
    np.testing.assert_allclose(found["par2_ms"], [4.0, 8.0, 16.0, 4.0])
    assert np.isnan(found.loc[2, "plan_ms"])


def test_an_invalid_path_has_no_figures():
    found = judged(table(plan(0), plan(1, 3.0, plan_valid=0.0))).set_index("seed")
    assert found.loc[1, "plan_success"] == 0 and np.isnan(found.loc[1, "plan_length_m"]) and found.loc[1, "spl"] == 0.0
    assert found.loc[0, "plan_length_m"] == 12.0 and found.loc[1, "plan_optimal_m"] == 10.0


def test_the_column_success_is_believed_and_missing_ones_are_computed():
    found = table({"success": 0.0, "failure": "wall hit", "places_total": 1, "places_visited": 1},
                  {"places_total": 4, "places_visited": 1, "seed": 1})
    assert succeeded(found).tolist() == [0.0, 0.0] and reasons(found) == ["wall hit", "1 of 4 places"]
    assert failures_told(found) == "2 of 2 failed: 1 x 1 of 4 places, 1 x wall hit"


def test_failures_are_counted_by_their_reasons():
    found = table(*(plan(seed, plan_success=0, plan_reason="budget_spent") for seed in range(2)), plan(2, plan_valid=0.0),
                  plan(3), {"status": "ok", "task": "places", "seed": 9})
    assert failures_told(found) == "3 of 4 failed: 2 x budget_spent, 1 x invalid path"


def test_worlds_then_problems_then_runs_are_what_is_sampled():
    assert clusters(table({}, {"seed": 1}, {"world": "b"})).tolist() == ["b", "map1", "map1"]
    problems = clusters(table({"planning.scenario": 1}, {"planning.scenario": 1, "seed": 1}, {"planning.scenario": 2}))
    assert len(set(problems)) == 2
    assert len(set(clusters(table({}, {"seed": 1, "ate_rmse_m": 1.0})))) == 2
    assert len(set(clusters(table({}, {"seed": 1})))) == 1  # the same row again
    drawn = {"world": "random:office"}  # its number is the run's seed, unless it has one
    same = clusters(table(drawn, drawn | {"seed": 1}, {"world": "random:office/1"}, {"world": "random:office/1", "seed": 1}))
    assert same.tolist() == ["random:office/0"] + 3 * ["random:office/1"]
    with pytest.raises(Exception, match="no such column"):
        clusters(table({}), "wrld")


def test_text_in_a_column_of_numbers_is_unknown():
    assert np.isnan(numbers(table({"odd": "abc"}), "odd")).all() and np.isnan(numbers(table({}), "not_there")).all()


def test_start_and_goal_are_not_pooled():
    found = table(plan(0, 10.0, start="[1.0, 2.0]"), plan(0, 20.0, start="[3.0, 4.0]"))
    assert list(summarise(found)["start"]) == ["[1.0, 2.0]", "[3.0, 4.0]"]
