"""The page of a patrol: the words follow from the files, and the page needs nothing else."""

import json
import re

import cv2
import numpy as np
import pytest
from helpers.synthetic_run import make_run

from rhs.reports.patrol_story import _changed, patrol_story
from rhs.reports.report import html
from rhs.runfolder.row import write_row
from rhs.runfolder.run import Run

SQUARE = [[10.0, 10.0], [40.0, 10.0], [40.0, 30.0], [10.0, 30.0]]


@pytest.fixture
def run(tmp_path):
    folder = make_run(tmp_path / "run", count=12)
    write_row(folder, {"status": "ok", "world": "room", "kidnaps": 2, "collisions": 0})
    missions = [{"mission": 1, "place": "east", "status": "aborted", "reason": "obstacle near (1.0, 2.0) m", "replans": 0},
                {"mission": 2, "place": "east", "status": "arrived", "reason": "", "replans": 1},
                {"mission": 3, "place": "north", "status": "gave_up", "reason": "no path: goal blocked", "replans": 0},
                {"mission": 4, "place": "west", "status": "arrived", "reason": "", "replans": 0}]
    arrivals = [step for step in Run(folder).steps if "arrived" in step["event"]]
    stood = iter([(float(step["true_x_m"]), float(step["true_y_m"])) for step in arrivals])
    for mission in missions:
        mission |= {"goal_m": next(stood) if mission["status"] == "arrived" else [0, 0], "start_m": [0, 0], "steps": 3}
    (folder / "missions.json").write_text(json.dumps(missions))
    pose = {"index": 5, "x_m": 1.0, "y_m": 2.0, "yaw_rad": 0.0, "sigma_m": 0.02, "sigma_yaw_rad": 0.01}
    change = {"verdict": "new", "width_m": 0.3, "height_m": 0.25, "at_m": [2.0, 2.0, 0.1], "outline_px": SQUARE,
              "before_px": [SQUARE]}
    rows = [{"picture": "01_east", **pose, "width_px": 160, "before": ["01_east_1"], "changes": [change]},
            {"picture": "02_west", **pose, "sigma_m": 0.5, "width_px": 0, "before": [], "changes": []}]
    (folder / "changes.json").write_text(json.dumps(rows))
    large, small = (240, 320), (120, 160)
    for name, size in (("places/01_east", large), ("places/02_west", large), ("places_before/01_east_1", small)):
        (folder / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(folder / f"{name}.png"), np.full((*size, 3), 128, np.uint8))
    return folder


def test_the_words_say_what_the_files_say(run):
    story = patrol_story(run, {"kidnaps": 2, "collisions": 0})
    said = " ".join(story.lines)
    for words in ("reached 2 places: east, west", "Something changed at east.", "gave north up: no path: goal blocked",
                  "On the way to east something stood in the way: obstacle near (1.0, 2.0) m",
                  "On the way to east it planned anew once", "carried elsewhere twice", "touched nothing"):
        assert words in said
    east, west = story.places
    assert east.found == "new: 0.30 m wide, 0.25 m high, near (2.0, 2.0) m." and "was sure" in east.sure
    assert west.found.startswith("Not compared") and "not sure" in west.sure


def test_a_place_that_was_only_believed_to_be_reached_is_not_called_reached(run):
    missions = json.loads((run / "missions.json").read_text())
    missions[1]["goal_m"][0] += 3.0
    (run / "missions.json").write_text(json.dumps(missions))
    said = " ".join(patrol_story(run, {}).lines)
    assert "reached 1 place: west" in said
    assert "mistaken when it said that it had reached east: it stood 3.0 m from it" in said


def test_what_was_found_on_the_way_stands_behind_the_places(run):
    rows = json.loads((run / "changes.json").read_text())
    (run / "changes.json").write_text(json.dumps([*rows, {**rows[0], "picture": "way_0007", "on_way": True}]))
    (run / "on_way").mkdir()
    cv2.imwrite(str(run / "on_way" / "way_0007.png"), np.full((120, 160, 3), 128, np.uint8))
    story = patrol_story(run, {})
    assert "Something changed at east and on the way, in 1 view." in story.lines
    assert story.places[2].title == "On the way, near (1.0, 2.0) m"
    assert story.places[2].pictures.startswith("data:image/jpeg")


def test_both_pictures_stand_side_by_side_with_a_red_outline(run):
    import base64

    data = base64.b64decode(patrol_story(run, {}).places[0].pictures.split(",")[1])
    strip = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).astype(int)
    assert strip.shape == (360, 966, 3)
    red = (strip[..., 2] - strip[..., 1]) > 80
    for left in (0, 486):  # the outline from 10 to 40 of 160 pixels is three times as large on the page
        columns = np.nonzero(red[:, left : left + 480].any(axis=0))[0]
        assert columns.min() == pytest.approx(31, abs=3) and columns.max() == pytest.approx(121, abs=3)


def test_the_page_needs_nothing_else_and_is_small(run):
    page = html(run).read_text(encoding="utf-8")
    assert len(page) < 5e6 and "<h2>What changed</h2>" in page
    assert not re.search(r"https?://|<script|<link|src=\"(?!data:)", page)


@pytest.mark.parametrize("rows, says", [
    ([{"picture": "01_hall", "changes": [], "before": []}], "None of them could be compared with the survey."),
    ([{"picture": "01_hall", "changes": [], "before": [3]}, {"picture": "02_desk", "changes": [], "before": []}],
     "Nothing was found changed at hall."),
    ([{"picture": "01_hall", "changes": [], "before": [3]}], "Nothing was found changed at any of them."),
    ([{"picture": "01_hall", "changes": [{}], "before": [3]}], "Something changed at hall."),
])
def test_a_place_that_nobody_compared_is_not_called_unchanged(rows, says):
    assert _changed(rows) == says
