"""task=localise: a laser log found again in the map of its own survey, what is refused, what the columns mean."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rhs
from rhs.api.errors import ConfigError
from rhs.api.geometry import se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Capture
from rhs.api.trajectory import Trajectory
from rhs.metrics.calibration import Beliefs, searches
from rhs.metrics.success import success_of
from rhs.worlds.maps import save_map
from rhs_tasks.localise.given_map import GivenMap, paired, read_given
from rhs_tasks.localise.map_size import map_size_ratio, size_doubt
from rhs_tasks.localise.settings import Localise, checked_start
from rhs_tasks.localise.task import CarriedOff

LOG = Path(__file__).parents[1] / "golden" / "laser.clf"
QUIET = ["recording=off", "pictures=off"]
LASER = ["source=replay", f"source.path={LOG}", "sensor=laser", "odometry=wheel", *QUIET]


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("survey") / "first"
    rhs.run(["task=survey", *LASER, "loop_closer=none", f"output={folder}"], quiet=True)
    return folder


def localise(folder, *words):
    return rhs.run(["task=localise", *LASER, "overwrite=true", f"output={folder}", *words], quiet=True)


def test_a_log_is_followed_in_the_map_of_its_own_survey(surveyed, tmp_path):
    truth = f"source.truth={surveyed / 'corrected.tum'}"
    row = localise(tmp_path / "loc", f"map={surveyed}", truth, "localiser=particle_filter_scan", "start=[0,0,0]")
    assert row["status"] == "ok" and row["localise_steps"] == 47 and row["starts"] == 1
    assert row["found_share"] == 1.0 and row["found_m"] < 1.0 and row["belief_wrong_sure_share"] == 0.0
    assert row["localise_rmse_m"] < 0.1 and row["success"] == 1.0 and row["kidnaps"] == 0
    names = {path.name for path in (tmp_path / "loc").iterdir()}
    assert {"map.yaml", "localise.json", "localised.tum", "truth_localised.tum", "steps.csv"} <= names
    assert json.loads((tmp_path / "loc" / "localise.json").read_text())["map_misfit_m"] is None  # this survey had no truth


def test_a_wrong_start_that_is_never_looked_at_is_wrong_and_sure(surveyed, tmp_path):
    truth = f"source.truth={surveyed / 'corrected.tum'}"
    row = localise(tmp_path / "loc", f"map={surveyed / 'map.yaml'}", truth, "localiser=odometry_only", "start=[1,0,0]")
    assert row["belief_wrong_sure_share"] == 1.0 and row["found_share"] == 0.0 and row["success"] == 0.0
    assert row["localise_rmse_m"] == pytest.approx(1.0, abs=0.1)


def test_a_start_that_is_known_is_the_true_pose_of_the_first_view(surveyed, tmp_path):
    words = [f"map={surveyed}", "localiser=odometry_only", "start=known"]
    row = localise(tmp_path / "loc", *words, f"source.truth={surveyed / 'corrected.tum'}")
    assert row["found_m"] == 0.0 and row["localise_rmse_m"] < 0.01 and row["belief_wrong_sure_share"] == 0.0
    untold = localise(tmp_path / "loc", *words)
    assert untold["status"] == "failed" and "nobody knows the true pose of the first view" in untold["reason"]


def test_restarts_and_kidnaps_are_starts_to_find_oneself_after(surveyed, tmp_path):
    truth = f"source.truth={surveyed / 'corrected.tum'}"
    row = localise(tmp_path / "loc", f"map={surveyed}", truth, "localiser=particle_filter_scan", "restart_every_m=2.5",
                   "kidnap_every_m=1.7", "kidnap_skip_m=0.5")
    assert row["kidnaps"] >= 2 and row["starts"] > row["kidnaps"] and row["localise_steps"] < 47


def test_a_map_in_the_coordinates_of_a_country_is_no_divergence(surveyed, tmp_path):
    text = (surveyed / "map.yaml").read_text()
    at = next(line for line in text.splitlines() if line.startswith("origin"))
    (tmp_path / "map.pgm").write_bytes((surveyed / "map.pgm").read_bytes())
    (tmp_path / "map.yaml").write_text(text.replace(at, "origin: [500000.0, 4600000.0, 0.0]"))
    row = localise(tmp_path / "loc", f"map={tmp_path / 'map.yaml'}", "localiser=odometry_only",
                   "start=[500010.0,4600010.0,0]")
    assert row["status"] == "ok" and row["belief_sure_share"] == 1.0


def test_without_a_truth_nothing_is_said_about_right_and_wrong(surveyed, tmp_path):
    row = localise(tmp_path / "loc", f"map={surveyed}", "localiser=odometry_only", "start=[0,0,0]")
    assert row["belief_sure_share"] == 1.0 and np.isnan(row["found_share"]) and np.isnan(row["success"])


@pytest.mark.parametrize(("words", "said"), [
    (["localiser=odometry_only"], "map is empty"),
    (["map=nowhere_at_all", "localiser=odometry_only"], "no such file, folder or world"),
    (["map={survey}/map.pgm", "localiser=odometry_only"], r"found a \.pgm; type map=.*map\.yaml"),
    (["map={survey}", "localiser=odometry_only"], "from start=unknown; type localiser=particle_filter_scan"),
    (["map={survey}", "localiser=odometry_only", "start=[1,2]"], r"start=\[1, 2\]"),
    (["map={survey}", "localiser=odometry_only", "start=[0,0,0]", "restart_every_m=5"], "leave out start="),
    (["map={survey}", "localiser=odometry_only", "kidnap_skip_m=0"], "kidnap_skip_m=0"),
    (["map={survey}", "localiser=odometry_only", "source.truth=none.tum"], "source.truth=none.tum: no such file"),
    (["map={empty}", "localiser=odometry_only"], "expected the folder of a finished survey"),
    (["map={survey}", "localiser=odometry_only", "planner=prm"], "planner"),
])
def test_what_cannot_be_done_is_refused_in_one_line(surveyed, tmp_path, words, said):
    with pytest.raises(ConfigError, match=said) as caught:
        localise(tmp_path / "loc", *(word.format(survey=surveyed, empty=tmp_path) for word in words))
    assert "\n" not in str(caught.value)


def test_places_cannot_be_recognised_in_a_map_of_walls(surveyed, tmp_path):
    words = ["task=localise", "world=square_small", f"map={surveyed / 'map.yaml'}", "localiser=sift_db", *QUIET]
    with pytest.raises(ConfigError, match="holds no pictures"):
        rhs.run([*words, f"output={tmp_path / 'loc'}"], quiet=True)


def test_a_survey_still_refuses_a_localiser_for_a_recording(tmp_path):
    with pytest.raises(ConfigError, match="localiser"):
        rhs.run([*LASER, "localiser=sift_db", f"output={tmp_path / 'x'}"], quiet=True)


def test_a_ros_map_is_read_and_truth_stands_in_its_frame(tmp_path):
    grid = OccupancyGrid(np.zeros((4, 6), np.float32), 0.5, (-1.0, 2.0))
    save_map(tmp_path / "building", grid)
    given = read_given(str(tmp_path / "building.yaml"))
    assert given.grid.shape == (4, 6) and given.grid.origin_m == (-1.0, 2.0)
    assert np.array_equal(given.in_map(se2(1.0, 2.0, 0.3)), se2(1.0, 2.0, 0.3)) and not given.has_pictures


def test_truth_is_moved_into_the_frame_of_a_survey_by_the_surveys_own_truth():
    stamps = np.arange(5.0)
    way = np.array([se2(0.5 * k, 0.0, 0.0) for k in range(5)])
    frame = se2(3.0, -2.0, 1.0)  # of whoever measured
    given = GivenMap(None, None, None, *paired(Trajectory(stamps, way), Trajectory(stamps, frame @ way)))
    assert np.allclose(given.in_map(frame @ se2(0.7, 0.3, 0.2)), se2(0.7, 0.3, 0.2))
    assert given.misfit_m == pytest.approx(0.0, abs=1e-9)
    bent = way.copy()
    bent[4, 1, 3] += 0.4  # the map has the last view 0.4 m to the left of where it truly is
    given = replace(given, way=bent)
    assert np.allclose(given.in_map(frame @ way[4])[:2, 3], [2.0, 0.4]) and given.misfit_m > 0.05


class Line:
    """A source of views half a metre apart, with wheels and without a truth."""

    camera = facts = views_expected = provides = None
    renderer, stamps_repaired, lost, views_lost, timed, number = "", 0, "", 0, True, -1

    def lead(self):
        self.number += 1
        return Capture(self.number, float(self.number), travel=np.array([0.5, 0.0, 0.0])) if self.number < 20 else None

    def truth(self):
        return None


def test_the_carried_off_robot_misses_a_stretch_and_its_wheels_do_not_turn():
    source = CarriedOff(Line(), 2.0, 1.5)
    seen = []
    while (capture := source.lead()) is not None:
        seen.append((capture.index, source.fresh, capture.travel[0]))
    assert [index for index, fresh, _ in seen if fresh] == [6, 13]  # 2 m are four views; then 1.5 m are left out
    assert all(travel == 0.5 for _, _, travel in seen)


def test_a_search_ends_with_the_next_start_or_after_its_way():
    n = 30
    flags = np.zeros(n, bool)
    flags[[0, 20]] = True
    beliefs = Beliefs(np.arange(n, dtype=float), np.column_stack([np.arange(n, dtype=float), np.zeros(n)]),
                      np.where(np.arange(n) < 4, 5.0, 0.1), np.zeros(n), np.full(n, 0.9), np.ones(n, bool),
                      np.zeros(n, bool), flags)
    first, second = searches(beliefs, beliefs.started, 10.0)
    assert first.metres == 4.0 and len(first.way_m) == 11 and second.metres == 0.0 and not first.wrong_sure


def test_success_asks_for_nine_of_ten_starts_and_one_percent():
    row = {"status": "ok", "task": "localise", "found_share": 0.9, "starts": 10, "belief_wrong_sure_share": 0.01}
    assert success_of(row) == (1.0, "")
    assert success_of(row | {"found_share": 0.8})[0] == 0.0 and "80%" in success_of(row | {"found_share": 0.8})[1]
    assert "wrong and sure" in success_of(row | {"belief_wrong_sure_share": 0.02})[1]


def driven(scale=1.0, sigma_m=0.0, count=300):
    """Beliefs and motions of an arc of 0.1 m steps in a map that is larger by a scale, followed from the second view on."""
    rng = np.random.default_rng(0)
    motions = [np.eye(4), *([se2(0.1, 0.0, 0.02)] * (count - 1))]
    beliefs, pose = [], np.eye(4)
    for motion in motions:
        pose = pose @ motion
        believed = pose.copy()
        believed[:2, 3] = scale * pose[:2, 3] + sigma_m * rng.standard_normal(2)
        beliefs.append(believed)
    return beliefs, motions, [False, *([True] * (count - 1))]


def test_a_map_whose_cells_are_larger_than_was_told_is_said():
    assert map_size_ratio(*driven(1.06, 0.03)) == pytest.approx(1.06, abs=0.01)
    assert map_size_ratio(*driven(0.9)) == pytest.approx(0.9)
    assert map_size_ratio(*driven(1.02)) == 1.0 and map_size_ratio(*driven(1.0, 0.05)) == 1.0
    assert np.isnan(map_size_ratio(*driven(1.06, count=150)))  # seven stretches of 2 m
    beliefs, motions, follows = driven()
    for k in range(10, 300, 10):  # carried off by 5 m again and again, or lost between: no way of anybody
        beliefs[k:] = [se2(5.0, 0.0, 0.0) @ one for one in beliefs[k:]]
        follows[k] = False
    assert np.isnan(map_size_ratio(beliefs, motions, follows))
    said = size_doubt(1.06, 0.053)
    assert "1.060 times as large" in said and "resolution: 0.05 in its yaml" in said and size_doubt(1.0, 0.05) == ""


def test_a_drive_in_a_map_of_another_size_has_failed_whoever_is_sure():
    row = {"status": "ok", "task": "localise", "belief_lost_share": 0.0, "map_size_ratio": 1.06}
    assert success_of(row)[0] == 0.0 and "1.060 times as large" in success_of(row)[1]
    assert np.isnan(success_of(row | {"map_size_ratio": 1.0})[0]) and np.isnan(success_of(row | {"map_size_ratio": None})[0])


def test_starts_are_checked():
    assert checked_start("unknown") == "unknown" and checked_start([1, 2, 90]) == [1.0, 2.0, 90.0]
    for bad in ("somewhere", [1, 2], [1, 2, float("nan")], 3):
        with pytest.raises(ConfigError, match="expected unknown"):
            checked_start(bad)
    assert Localise().start == "unknown"


def test_a_mesh_is_a_map_to_be_found_in(tmp_path):
    """A room of 6 by 4 m with walls of 2.5 m."""
    pytest.importorskip("trimesh")
    corners = [(0, 0), (6, 0), (6, 4), (0, 4)]
    lines = [f"v {x} {y} {z}" for z in (0, 2.5) for x, y in corners] + ["f 1 2 3 4"]
    lines += [f"f {k + 1} {(k + 1) % 4 + 1} {(k + 1) % 4 + 5} {k + 5}" for k in range(4)]
    (tmp_path / "room.obj").write_text("\n".join(lines) + "\n")
    grid = read_given(str(tmp_path / "room.obj")).grid
    assert grid.free()[tuple(grid.cells(np.array([3.0, 2.0]))[0])] and grid.occupied().any()
    assert grid.free().sum() * grid.resolution_m**2 == pytest.approx(24.0, abs=2.0)


@pytest.mark.parametrize(("grey", "metres", "said"), [(0, 0.05, "more of it is wall (100 cells) than floor (0)"),
                                                      (254, 5.0, "its cells are 5 m wide"), (254, 0.05, "")])
def test_a_map_in_which_nobody_finds_himself_is_said(tmp_path, caplog, grey, metres, said):
    (tmp_path / "m.pgm").write_bytes(b"P5\n10 10\n255\n" + bytes([grey] * 100))
    (tmp_path / "m.yaml").write_text(f"image: m.pgm\nresolution: {metres}\norigin: [0, 0, 0]\nnegate: 0\n"
                                     "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    read_given(str(tmp_path / "m.yaml"))
    assert (said in caplog.text) if said else not caplog.text
