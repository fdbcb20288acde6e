"""What a survey leaves: the walls that one eye found, in the frame of the map and moved with the closed loop; the furniture
below the scan."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, inverse, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import (
    Belief,
    Closure,
    Features,
    FeatureSettings,
    Motion,
    Observation,
    Revision,
    Scan,
    Step,
    Tracking,
    View,
    Wall,
)
from rhs.estimation import survey
from rhs.estimation.survey import ViewCollector, furnished
from rhs.estimation.views.packed import held_bytes
from rhs_mappers.occupancy import OccupancyMapper
from rhs_mappers.occupancy_config import Occupancy

CAMERA = camera_from_fov(32, 24, 60.0, height_m=1.0)


def view(index: int, pose: np.ndarray) -> View:
    motion = Motion(np.eye(4), np.eye(6), Tracking.OK)
    return View(index, float(index), CAMERA, motion, pose, np.eye(6), None, None)


class Sees:
    """An odometry that began at its own origin and found one wall two metres to its left."""

    def __init__(self, poses: list[np.ndarray]) -> None:
        self.poses = np.array(poses)

    def revise(self) -> Revision:
        wall = Wall(np.array([0.0, 2.0]), np.array([10.0, 2.0]))
        return Revision(self.poses, (None,) * len(self.poses), (wall,))


def test_walls_are_told_in_the_frame_of_the_map():
    """The survey begins at (5, 1) looking north: what is two metres to the left of that start is the line x = 3."""
    start = se2(5.0, 1.0, np.pi / 2)
    moves = [se2(0.0, 0.0, 0.0), se2(4.0, 0.0, 0.0)]
    views, walls = survey.revise([view(k, start) for k in range(2)], Sees(moves))
    assert np.allclose(views[1].map_from_body[:2, 3], [5.0, 5.0])
    assert walls[0].start_xy_m == pytest.approx([3.0, 1.0])
    assert walls[0].end_xy_m == pytest.approx([3.0, 11.0])


def test_an_odometry_that_revises_nothing_found_no_walls():
    class Blind:
        def revise(self):
            return None

    assert survey.revise([view(0, np.eye(4))], Blind())[1] == ()


def test_each_end_of_a_wall_goes_with_the_view_nearest_to_it():
    """The loop moves the last view by 0.3 m to the right of the way: the far end of the wall with it, the near end not."""
    views = (view(0, se2(0.0, 0.0, 0.0)), view(1, se2(10.0, 0.0, 0.0)))
    closure = Closure(np.array([se2(0.0, 0.0, 0.0), se2(10.0, -0.3, 0.0)]))
    wall, = survey.carried((Wall(np.array([0.5, 1.0]), np.array([9.0, 1.0])),), views, closure)
    assert wall.start_xy_m == pytest.approx([0.5, 1.0])
    assert wall.end_xy_m == pytest.approx([9.0, 0.7])
    turned = Closure(np.array([views[0].map_from_body, se2(10.0, 0.0, np.pi / 2)]))
    wall, = survey.carried((Wall(np.array([0.5, 1.0]), np.array([9.0, 1.0])),), views, turned)
    ahead = inverse(turned.poses[1]) @ [*wall.end_xy_m, 0.0, 1.0]
    assert ahead[:2] == pytest.approx([-1.0, 1.0])  # seen from its view it stays where it was


def test_a_ceiling_never_seen_is_null_in_the_file():
    rows = survey.wall_rows((Wall(np.zeros(2), np.array([1.0, 0.0])), Wall(np.zeros(2), np.ones(2), 0.0, 2.6)))
    assert [row["ceiling_m"] for row in json.loads(json.dumps(rows, allow_nan=False))] == [None, 2.6]


def test_a_table_that_the_scan_passes_over_is_in_the_map_and_what_one_view_only_saw_is_not():
    """Free as the scan says, occupied in the cells where three views saw a table 2 m ahead; one view's speck is left out."""
    bearings = np.linspace(-0.3, 0.3, 61)
    level = Scan(bearings, np.full(61, 4.0), 8.0)
    table = Scan(bearings, np.where(np.abs(bearings) < 0.1, 2.03, np.inf), 5.0, (0.0, 0.0), 3.2)
    speck = Scan(bearings, np.where(bearings > 0.25, 3.0, np.inf), 5.0, (0.0, 0.0), 3.2)
    pose = np.eye(4)
    pose[:2, 3] = 0.5, 2.0
    views = tuple(replace(view(k, pose), scan=level, obstacle=seen) for k, seen in enumerate([table, table, table, speck]))
    free = OccupancyGrid(np.full((40, 60), 0.05, np.float32), 0.1, (0.0, 0.0))
    drawn = furnished(free, views)
    rows, columns = np.nonzero(drawn.occupied())
    assert set(columns) == {25} and 17 <= rows.min() <= rows.max() <= 22
    assert not free.occupied().any(), "nobody changes what it is given"
    hidden = drawn.probability == np.float32(survey.HIDDEN)
    rows, columns = np.nonzero(hidden)
    assert hidden[20, 26:35].all() and columns.max() <= 36, "a metre behind the table nobody saw the floor"
    assert drawn.free()[20, 38] and drawn.free()[28, 30], "further on, and beside it, the scan is believed"
    assert survey.at_eye_level(drawn).free()[hidden].all()


