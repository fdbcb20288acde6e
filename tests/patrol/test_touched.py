"""What the robot ran into it leaves alone for the rest of the patrol, unless somebody has looked through there since."""

import numpy as np
import pytest
from flatland import BEARINGS, Flatland, parts, ring

from rhs.api.geometry import camera_from_fov, se2
from rhs.api.records import Event, Motion, Observation, Scan, Tracking, Twist
from rhs.patrol.control import Pace
from rhs.patrol.guard import MOST_REFUSED, Guard, GuardSettings
from rhs.patrol.mission import MissionSettings
from rhs.patrol.obstacles import ObstacleWatch
from rhs.patrol.sentinel import Sentinel

CAMERA = camera_from_fov(32, 24, 57.0, height_m=1.0)
AHEAD = Twist(0.5, 0.0, 0.5)
HERE = se2(1.0, 1.0, 0.0)


def guard() -> Guard:
    return Guard(0.3, Pace(step_m=0.25, turn_step_rad=np.radians(6.5)), GuardSettings())


def scan(x_m: float, blind_m: float = 0.0) -> Scan:
    """A wall across the view, so far ahead."""
    return Scan(BEARINGS, x_m / np.cos(BEARINGS), 6.0, (0.0, 0.0), blind_m)


def pictured(index: int, x_m: float) -> tuple[Observation, Motion]:
    """A view of one eye, whose odometry measured that wall."""
    return (Observation(index, 0.5 * index, CAMERA),
            Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK, scan=scan(x_m), scan_measured=True))


def watch() -> ObstacleWatch:
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()
    return ObstacleWatch(grid, grid.free(), tolerance_m=0.3)


def test_what_was_touched_is_an_obstacle_for_the_next_places_too_until_it_is_looked_through() -> None:
    """A thing 0.35 m ahead of (1, 1), touched; the robot looks over it, then from further off through it."""
    touched, at_m = watch(), np.array([[1.35, 1.0]])
    touched.bump(at_m)
    for _ in range(20):
        touched.look(HERE, scan(4.0))
        touched.look(HERE, scan(4.0), scan(4.0, blind_m=1.0))  # it is nearer than the floor in the picture
    touched.forget()
    touched.forget_gone(100.0, np.zeros(2), 0.0)
    assert touched.cells[tuple(touched.grid.cells(at_m)[0])]
    assert touched.touched_m == pytest.approx(at_m, abs=0.06)
    for _ in range(10):
        touched.look(HERE, scan(4.0), scan(4.0))
    assert not touched.cells[tuple(touched.grid.cells(at_m)[0])] and not len(touched.touched_m)


def test_what_was_seen_and_not_touched_is_forgotten_with_the_place() -> None:
    seen = watch()
    for _ in range(5):
        seen.look(HERE, Scan(BEARINGS, np.where(np.abs(BEARINGS) > 0.1, 4.5, 1.5), 6.0))
    assert seen.cells.any()
    seen.forget()
    assert not seen.cells.any()


def test_the_guard_keeps_from_what_was_touched_though_no_view_shows_it() -> None:
    watched = guard()
    watched.observe(*pictured(1, 5.0))
    assert watched.allow(AHEAD)[1] is None
    watched.touched_m = np.array([[0.37, 0.0]])
    assert watched.allow(AHEAD) == (None, Event.STOPPED)
    assert watched.allow(Twist(-0.5, 0.0, 0.5))[1] is None


def test_a_touch_is_where_something_is_known_to_stand_beside_the_bumper() -> None:
    """Nothing is known: straight ahead; a thing on the left of the front, 5 cm from the side: there."""
    watched = guard()
    watched.observe(*pictured(1, 5.0))
    assert np.degrees(np.arctan2(*watched.around.bump(1.0).mean(axis=0)[::-1])) == pytest.approx(0.0, abs=1e-6)
    watched.around.forget()
    row, column = watched.around._cells(0.35 * np.array([[np.cos(1.0), np.sin(1.0)]]))[0]
    watched.around.at_eye.votes[row, column] = 4.0
    watched.around.seen_s[row, column] = watched.around.now_s
    assert abs(np.arctan2(*watched.around.bump(-1.0).mean(axis=0)[::-1])) == pytest.approx(np.pi, abs=0.1), "touched behind"
    assert np.arctan2(*watched.around.bump(1.0).mean(axis=0)[::-1]) == pytest.approx(1.0, abs=0.1)


