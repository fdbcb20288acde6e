"""The numbers of a run folder: worked out by hand on a synthetic run."""

import csv
import json
import math
import shutil

import numpy as np
import pytest
from helpers.synthetic_run import make_run, room, true_pose

from rhs.api.grid import OccupancyGrid
from rhs.api.metric import columns_of
from rhs.config.dictionary import columns, metrics
from rhs.metrics.evaluate import evaluate
from rhs.metrics.map_agreement import map_agreement
from rhs.runfolder.row import canonical_hash


@pytest.fixture(scope="module")
def values(tmp_path_factory):
    folder = make_run(tmp_path_factory.mktemp("metrics") / "run")
    return folder, evaluate(folder)


def test_survey(values):
    """Each motion 1 % too long round a closed square of 24 m: the sides' errors cancel but for the part not driven."""
    _, row = values
    way = sum(np.linalg.norm(true_pose(i + 1, 40)[:3, 3] - true_pose(i, 40)[:3, 3]) for i in range(39))
    assert row["distance_m"] == pytest.approx(way, abs=1e-6)
    assert row["matched_share"] == 1.0 and row["covered_share"] == pytest.approx(1.0)
    assert row["ate_alignment"] == "se3"
    assert row["tracked_share"] == 1.0 and row["lost_share"] == 0.0
    assert 0.0 < row["ate_before_closing_m"] < 0.1
    # the corrected trajectory is the truth moved 2 cm ahead in its own frame
    assert row["ate_unaligned_m"] < 0.05 and row["ate_rmse_m"] < row["ate_before_closing_m"] + 0.05
    assert row["drift_pct"] == pytest.approx(100 * row["end_error_before_closing_m"] / way)


def test_patrol(values):
    _, row = values
    assert (row["places_total"], row["places_visited"], row["missions"], row["replans"]) == (2, 2, 2, 1)
    assert row["collisions"] == 0 and row["clearance_min_m"] == pytest.approx(0.4)
    # (2, 2) -> (8, 2) -> (8, 8), both legs along free sides
    assert row["path_optimal_m"] == pytest.approx(12.0, abs=1e-3)
    assert row["path_length_m"] == pytest.approx(row["distance_m"], abs=1e-6)
    assert (row["odometry_ms"], row["plan_ms"]) == (3.0, 1.0) and math.isnan(row["localise_ms"])


def test_map_against_itself_and_what_was_not_seen(values):
    _, row = values
    assert row["map_agreement"] == 1.0
    # 5 of 100 columns unseen, 3 of them wall: 2 of the 94 free columns, less the pillar's 20 x 20
    free = 94 * 94 - 400
    assert row["map_observed_share"] == pytest.approx(1 - 2 * 94 / free)


def test_every_named_column_is_there_and_the_same_again(values):
    folder, row = values
    assert {metric.name for metric in metrics("patrol")} <= set(row)
    assert canonical_hash(evaluate(folder)) == canonical_hash(row)


def test_an_empty_folder_is_unknown_throughout(tmp_path):
    row = evaluate(tmp_path)
    assert all(isinstance(v, str) or math.isnan(v) for k, v in row.items() if k != "survey_steps"), row


def test_a_place_only_believed_to_be_reached_is_not_visited(values, tmp_path):
    folder = shutil.copytree(values[0], tmp_path / "run")
    missions = json.loads((folder / "missions.json").read_text())
    missions[1]["goal_m"][0] += 0.6  # the robot said it had arrived 0.6 m from there
    (folder / "missions.json").write_text(json.dumps(missions))
    row = evaluate(folder)
    assert row["places_visited"] == 1 and row["arrival_error_max_m"] > 0.5


def test_a_long_touch_is_one_collision(values, tmp_path):
    folder = shutil.copytree(values[0], tmp_path / "run")
    with (folder / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    for index in (45, 46, 47, 60):
        rows[index]["collided"] = "1"
    with (folder / "steps.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    assert evaluate(folder)["collisions"] == 2


def test_a_run_that_died_in_its_survey_visited_nothing(values, tmp_path):
    folder = make_run(tmp_path / "run", patrol=False)
    (folder / "missions.json").unlink()
    row = evaluate(folder)
    assert (row["places_total"], row["places_visited"], row["missions"]) == (2, 0, 0)
    assert math.isnan(row["path_length_m"]) and math.isnan(row["collisions"])


def test_one_cell_off_is_forgiven_and_two_are_not():
    true = room()
    for shift, agreement in ((1, 1.0), (3, None)):
        moved = OccupancyGrid(np.roll(true.probability, shift, axis=1), 0.1, (0.0, 0.0))
        found = map_agreement(moved, true)["map_agreement"]
        assert found == agreement if agreement else found < 0.99


def test_a_map_of_another_extent_and_resolution():
    true = room()
    finer = OccupancyGrid(np.kron(true.probability, np.ones((2, 2), np.float32))[10:, 10:], 0.05, (0.5, 0.5))
    assert map_agreement(finer, true)["map_agreement"] == 1.0


def test_nothing_observed_agrees_with_nothing():
    blank = OccupancyGrid(np.full((10, 10), np.nan, np.float32), 0.1, (0.0, 0.0))
    found = map_agreement(blank, room())
    assert math.isnan(found["map_agreement"]) and found["map_observed_share"] == 0.0


def test_columns_of_which_more_is_better_are_there():
    """What is named as such is a column; errors, times and counts of mishaps are not among them."""
    more = {name for name, column in columns().items() if column.more_is_better}
    assert {"success", "places_visited", "map_agreement", "tracked_share", "plan_valid", "strip_agreement"} <= more
    assert not [name for name in more if name.endswith(("_ms", "_rad", "wrong_sure_share", "rmse_m", "collisions"))]
    with pytest.raises(ValueError, match="typo"):
        columns_of(lambda run: {"way": 1.0}, ("way", "", "a way", "here"), more_is_better=("typo",))
