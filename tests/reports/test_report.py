"""Pictures and pages: made from a folder alone, complete, escaped. (What they look like was looked at.)"""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers.synthetic_run import CAMERA, FACTS, make_run, make_steps

from rhs.api.errors import RhsError
from rhs.recording.writer import Recorder
from rhs.reports.report import html, main, motion, overview, sweep, worst
from rhs.reports.table import rows
from rhs.reports.video import count_frames, video
from rhs.runfolder.row import write_row
from rhs.runfolder.run import Run

SCRIPT = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = make_run(tmp_path_factory.mktemp("report") / "run", count=12)
    write_row(folder, {"status": "failed", "reason": SCRIPT, "world": "room", "planner": "prm", "seed": 1,
                       "places_total": 2, "places_visited": 1, "ate_rmse_m": 0.012})
    recorder = Recorder(folder / "run.mcap", "full", CAMERA, FACTS)
    for step in make_steps(12):
        recorder.step(step)
    for step in make_steps(6, phase="patrol", first=12):
        recorder.step(step)
    recorder.close()
    return folder


def test_the_overview_is_drawn_and_equal_again(run):
    import cv2

    first = overview(run).read_bytes()
    picture = cv2.imread(str(run / "overview.png"))
    assert picture.shape[0] > 600 and picture.std() > 20
    for colour in ((28, 18, 193), (31, 128, 209)):  # places red, the believed survey orange (blue, green, red)
        assert (np.abs(picture.astype(int) - colour).sum(axis=2) < 12).sum() > 20
    assert overview(run).read_bytes() == first


def test_the_errors_view_by_view_are_drawn_with_their_band(run, tmp_path):
    import cv2

    picture = cv2.imread(str(motion(run)))
    for colour in ((28, 18, 193), (242, 227, 207)):  # the error red, the band light blue (blue, green, red)
        assert (np.abs(picture.astype(int) - colour).sum(axis=2) < 12).sum() > 100
    assert motion(tmp_path) is None  # no steps, no picture


def test_walls_found_by_one_eye_are_drawn_where_the_file_has_them_and_named(tmp_path):
    import json

    from rhs.reports.charts import new_figure
    from rhs.reports.drawing import draw_run

    folder = make_run(tmp_path / "run", count=6)
    without = new_figure(5.0, 4.0).add_subplot()
    draw_run(without, Run(folder))
    assert "walls found" not in without.get_legend_handles_labels()[1]
    walls = [{"start_m": [1.0, 2.0], "end_m": [1.0, 8.0], "floor_m": 0.0, "ceiling_m": None},
             {"start_m": [1.0, 8.0], "end_m": [9.0, 8.0], "floor_m": 0.0, "ceiling_m": 2.6}]
    (folder / "walls.json").write_text(json.dumps(walls))
    axes = new_figure(5.0, 4.0).add_subplot()
    draw_run(axes, Run(folder))
    assert axes.get_legend_handles_labels()[1].count("walls found") == 1
    drawn = [line.get_xydata().tolist() for line in axes.get_lines()]
    assert [[1.0, 2.0], [1.0, 8.0]] in drawn and [[1.0, 8.0], [9.0, 8.0]] in drawn


def test_the_overview_of_almost_nothing(tmp_path):
    assert overview(tmp_path).stat().st_size > 1000


def test_the_video_has_a_frame_per_step(run):
    assert count_frames(video(run)) == 18
    assert not [p for p in run.iterdir() if ".tmp-" in p.name]


def test_no_recording_no_video(tmp_path):
    with pytest.raises(RhsError, match="recording=full"):
        video(tmp_path)


def test_one_file_holds_the_whole_report_and_runs_nothing(run):
    page = html(run).read_text()
    assert SCRIPT not in page and "&lt;script&gt;" in page
    assert not re.findall(r"(?:src|href)=\"(?!data:)", page)
    assert page.count("data:image/png") >= 3 and "0.012" in page


def test_a_sweep_is_bars_and_a_table(run, tmp_path):
    for seed in range(3):
        for planner in ("prm", SCRIPT):
            folder = tmp_path / f"{planner[1:4]}{seed}"
            folder.mkdir()
            write_row(folder, {"status": "ok" if seed else "failed", "reason": "", "world": "room", "planner": planner,
                               "seed": seed, "places_total": 1, "places_visited": 1, "ate_rmse_m": 0.1 + 0.01 * seed})
    page = sweep(tmp_path).read_text()
    assert SCRIPT not in page and page.count("data:image/png") >= 2
    assert "2 of 6 failed" in page and "prm" in page