def test_a_robot_that_came_on_a_tight_arc_does_not_swing_round_as_it_goes_back() -> None:
    watched = guard()
    watched.observe(*pictured(1, 5.0))
    watched.given, watched.touched = Twist(0.27, 1.0, 0.11), True
    back = watched.back_off()
    assert back is not None and back.forward_mps * back.duration_s == pytest.approx(-0.2)
    assert abs(back.turn_radps) * back.duration_s <= np.radians(6.5) + 1e-9


def test_one_eye_goes_back_no_nearer_to_a_wall_of_the_map_than_it_errs() -> None:
    """The map's wall 0.48 m behind the middle of a robot of 0.3 m: a measured one leaves 15 cm, one off pictures 10."""
    watched, wall_m = guard(), np.array([[-0.48, 0.0]])
    watched.observe(*pictured(1, 5.0))
    back = watched.back_off(wall_m)
    assert back is not None and back.forward_mps * back.duration_s == pytest.approx(-0.1, abs=0.03)
    watched.around.monocular = False
    back = watched.back_off(wall_m)
    assert back is not None and back.forward_mps * back.duration_s == pytest.approx(-0.15, abs=0.03)


def test_one_eye_counts_refusals_on_end_and_then_drives_by_what_is_known() -> None:
    """Refused again and again it gives up what it saw, and then it keeps from the walls of the map."""
    watched, refused = guard(), (None, Event.STOPPED)
    for _ in range(2):
        for index in range(MOST_REFUSED - 1):
            watched.observe(*pictured(index, 0.36))
            assert watched.allow(AHEAD) == refused
        watched.around.forget()
        assert watched.allow(AHEAD)[0] is not None, "it came on: the count begins anew"
    for index in range(MOST_REFUSED):
        watched.observe(*pictured(index, 0.36))
        assert watched.allow(AHEAD) == refused
    assert watched.allow(AHEAD)[0] is not None, "what was seen is given up"
    watched.known_m = np.array([[0.36, 0.0]])
    assert watched.allow(AHEAD) == refused


def test_one_eye_keeps_further_from_what_the_map_does_not_know() -> None:
    """A wall 0.6 m ahead of a robot of 0.3 m: 0.25 m of way to a known one, 0.2 m to one that was read off pictures."""
    watched = guard()
    watched.observe(*pictured(1, 0.6))
    for known, way_m in ((True, 0.25), (False, 0.2)):
        watched.around.map_m = watched.around.things() if known else np.zeros((0, 2))
        assert watched.around.free_way_m(AHEAD, 0.05, 0.5) == pytest.approx(way_m, abs=0.03)


def one_eyed(seen_m: np.ndarray) -> tuple[Sentinel, np.ndarray]:
    """One camera at (1, 1) of a free corridor, for which something stands at seen_m (K, 2) of its body frame."""
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()
    sentinel = Sentinel(parts(None), grid, (), places=(("a", 4.0, 1.0),), radius_m=0.3, settings=MissionSettings())
    pose, around = np.array([1.0, 1.0, 0.0]), sentinel.guard.around
    sentinel.book.open(pose[:2])
    sentinel.guard.observe(*pictured(1, 5.0))
    cells = around._cells(seen_m)
    around.at_eye.votes[cells[:, 0], cells[:, 1]], around.seen_s[cells[:, 0], cells[:, 1]] = 4.0, around.now_s
    return sentinel, pose


def test_one_eye_plans_round_what_it_saw_though_the_place_is_a_new_one() -> None:
    """Something as wide as the robot 1 m ahead, of which the map and the watch of this place know nothing."""
    sentinel, pose = one_eyed(np.array([[1.0, 0.02 * k] for k in range(-15, 5)]))
    assert sentinel._plan(pose, []) and sentinel.path is not None
    assert sentinel.path.points_m[:, 1].max() > 1.3


def test_one_eye_that_has_no_way_past_what_it_saw_near_walls_goes_by_the_map() -> None:
    """Walls of the map seem to stand 0.2 m nearer than they do and a thing far from all of them 1 m ahead; or only that."""
    walls = np.array([[0.1 * k, side] for k in range(-9, 30) for side in (-0.65, 0.65)])
    for seen_m, stays in ((walls, 0), (np.array([[1.0, 0.0], [1.05, 0.0]]), 2)):
        sentinel, pose = one_eyed(seen_m)
        around = sentinel.guard.around
        sentinel.guard.known_m = around.map_m = walls * (1.0, 1.3)
        assert sentinel.guard.forget_seen() == (stays == 0)
        assert len(around.things()) == stays
        assert len(sentinel.guard._told_m) == len(walls)
