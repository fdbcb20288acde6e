"""task=planning from the command line's configuration: rows, files, refusals."""

import json

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.grid import OccupancyGrid
from rhs.config.compose import compose_config
from rhs.metrics.evaluate import evaluate
from rhs.patrol.run import run_config
from rhs.runfolder.row import canonical_hash, read_row
from rhs.worlds.maps import save_map
from rhs.worlds.planning_question import load_arena


def run(folder, *words):
    folder.mkdir(exist_ok=True)
    return run_config(compose_config(["task=planning", *words]), folder)


COLUMNS = {"plan_success", "plan_valid", "plan_reason", "plan_steps", "plan_length_m", "plan_length_raw_m",
           "plan_above_optimum_pct", "plan_clearance_min_m", "plan_smoothness", "plan_learn_ms", "plan_ms", "homotopy"}


def test_one_run_leaves_a_row_that_follows_from_its_files(tmp_path):
    row = run(tmp_path / "a", "world=map3", "planner=rrt_connect", "seed=3")
    assert row["status"] == "ok" and row["plan_success"] == 1 and row["plan_valid"] == 1.0
    assert 10 * row["plan_optimal_m"] == pytest.approx(126.49268769)
    assert row["homotopy"] in ("above", "below") and set(row) >= COLUMNS
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert {"config.yaml", "map.yaml", "map.pgm", "plan.json", "plan.png", "row.json"} <= names
    stored = read_row(tmp_path / "a" / "row.json")
    for name, value in evaluate(tmp_path / "a", "planning").items():
        assert stored[name] == value or (stored[name] is None and np.isnan(value)), name
    again = run(tmp_path / "b", "world=map3", "planner=rrt_connect", "seed=3")
    row.pop("_cause"), again.pop("_cause")
    assert canonical_hash(row) == canonical_hash(again)


def test_a_map_server_file_by_path_with_typed_ends_and_radius(tmp_path):
    probability = np.zeros((20, 30), np.float32)
    probability[8:12, 10:20] = 1.0
    text, _ = save_map(tmp_path / "hall", OccupancyGrid(probability, 0.1, (5.0, -1.0)))
    words = [f"world={text}", "start=[5.5,0.0]", "goal=[7.5,0.0]", "planner=theta_star"]
    thin = run(tmp_path / "a", *words)
    thick = run(tmp_path / "b", *words, "planning.robot_radius_m=0.3")
    assert thin["plan_length_m"] > 2.0 and thick["plan_length_m"] > thin["plan_length_m"] + 0.1
    assert thick["plan_valid"] == 1.0
    with pytest.raises(ConfigError, match="goal"):
        run(tmp_path / "c", f"world={text}", "start=[5.5,0.0]")


def test_a_failed_plan_is_a_row_with_its_reason(tmp_path):
    row = run(tmp_path / "a", "world=map4", "goal=[4.8,8.0]", "planner=astar")
    assert (row["status"], row["plan_success"], row["plan_reason"]) == ("ok", 0, "goal_blocked")
    assert np.isnan(row["plan_length_m"]) and np.isnan(row["plan_valid"]) and set(row) >= COLUMNS


def test_a_scenario_carries_its_claimed_octile_optimum_and_astar_agrees(tmp_path):
    (tmp_path / "m.map").write_text("type octile\nheight 4\nwidth 5\nmap\n..@..\n..@..\n..@..\n.....\n")
    (tmp_path / "m.map.scen").write_text("version 1\n0\tm.map\t5\t4\t0\t0\t4\t0\t8.82842712\n")
    row = run(tmp_path / "a", f"world={tmp_path / 'm.map.scen'}", "planner=astar", "planning.shorten=false")
    assert row["octile_claimed_m"] == 8.82842712
    assert row["plan_length_m"] == pytest.approx(row["octile_claimed_m"], abs=1e-8)
    assert row["plan_length_m"] > row["plan_optimal_m"]


def test_worlds_are_found_or_refused_in_words(tmp_path):
    assert load_arena("map1").classes[0][0] == "left"
    assert load_arena("map1_raw").robot_radius_m == 0.3
    for word, hint in (("map11", "did you mean 'map1'"), ("no/such.yaml", "no such file"), ("zzzzzz", "worlds: map1"),
                       ("rndom:ofice", "did you mean 'random:office'"), ("./", "is a folder")):
        with pytest.raises(ConfigError, match=hint):
            load_arena(word)
    with pytest.raises(ConfigError, match="scenario"):
        load_arena("map1", scenario=2)


def test_plan_json_is_plain_data(tmp_path):
    run(tmp_path / "a", "world=map2", "planner=prm")
    content = json.loads((tmp_path / "a" / "plan.json").read_text())
    assert content["points_m"] == [[1.0, 1.0], [9.0, 9.0]] and content["reason"] == "ok"