def test_the_report_of_a_sweep_shows_its_worst_runs(run, tmp_path):
    """One of each reason first, the most frequent first of all; those that went well are not shown, nor rows alone."""
    for name, failure in (("a", "0 of 2"), ("b", "0 of 2"), ("c", "1 of 2"), ("d", ""), ("e", "2 of 3")):
        if name == "e":
            (tmp_path / name).mkdir()
        else:
            shutil.copytree(run, tmp_path / name)
        write_row(tmp_path / name, {"status": "ok", "success": 0.0 if failure else 1.0, "failure": failure, "world": "room",
                                    "planner": "prm", "places_total": 2, "places_visited": 1})
    named = [Path(folder).name for folder, _ in worst(rows([tmp_path]))]
    assert named[0] == "a" and set(named[:3]) == {"a", "c", "e"} and named[3:] == ["b"]
    page = sweep(tmp_path).read_text()
    assert re.findall(r"<figcaption>(\w): ([\w ]+)", page) == [("a", "0 of 2"), ("c", "1 of 2"), ("b", "0 of 2")]
    assert len(worst(rows([tmp_path]), most=2)) == 2


def test_the_ways_of_a_sweep_lie_over_one_another_and_over_the_truth(tmp_path):
    """Two odometries on one recording, each in a frame of its own; a third run is of another and has nobody beside it."""
    from rhs.api.geometry import se2
    from rhs.api.trajectory import Trajectory, write_tum
    from rhs.reports.table import some_rows
    from rhs.reports.ways import ways

    stamps = np.arange(20.0)
    way = np.stack([se2(0.1 * k, 0.05 * k * k / 20, 0.0) for k in range(20)])
    for name, world, move in (("orb", "hall", se2(3.0, 1.0, 0.5)), ("gicp", "hall", se2(-2.0, 0.0, -1.0)),
                              ("wheel", "yard", se2(0.0, 0.0, 0.0))):
        (folder := tmp_path / name).mkdir()
        write_tum(folder / "estimate.tum", Trajectory(stamps, se2(9.0, 0.0, 0.0) @ way))
        write_tum(folder / "corrected.tum", Trajectory(stamps, move @ way))
        write_tum(folder / "truth_survey.tum", Trajectory(stamps, se2(40.0, 0.0, np.pi / 2) @ way))
        write_row(folder, {"status": "ok", "reason": "", "task": "survey", "world": world, "odometry": name, "seed": 0,
                           "ate_alignment": "se3", "ate_rmse_m": 0.1})
    panel, = ways(some_rows([tmp_path], []), ["world", "odometry"]).axes
    lines = {line.get_label(): np.column_stack(line.get_data()) for line in panel.get_lines()}
    assert set(lines) == {"true", "orb", "gicp"} and panel.get_title() == "hall"
    for name in ("orb", "gicp"):
        np.testing.assert_allclose(lines[name], lines["true"], atol=1e-6)
    charts = sweep(tmp_path).read_text().count("data:image/png")
    shutil.rmtree(tmp_path / "gicp")
    assert ways(some_rows([tmp_path], []), ["world", "odometry"]) is None
    assert sweep(tmp_path).read_text().count("data:image/png") == charts - 1


def test_the_command(run, tmp_path, capsys):
    copy = shutil.copytree(run, tmp_path / "copy")
    assert main([str(copy)]) == 0 and "report.html" in capsys.readouterr().out
    assert main([str(tmp_path / "nowhere")]) == 2
    (tmp_path / "empty").mkdir()
    assert main([str(tmp_path / "empty")]) == 2


def test_a_truth_in_a_frame_of_its_own_is_laid_onto_the_belief_and_the_empty_map_is_cut_away(tmp_path):
    """The same way measured in a room turned by a quarter and 40 m off; the map of 50 x 50 m knows one square metre."""
    from matplotlib.figure import Figure

    from rhs.api.geometry import se2
    from rhs.api.grid import OccupancyGrid
    from rhs.api.trajectory import Trajectory, write_tum
    from rhs.reports.drawing import draw_run
    from rhs.worlds.maps import save_map

    stamps = np.arange(20.0)
    way = np.stack([se2(0.1 * k, 0.05 * k * k / 20, 0.0) for k in range(20)])
    write_tum(tmp_path / "estimate.tum", Trajectory(stamps, way))
    write_tum(tmp_path / "truth_survey.tum", Trajectory(stamps, se2(40.0, 0.0, np.pi / 2) @ way))
    known = np.full((500, 500), np.nan, np.float32)
    known[250:260, 250:260] = 0.0
    save_map(tmp_path / "map", OccupancyGrid(known, 0.1, (-25.0, -25.0)))
    write_row(tmp_path, {"ate_alignment": "se3"})
    axes = Figure().subplots()
    draw_run(axes, Run(tmp_path))
    true, believed = (np.column_stack(axes.get_lines()[k].get_data()) for k in (0, 1))
    np.testing.assert_allclose(true, believed, atol=1e-6)
    assert axes.get_xlim() == pytest.approx((-0.3, 2.2), abs=1e-6) and axes.get_ylim()[1] == pytest.approx(1.3, abs=1e-6)


