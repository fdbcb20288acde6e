"""Of a thing that stands in the way one face was seen: the rest of it may stand where no view has looked."""

from dataclasses import replace

import numpy as np
import pytest
from flatland import BEARINGS, Flatland, Oracle, parts, ring
from test_guard import STILL, guard, seen

from rhs.api.geometry import se2
from rhs.api.records import Motion, Scan, Tracking, Twist
from rhs.patrol.control import ahead_on_path
from rhs.patrol.guard import MOST_HELD
from rhs.patrol.mission import MissionSettings
from rhs.patrol.sentinel import Sentinel


def test_where_one_face_of_a_thing_was_seen_the_rest_of_it_may_stand_unless_all_that_is_seen_is_unknown():
    """A face 0.3 m to the left of the way and 0.6 m ahead, past which an arc to the left leads over ground behind it. On the
    map it is a wall, and what is behind it the map knows; a lost robot has no map."""
    watched, behind = guard(), Twist(0.4, 1.0, 0.5)
    face = np.where(BEARINGS > 0.35, 0.6 / np.cos(BEARINGS), 5.0)
    watched.observe(seen(1, face), STILL)
    forward = Motion(se2(0.6, 0.0, 0.0), 1e-6 * np.eye(6), Tracking.OK)
    watched.observe(seen(2, 5.0), forward)
    face_m = watched.around.things()
    way_m = {}
    for name, known in (("unknown", np.zeros((0, 2))), ("on the map", face_m), ("lost", None)):
        watched.around.map_m = known
        way_m[name] = watched.around.free_way_m(behind, 0.05, 0.5, walls_m=watched.around.hidden())
    assert len(face_m) and way_m["unknown"] < 0.2 and way_m["on the map"] == way_m["lost"] > 0.3


def test_looking_over_a_low_box_is_not_seeing_what_lies_behind_its_face():
    """The face of above, of a box lower than the camera: the scan at the camera's height passes over it and all behind it.
    Where a view has shown the floor there before, nothing is hidden."""
    face = np.where(BEARINGS > 0.35, 0.6 / np.cos(BEARINGS), 5.0)
    low, floor = (Scan(BEARINGS, np.broadcast_to(ranges_m, 41).astype(float), 6.0) for ranges_m in (face, 5.0))
    over = replace(floor, blind_m=3.0)  # from nearer than that the floor is below the picture
    way_m = []
    for shown in (over, floor):
        watched = guard()
        watched.around.map_m = np.zeros((0, 2))
        watched.observe(seen(1, 5.0, obstacle=shown), STILL)
        watched.observe(seen(2, 5.0, obstacle=low), STILL)
        watched.observe(seen(3, 5.0, obstacle=over), Motion(se2(0.6, 0.0, 0.0), 1e-6 * np.eye(6), Tracking.OK))
        hidden_m = watched.around.hidden()
        way_m.append(watched.around.free_way_m(Twist(0.4, 1.0, 0.5), 0.05, 0.5, walls_m=hidden_m))
    assert way_m[0] < 0.2 and way_m[1] > 0.3, way_m


def test_what_is_hidden_behind_something_low_bars_the_way_to_a_place_twenty_times_at_most():
    """Only what the camera looked over is let go of; what no view has covered is not."""
    face = np.where(BEARINGS > 0.35, 0.6 / np.cos(BEARINGS), 5.0)
    low, over = (Scan(BEARINGS, np.broadcast_to(ranges_m, 41).astype(float), 6.0, blind_m=blind_m)
                 for ranges_m, blind_m in ((face, 0.0), (5.0, 3.0)))
    watched = guard()
    watched.observe(seen(1, 5.0, obstacle=over), STILL)
    watched.observe(seen(2, 5.0, obstacle=low), STILL)
    watched.observe(seen(3, 5.0, obstacle=over), Motion(se2(0.6, 0.0, 0.0), 1e-6 * np.eye(6), Tracking.OK))
    watched.around.map_m = np.zeros((0, 2))
    watched.around.seen_s[:] = watched.around.now_s  # the camera has looked everywhere
    refused = 0
    while refused < 30 and watched.allow(Twist(0.4, 1.0, 0.5))[0] is None:
        refused, watched._held = refused + 1, 0  # between two it drives elsewhere
    assert watched.refused_for_hidden == refused == MOST_HELD


@pytest.mark.parametrize("monocular", [False, True])
def test_plans_lead_round_what_is_hidden_where_there_is_a_way_round(monocular):
    """A corridor 2 m wide: hidden ground over half of it, then all about the robot, which nobody would get away from.
    A robot that measures depth looks there first and plans so after a refusal; one camera sees nothing by turning to it."""
    world = Flatland(ring(), (1.0, 1.0, 0.0), (("a", 4.0, 1.0),))
    given = parts(Oracle(world))
    given.planner.corners = False
    sentinel = Sentinel(given, world.grid(), (), places=world.facts.places, radius_m=world.radius,
                        settings=MissionSettings())
    sentinel.book.open(np.array([1.0, 1.0]))
    sentinel.guard.observe(seen(1, 5.0), STILL)
    angles = np.linspace(-np.pi, np.pi, 100)
    half = np.stack(np.meshgrid(np.arange(1.2, 1.6, 0.05), np.arange(-1.0, -0.15, 0.05)), axis=-1).reshape(-1, 2)
    about = 0.7 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    sentinel.guard.around.monocular, least_before_m = monocular, 0.39 if monocular else 0.0
    for refused, hidden_m, least_m, most_m in ((0, half, least_before_m, least_before_m + 0.3), (1, half, 0.39, 1.0),
                                               (1, about, 0.0, 0.3)):
        sentinel.guard.around.hidden, sentinel.guard.refused_for_hidden = (lambda m=hidden_m, **_: m), refused
        assert sentinel._plan(np.array([1.0, 1.0, 0.0]), [])
        way_m = ahead_on_path(sentinel.path.points_m, np.array([1.0, 1.0]), np.inf) - 1.0
        gap_m = np.linalg.norm(way_m[:, None] - hidden_m, axis=2).min()
        assert least_m <= gap_m <= most_m, (refused, gap_m)