def test_the_floor_behind_a_table_is_free_once_a_view_has_shown_it():
    """The table of before, and then a view along its far side, from which all the floor there is in the picture."""
    bearings = np.linspace(-0.3, 0.3, 61)
    level = Scan(bearings, np.full(61, 4.0), 8.0)
    table = Scan(bearings, np.where(np.abs(bearings) < 0.1, 2.03, np.inf), 5.0, (0.0, 0.0), 3.2)
    along = Scan(bearings, np.full(61, np.inf), 5.0, (0.0, 0.0), 0.5)
    beside = se2(3.1, 0.2, np.pi / 2)
    views = [replace(view(k, se2(0.5, 2.0, 0.0)), scan=level, obstacle=table) for k in range(3)]
    free = OccupancyGrid(np.full((40, 60), 0.05, np.float32), 0.1, (0.0, 0.0))
    before = furnished(free, views)
    after = furnished(free, [*views, replace(view(3, beside), scan=level, obstacle=along)])
    assert not before.free()[20, 30] and after.free()[20, 30]


def test_only_so_many_places_are_compared_with_each_other(monkeypatch):
    """Where memory is bounded: 200 small places on a line, 40 allowed; a task that asks for all of them gets them."""
    monkeypatch.setattr(survey, "MOST_PLACES", 40)

    def stored(most_mb: float) -> int:
        collector = ViewCollector(1, FeatureSettings(), lambda seen, settings: Features(*np.zeros((3, 4, 3), np.float32)),
                                  most_mb)
        for k in range(200):
            seen = Observation(k, float(k), CAMERA, np.zeros((24, 32, 3), np.uint8))
            list(collector.watch([Step(k, "survey", float(k), seen, Motion(np.eye(4), np.eye(6), Tracking.OK),
                                       Belief(se2(0.1 * k, 0.0, 0.0), np.eye(6)), None, None, None, 0, (), None, {})]))
        return sum(view.features is not None for view in collector.views)

    assert 36 <= stored(60.0) <= 40 and stored(np.inf) == 200


def test_a_way_without_end_in_one_room_keeps_its_places_within_their_memory():
    """Round and round on a circle, a megabyte a place, 25 allowed: the circle stays covered, first and last are there."""
    def features(seen, settings):
        return Features(np.zeros((100, 2), np.float32), np.zeros((100, 2500), np.float32), np.zeros((100, 3), np.float32))

    def steps():
        for k in range(400):
            seen = Observation(k, float(k), CAMERA, np.zeros((24, 32, 3), np.uint8))
            pose = se2(2.0 * np.cos(0.1 * k), 2.0 * np.sin(0.1 * k), 0.1 * k)
            yield Step(k, "survey", float(k), seen, Motion(np.eye(4), np.eye(6), Tracking.OK), Belief(pose, np.eye(6)), None,
                       None, None, 0, (), None, {}, np.nan, False)

    collector = ViewCollector(3, FeatureSettings(), features, most_mb=25.0)
    assert len(list(collector.watch(steps()))) == 400
    stored = [view for view in collector.views if view.features is not None]
    assert 20 <= len(stored) <= 25 and sum(held_bytes(view.features) for view in stored) <= 25.5e6
    assert collector.views[0].features is not None and collector.views[-1].features is not None
    angles = np.sort([0.1 * view.index % (2 * np.pi) for view in stored])
    assert np.diff(angles, append=angles[0] + 2 * np.pi).max() < 1.0


def unsure(sigma_m: float, sigma_deg: float = 0.0) -> np.ndarray:
    return np.diag([sigma_m**2, sigma_m**2, 0.0, 0.0, 0.0, np.radians(sigma_deg) ** 2])


def test_where_the_end_of_a_survey_does_not_know_where_it_is_the_map_is_that_of_its_beginning():
    """Ten views of a wall 4 m ahead; the last six believe themselves 0.3 m too far on, and say that they are unsure."""
    scan = Scan(np.linspace(-0.4, 0.4, 81), 4.0 / np.cos(np.linspace(-0.4, 0.4, 81)), 8.0)
    views = [replace(view(k, se2(0.3 * (k > 3), 0.0, 0.0)), scan=scan, of_map=None if k % 3 else unsure(0.1 * (k // 3)))
             for k in range(10)]
    mapper = OccupancyMapper(Occupancy(), (-1.0, -2.0, 6.0, 2.0))
    grid = survey.draw(views, mapper)
    row, column = grid.cells(np.array([[4.0, 0.0]]))[0]
    assert grid.probability[row, column] > 0.8
    told = [replace(one, of_map=None) for one in views]  # where nobody says how unsure they are, the last have the last word
    assert survey.draw(told, mapper).probability[row, column] < 0.1


def test_views_that_know_where_they_are_are_drawn_as_they_were_taken():
    """4 cm and 1 degree put the end of a beam of 3 m off by 7 cm: less than a cell of the map."""
    said = {0: unsure(0.0), 2: unsure(0.04, 1.0), 4: unsure(0.2, 2.0), 5: unsure(0.04, 1.0)}
    views = [replace(view(k, np.eye(4)), of_map=said.get(k)) for k in range(6)]
    assert survey.surest_last(views) == [4, 3, 0, 1, 2, 5]  # of view 3 nobody said: half way between its neighbours
    assert survey.surest_last(views[:4]) == [0, 1, 2, 3]
    assert survey.surest_last([view(k, np.eye(4)) for k in range(3)]) == [0, 1, 2]