@pytest.mark.parametrize(("edges", "label"), [([], "survey, corrected without a loop"),
                                              ([{"accepted": False}], "survey, corrected without a loop"),
                                              ([{"accepted": True}], "survey, 1 loop closed"),
                                              (2 * [{"accepted": True}], "survey, 2 loops closed")])
def test_the_truth_lies_where_the_corrected_way_is_and_a_loop_is_named_where_one_was(tmp_path, edges, label):
    """The map is drawn of the corrected way and the ATE is of it, so the truth is laid onto that, not onto the belief."""
    from matplotlib.figure import Figure

    from rhs.api.geometry import se2
    from rhs.api.trajectory import Trajectory, write_tum
    from rhs.reports.drawing import draw_lines

    stamps = np.arange(20.0)
    way = np.stack([se2(0.1 * k, 0.05 * k * k / 20, 0.0) for k in range(20)])
    write_tum(tmp_path / "estimate.tum", Trajectory(stamps, se2(0.0, 0.0, 0.3) @ way))
    write_tum(tmp_path / "corrected.tum", Trajectory(stamps, way))
    write_tum(tmp_path / "truth_survey.tum", Trajectory(stamps, se2(40.0, 0.0, np.pi / 2) @ way))
    write_row(tmp_path, {"ate_alignment": "se3"})
    (tmp_path / "closure.json").write_text(json.dumps({"edges": edges}))
    axes = Figure().subplots()
    draw_lines(axes, Run(tmp_path))
    lines = {line.get_label(): np.column_stack(line.get_data()) for line in axes.get_lines()}
    np.testing.assert_allclose(lines["survey, true (se3 aligned)"], lines[label], atol=1e-6)


def test_the_page_is_whole_its_pictures_decode_and_its_numbers_are_the_row(run):
    import base64
    import json
    from html.parser import HTMLParser

    import cv2

    class Page(HTMLParser):
        def __init__(self):
            super().__init__()
            self.open, self.pictures, self.text = [], [], []

        def handle_starttag(self, tag, attrs):
            if tag == "img":
                self.pictures.append(dict(attrs))
            elif tag != "meta":
                self.open.append(tag)

        def handle_endtag(self, tag):
            assert self.open.pop() == tag, f"{tag} closed at {self.getpos()}"

        def handle_data(self, data):
            self.text.append(data.strip())

    motion(run)
    page = Page()
    page.feed(html(run).read_text())
    assert not page.open
    for picture in page.pictures:
        raw = np.frombuffer(base64.b64decode(picture["src"].partition(",")[2]), np.uint8)
        assert cv2.imdecode(raw, cv2.IMREAD_COLOR).size > 0 and picture["alt"]
    assert "Error in x, y and heading" in page.text
    for name, value in json.loads((run / "row.json").read_text()).items():
        shown = page.text[page.text.index(name) + 1]
        assert float(shown) == pytest.approx(value, rel=1e-4) if isinstance(value, float) else shown == str(value)


def test_a_simulated_truth_is_drawn_where_it_was(tmp_path, monkeypatch):
    """It shares the frame of the map; only a truth from elsewhere is laid onto the belief."""
    from rhs.reports import drawing

    folder = make_run(tmp_path / "run", count=6)
    write_row(folder, {"status": "ok", "seed": 0, "ate_alignment": "se3"})
    laid = []
    monkeypatch.setattr(drawing, "laid_onto", lambda truth, belief, how: laid.append(how) or truth)
    (folder / "true_map.yaml").rename(tmp_path / "true_map.yaml")
    overview(folder)
    assert "se3" in laid
    laid.clear()
    (tmp_path / "true_map.yaml").rename(folder / "true_map.yaml")
    overview(folder)
    assert laid == []


def test_a_line_is_broken_where_the_robot_was_carried_off_and_nowhere_else():
    from rhs.reports.drawing import broken_at_leaps

    way = np.column_stack([np.arange(20) * 0.25, np.zeros(20)])
    np.testing.assert_array_equal(broken_at_leaps(way), way)
    carried = way.copy()
    carried[12:] += [0.0, 9.0]
    broken = broken_at_leaps(carried)
    assert len(broken) == 21 and np.isnan(broken[12]).all() and np.isfinite(np.delete(broken, 12, axis=0)).all()
    np.testing.assert_array_equal(broken_at_leaps(12.0 * way), 12.0 * way)  # sparse, but even
    assert broken_at_leaps(np.zeros((3, 2))).shape == (3, 2)
