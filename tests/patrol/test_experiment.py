"""The main job, whole, in a small building: what a row says of it, and that it says the same twice."""

import csv
import json
import subprocess
import sys

import pytest

import rhs
from rhs.runfolder.row import canonical_hash, read_row

WORDS = ["world=square_small", "source.image_width=160", "features.count=150"]


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """One patrol of the small square, shared by the tests of this file, while another process drives it too: the row, and
    the folders of both."""
    folder = tmp_path_factory.mktemp("run")
    beside = subprocess.Popen([sys.executable, "-m", "rhs", *WORDS, "recording=off", f"output={folder / 'beside'}"],
                              stdout=subprocess.DEVNULL)
    row = rhs.run([*WORDS, f"output={folder / 'whole'}"], quiet=True)
    assert beside.wait(timeout=600) == 0
    return row, folder / "whole", folder / "beside"


@pytest.fixture(scope="module")
def whole(both):
    return both[:2]


def test_every_place_is_visited_without_a_touch(whole):
    row, _ = whole
    assert row["status"] == "ok", row["reason"]
    assert row["places_visited"] == row["places_total"] == 4
    assert row["missions"] == 4 and row["collisions"] == 0
    assert row["clearance_min_m"] > 0.0


def test_the_survey_ends_where_it_did_and_the_map_agrees_with_the_plan(whole):
    """`keyframe` is back in its own map within millimetres; the graph may move it by what one sighting is worth."""
    row, _ = whole
    assert row["end_error_before_closing_m"] < 0.02 and row["end_error_m"] < 0.02
    assert row["map_agreement"] > 0.9


def test_the_robot_drives_at_least_the_shortest_way(whole):
    row, _ = whole
    assert row["path_length_m"] >= row["path_optimal_m"] - 4 * 0.25
    assert row["path_length_m"] <= 1.5 * row["path_optimal_m"]


def test_the_folder_holds_what_the_readme_promises(whole):
    _, folder = whole
    promised = ["row.json", "config.yaml", "steps.csv", "estimate.tum", "corrected.tum", "truth_survey.tum", "patrol.tum",
                "truth_patrol.tum", "map.yaml", "map.pgm", "true_map.yaml", "missions.json", "plans.json",
                "closure.json", "run.mcap", "overview.png"]
    assert [name for name in promised if not (folder / name).is_file()] == []
    assert len(list((folder / "places").glob("*.png"))) == 4


def test_the_row_can_be_recomputed_from_the_files(whole):
    from rhs.metrics.evaluate import evaluate

    row, folder = whole
    again = evaluate(folder)
    assert {k: row[k] for k in again} == pytest.approx(again, nan_ok=True)


def test_steps_and_missions_agree(whole):
    row, folder = whole
    with (folder / "steps.csv").open() as file:
        steps = list(csv.DictReader(file))
    arrived = [step for step in steps if "arrived" in step["event"].split("+")]
    missions = json.loads((folder / "missions.json").read_text())
    assert len(arrived) == len([m for m in missions if m["status"] == "arrived"]) == row["places_visited"]
    assert len(steps) == row["views"]


def test_two_processes_at_once_give_the_same_row(both):
    _, whole, beside = both
    assert canonical_hash(read_row(whole / "row.json")) == canonical_hash(read_row(beside / "row.json"))
