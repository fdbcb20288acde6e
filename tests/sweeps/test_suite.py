"""corridor-v1 and home-v1: what is frozen stays, rows hold no time, scores are those that can be computed by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import Light
from rhs.api.trajectory import Trajectory, write_tum
from rhs.cli.bench import main
from rhs.cli.main import main as rhs
from rhs.metrics.accuracy import nees_of
from rhs.sweeps import recorded, suite, suite_more
from rhs.sweeps.suite_page import page, rank, scores
from rhs.worlds.world import load_world

ROW = {"status": "ok", "success": 1.0, "places_visited": 4, "collisions": 0, "ate_rmse_m": 0.25, "path_length_m": 30.0,
       "path_optimal_informed_m": 25.0, "belief_wrong_sure_share": 0.0, "arrival_error_max_m": 0.125, "cause": "",
       "wall_ms": 2000.0, "views": 10, "peak_memory_mb": 300.0, "commit": "abc"}
SQUARE = ("square_small", suite.FIRST)


@pytest.mark.parametrize("name", suite.SUITES)
def test_what_is_frozen_is_that_of_version_one(name):
    """Whoever changes buildings, words or columns makes another version."""
    assert suite.digest(suite.SUITES[name]) == suite.SUITES[name].frozen
    buildings = suite.SUITES[name].buildings
    assert len(set(buildings)) == (4 if name == "recordings-v1" else 12)
    assert name == "recordings-v1" or min(seed for _, seed in buildings) >= 10_000


def test_a_world_is_another_when_anything_in_it_moves_by_a_millimetre():
    world = load_world("square_small")
    moved = replace(world, boxes=(), route_m=world.route_m + 0.001)
    assert suite.plain_world(world) == suite.plain_world(replace(world, path=world.path / "elsewhere", light=Light()))
    darker = replace(world, light=Light(brightness=0.5))
    assert suite.plain_world(world) != suite.plain_world(moved) != suite.plain_world(darker)


def test_a_row_by_hand():
    cells = suite.cells_of("mine", SQUARE, ROW)
    assert (cells["places"], cells["reachable"], cells["visited"], cells["extra_m"], cells["ate_m"]) == (
        "4", "4", "4", "5", "0.25")
    missed = suite.cells_of("mine", SQUARE, {**ROW, "places_visited": 3, "success": 0.0})
    assert missed["extra_m"] == "" and missed["success"] == "0"
    gone = suite.cells_of("mine", SQUARE, {"status": "missing", "reason": "no\nrow"})
    assert (gone["status"], gone["success"], gone["visited"], gone["cause"]) == ("missing", "", "", "no row")
    rows = [cells, gone]
    assert suite.read_csv(suite.csv_of(rows)) == rows and "_ms" not in suite.csv_of(rows)
    assert suite.hash_of([cells]) == suite.hash_of([{**cells, "combination": "yours"}]) != suite.hash_of([missed])


def test_what_left_no_row_counts_as_a_failure():
    rows = [suite.cells_of("mine", SQUARE, one) for one in (ROW, {**ROW, "success": 0.0, "collisions": 3},
                                                            {"status": "killed"}, {**ROW, "ate_rmse_m": 0.75})]
    told = scores(rows)
    assert told["success"].startswith("0.50") and told["visited"] == "12 of 16" and told["collisions"] == "3 in 1"
    assert told["ate_m"] == "0.25, 0.75" and told["extra_m"] == "5 (3 runs)"
    assert rank([rows[0]]) < rank(rows)
    text = page(suite.SUITES["corridor-v1"], rows, {"mine": suite.times_of([ROW])}, note="", mine="mine")
    assert "| **mine** | 4 of 12 |" in text and "- mine, square_small: killed" in text and "| abc | 2.0 | 10 | 300 |" in text


@pytest.mark.parametrize(("words", "says"), [
    (["--mine", "odometry=wheel", "world=square"], "world=square is part of the question"),
    (["--mine", "odometry=wheel", "mission.arrive_m=2"], "mission.arrive_m=2 is part of the question"),
    (["--mine", "sensor.depth_noise=0"], "is part of the question"), (["--mine", "odometry=whel"], "did you mean"),
    (["odometry=wheel"], "say whose: --mine"), (["--ours", "best"], "there is procrustes"),
    (["--held-out", "nowhere.json"], "nowhere.json: expected")])
def test_what_is_no_entry_is_refused_in_one_line(words, says, tmp_path, monkeypatch):
    monkeypatch.setattr(suite, "digest", lambda one: one.frozen)
    with pytest.raises(ConfigError, match=says):
        main(["corridor-v1", *words, f"output={tmp_path}"])


def test_options_of_the_suites_are_refused_by_planning_v1():
    with pytest.raises(ConfigError, match="are for corridor-v1, home-v1"):
        main(["planning-v1", "--quick"])


def test_a_list_that_was_not_promised_is_refused(tmp_path, monkeypatch):
    """One that was is taken; a building more, or another salt, is another list."""
    shown = {"salt": "s", "buildings": ["random:loop/20001"]}
    monkeypatch.setitem(suite.PROMISED, "corridor-v1", suite.promise("corridor-v1", "s", ["random:loop/20001"]))
    path = tmp_path / "list.json"
    path.write_text(json.dumps(shown))
    assert suite.revealed("corridor-v1", path) == (("random:loop/20001", 20001),)
    path.write_text(json.dumps({**shown, "salt": "t"}))
    with pytest.raises(ConfigError, match="not the list that was promised"):
        suite.revealed("corridor-v1", path)


def test_a_suite_is_run_gone_on_with_and_verified(tmp_path, monkeypatch, capsys):
    """Of two runs one is taken away: only that is run again, and the table is the same, byte for byte."""
    small = replace(suite.SUITES["corridor-v1"], buildings=(("square_small", 1), ("square_small", 2)))
    monkeypatch.setitem(suite.SUITES, "corridor-v1", replace(small, frozen=suite.digest(small)))
    monkeypatch.setattr(suite, "COMMON", ("task=survey", "source.image_width=64", "recording=off", "pictures=off"))
    monkeypatch.setitem(suite.SUITES, "corridor-v1", replace(small, frozen=suite.digest(small)))
    words = ["corridor-v1", "--mine", "odometry=wheel", "--jobs", "1", f"output={tmp_path / 'runs'}", "--entry",
             str(tmp_path / "entry")]
    assert main(words) == 0
    first, kept = (tmp_path / "runs" / "corridor-v1.csv").read_bytes(), sorted((tmp_path / "entry").glob("*/row.json"))
    assert len(kept) == 2 and first.count(b"\n") == 3 and b"odometry=wheel,square_small,1,ok,1,4,4,,,0.0" in first
    one = tmp_path / "runs" / kept[0].parent.name
    other = (tmp_path / "runs" / kept[1].parent.name / "row.json").stat().st_mtime_ns
    (one / "row.json").unlink()
    assert main(words) == 0 and (tmp_path / "runs" / "corridor-v1.csv").read_bytes() == first
    assert (tmp_path / "runs" / kept[1].parent.name / "row.json").stat().st_mtime_ns == other
    capsys.readouterr()
    assert rhs(["verify", str(tmp_path / "entry"), "--sample", "1", "--jobs", "1"]) == 0


# --- recordings -----------------------------------------------------------------------------------------------------

def test_recordings_are_known_by_their_content_wherever_they_lie(tmp_path):
    """A byte, a name or a file more makes another; the folder it lies in does not."""
    one = replace(recorded.RECORDINGS[0], path="a", files=("b.txt",))
    for root in ("here", "there"):
        (tmp_path / root / "a").mkdir(parents=True)
        (tmp_path / root / "a" / "1.png").write_bytes(b"one")
        (tmp_path / root / "b.txt").write_bytes(b"relations")
    known = recorded.content_hash(tmp_path / "here", one)
    assert known == recorded.content_hash(tmp_path / "there", one)
    (tmp_path / "there" / "a" / "1.png").write_bytes(b"two")
    assert known != recorded.content_hash(tmp_path / "there", one)
    (tmp_path / "here" / "a" / "2.png").write_bytes(b"")
    assert known != recorded.content_hash(tmp_path / "here", one)


def test_a_recording_that_is_missing_or_another_is_refused_in_one_line(tmp_path, capsys):
    assert rhs(["bench", "recordings-v1", "--mine", "odometry=wheel", "sensor=laser", "--data", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "nothing at" in told and "--data FOLDER" in told and "Radish" in told
    (tmp_path / "laser").mkdir()
    for name in ("aces.clf.bz2", "aces.relations"):
        (tmp_path / "laser" / name).write_bytes(b"other")
    assert rhs(["bench", "recordings-v1", "--mine", "odometry=wheel", "sensor=laser", "--data", str(tmp_path)]) == 2
    assert "found content" in capsys.readouterr().err
    assert rhs(["bench", "corridor-v1", "--mine", "odometry=wheel", "--data", str(tmp_path)]) == 2


def test_a_combination_is_asked_about_the_recordings_of_its_sensor():
    assert recorded.asked_of("odometry=x") == recorded.asked_of("sensor=mono odometry=x") == ("tum_fr1_rpy_60", "open3d_5")
    assert recorded.asked_of("sensor=laser") == ("aces", "mit_csail")
    with pytest.raises(ConfigError, match="sensor=lidar"):
        recorded.asked_of("sensor=lidar")


@pytest.mark.parametrize(("sigma_m", "nees"), [(0.1, 1.0), (0.05, 4.0)])
def test_stated_doubts_by_hand(sigma_m, nees, tmp_path):
    """Every position but the first is 0.1 m off in x and in y: with as much doubt that is 1 per dimension."""
    stamps, true = np.arange(5.0), np.tile(np.eye(4), (5, 1, 1))
    true[:, 0, 3] = stamps
    said = true.copy()
    said[1:, :2, 3] += 0.1
    write_tum(tmp_path / "truth_survey.tum", Trajectory(stamps, true))
    write_tum(tmp_path / "estimate.tum", Trajectory(stamps, said))
    (tmp_path / "steps.csv").write_text("phase,stamp_s,sigma_x_m,sigma_y_m\n" + "".join(
        f"survey,{stamp},{sigma_m},{sigma_m}\n" for stamp in stamps))
    assert nees_of(tmp_path) == pytest.approx(nees)
    assert np.isnan(nees_of(tmp_path / "nowhere"))


def test_the_page_of_recordings():
    rows = [recorded.cells_of("mine", "aces", {"status": "ok", "survey_steps": 9, "tracked_share": 0.5,
                                               "relations_trans_m": 0.04}, Path("nowhere")),
            recorded.cells_of("mine", "mit_csail", {"status": "failed", "reason": "no scan"}, Path("nowhere"))]
    text = page(suite.SUITES["recordings-v1"], rows, {"mine": {"words": "sensor=laser odometry=x"}}, note="")
    assert "| mine | 2 of 2 | 1 of 2 | 0.5 | - | - | - | aces 0.04 |" in text
    assert "- mine, mit_csail: failed; no scan" in text
    assert suite.read_csv(suite.csv_of(rows, recorded.CELLS), recorded.CELLS) == rows


# --- why ------------------------------------------------------------------------------------------------------------

def test_blamed_are_the_runs_that_ended_without_all_of_their_mission():
    assert [suite_more.lost(row) for row in (ROW, {**ROW, "success": 0.0}, {"status": "failed"}, {"status": "ok"})] == [
        False, True, False, True]


def stood(folder, *where_m):
    """The files of a patrol that came to the place `desk` there, by its truth."""
    folder.mkdir()
    (folder / "missions.json").write_text(json.dumps([{"place": "desk", "status": "arrived", "goal_m": [1.0, 2.0]}]))
    (folder / "steps.csv").write_text("phase,stamp_s,event,true_x_m,true_y_m\n" + "".join(
        f"patrol,{k},arrived,{x},{y}\n" for k, (x, y) in enumerate(where_m)))
    return folder


def test_the_page_of_what_runs_tell_besides_by_hand(tmp_path):
    """Two runs stood at the desk 0.2 m apart: 0.1 m each from their mean, of two one counts."""
    idle = {"idleness_worst_s": 30.0, "idleness_bound_s": 20.0}
    why = {"status": "ok", "blame_link": "map", "blame_measure": "places", "blame": "of 2 missed places map cost 2"}
    here, there, nowhere = stood(tmp_path / "a", (1.1, 2.0)), stood(tmp_path / "b", (0.9, 2.0)), tmp_path / "c"
    rows = [suite_more.cells_of("mine", SQUARE, {**ROW, **idle}, None, here),
            suite_more.cells_of("mine", SQUARE, {**ROW, **idle, "idleness_worst_s": 50.0}, why, there),
            suite_more.cells_of("mine", SQUARE, ROW, {"status": "failed", "reason": "out of luck"}, nowhere),
            suite_more.cells_of("mine", SQUARE, ROW, {**why, "blame_link": "", "blame": "nothing worth blaming"}, nowhere)]
    assert rows[0]["blame"] == rows[0]["link"] == "" and rows[2]["blame"] == "out of luck"
    text = suite_more.page("corridor-v1", rows)
    assert "| mine | 4 | 2, 2.5 | 0.141 m (2) | 3 | nobody 2, map 1 |" in text
    assert "- mine, square_small: of 2 missed places" in text
    assert suite.csv_of(rows, suite_more.CELLS).splitlines()[1] == "mine,square_small,10000,30,20,desk:1.100000 2.000000,,,"


def test_recordings_are_not_blamed():
    with pytest.raises(ConfigError, match="are for buildings"):
        main(["recordings-v1", "--mine", "odometry=orb", "--blame"])


def test_a_command_that_is_handed_on_does_not_say_where_recordings_and_runs_lie():
    from rhs.cli.suite import shown

    for words in (["recordings-v1", "--data", "/home/me/x", "--quick"], ["recordings-v1", "--data=/home/me/x", "--quick"]):
        said = shown([*words, "output=/home/me/y"])
        assert said.startswith("python -m rhs bench recordings-v1") and "/home" not in said and "FOLDER --quick" in said
