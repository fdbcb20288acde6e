"""Mission success apart from status: what each task asks for, and the words for why not."""

import math

import pandas as pd
import pytest

from rhs.metrics.success import success_of

OFF = ("the wheels tell of {} times the {} that the camera saw: {}, or a camera that sits otherwise than was told; type "
       "source.wheel_topic=none to go without wheels")


@pytest.mark.parametrize(("row", "expected"), [
    ({"status": "ok", "task": "planning", "plan_success": 1, "plan_valid": 1.0, "plan_reason": "ok"}, (1.0, "")),
    ({"status": "ok", "task": "planning", "plan_success": 0, "plan_reason": "budget_spent"}, (0.0, "budget_spent")),
    ({"status": "ok", "task": "planning", "plan_success": 1, "plan_valid": 0.0, "plan_reason": "ok"}, (0.0, "invalid path")),
    ({"status": "ok", "plan_success": 1, "plan_valid": None}, (0.0, "invalid path")),  # not judged: not believed
    ({"status": "ok", "task": "patrol", "places_total": 4, "places_visited": 4}, (1.0, "")),
    ({"status": "ok", "task": "patrol", "places_total": 4, "places_visited": 1}, (0.0, "1 of 4 places")),
    ({"status": "ok", "places_total": 4, "places_visited": None}, (0.0, "0 of 4 places")),
    ({"status": "ok", "places_total": 4, "places_reachable": 2, "places_undecided": 0, "places_visited": 2}, (1.0, "")),
    ({"status": "ok", "places_total": 4, "places_reachable": 2, "places_undecided": 1, "places_visited": 2},
     (0.0, "2 of 3 places that can be reached")),
    ({"status": "ok", "task": "survey", "places_total": 4, "places_visited": 0, "tracked_share": 0.9}, (1.0, "")),
    ({"status": "ok", "task": "localise", "belief_lost_share": 0.79}, (0.0, "lost in 79% of the views")),
    ({"status": "ok", "task": "survey", "tracked_share": 0.31}, (0.0, "tracked in 31% of the views")),
    ({"status": "ok", "task": "survey", "tracked_share": 1.0, "map_inconsistency": 0.03, "way_sigma_m": 0.4}, (1.0, "")),
    ({"status": "ok", "task": "survey", "tracked_share": 1.0, "map_inconsistency": 0.06},
     (0.0, "the map reads wrong: beams look through 6% of its walls")),
    ({"status": "ok", "task": "survey", "tracked_share": 1.0, "way_sigma_m": 12.3},
     (0.0, "the way is unsure by 12 m (1 sigma): scans and loops hold it too little")),
    ({"status": "ok", "task": "patrol", "places_total": None, "tracked_share": 0.5}, (1.0, "")),  # a recording
    ({"status": "ok", "task": "unroll", "strips_registered_share": 0.2}, (0.0, "20% of the strips registered")),
    # a wheel that was set twice as large; a scale of depth, or a camera upside down, may be the camera's mistake
    ({"status": "ok", "tracked_share": 1.0, "wheel_way_ratio": 2.0, "wheel_turn_ratio": 2.0, "gated_share": 0.0}, (1.0, "")),
    *[({"status": "ok", "tracked_share": 1.0, "wheel_way_ratio": way, "wheel_turn_ratio": turn, "gated_share": replaced},
       (0.0, said)) for way, turn, replaced, said in (
           (2.0, 2.0, 0.1, OFF.format("2", "way", "another unit, a wrong source.depth_scale")),
           (2.0, 1.0, 0.0, OFF.format("2", "way", "another unit, a wrong source.depth_scale")),
           (1.0, -1.0, 0.0, OFF.format("-1", "turn", "another sign or unit")))],
    ({"status": "failed", "reason": "E: boom", "plan_success": 1, "plan_valid": 1.0}, (0.0, "E: boom")),
    ({"status": "running"}, (0.0, "running")),
    ({}, (0.0, "no status")),
])
def test_success(row, expected):
    assert success_of(row) == expected


def test_a_run_that_was_asked_for_nothing_neither_succeeds_nor_fails():
    success, why = success_of({"status": "ok", "task": "places", "queries": 30, "tracked_share": pd.NA})
    assert math.isnan(success) and why == ""
