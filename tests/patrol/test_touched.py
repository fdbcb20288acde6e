"""What the robot ran into it leaves alone for the rest of the patrol, unless somebody has looked through there since."""

import numpy as np
import pytest
from flatland import BEARINGS, Flatland, parts, ring

from rhs.api.geometry import camera_from_fov, se2
from rhs.api.records import Belief, BeliefStatus, Event, Motion, Observation, Scan, Tracking, Twist
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


def blind(index: int, moved_m: float) -> tuple[Observation, Motion]:
    """A view of one eye in which nothing could be measured."""
    nothing = Scan(BEARINGS, np.full(len(BEARINGS), np.nan), 6.0)
    return (Observation(index, 0.5 * index, CAMERA),
            Motion(se2(moved_m, 0.0, 0.0), 1e-6 * np.eye(6), Tracking.OK, scan=nothing, scan_measured=True))


def see(watched: Guard, seen_m: np.ndarray) -> None:
    """Something was seen just now at (K, 2) of the body frame."""
    around = watched.around
    cells = around._cells_at(seen_m)
    around.at_eye.votes[cells[:, 0], cells[:, 1]], around.seen_s[cells[:, 0], cells[:, 1]] = 4.0, around.now_s


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


def test_one_eye_refused_again_and_again_passes_closer_by_a_wall_before_it_gives_up_what_it_saw() -> None:
    """A wall of the map on the right, seen 4 cm from the side of a robot that keeps 5: refused six times, then passed."""
    watched, wall_m = guard(), np.array([[0.05 * k, -0.34] for k in range(4, 20)])
    watched.observe(*pictured(1, 5.0))
    see(watched, wall_m)
    watched.around.map_m = wall_m
    allowed = [watched.allow(AHEAD)[0] is not None for _ in range(MOST_REFUSED + 1)]
    assert allowed == [False] * MOST_REFUSED + [True]
    assert len(watched.around.things()) > 10, "and it still knows of it"
    see(watched, np.array([[0.36, 0.0]]))
    watched.around.map_m = np.concatenate([wall_m, [[0.36, 0.0]]])
    for _ in range(MOST_REFUSED):
        assert watched.allow(AHEAD) == (None, Event.STOPPED), "what stands right ahead bars closer too"
    assert not len(watched.around.things()), "then what was seen is given up"


def test_going_back_and_on_again_before_the_same_thing_is_no_headway() -> None:
    """Refused, back by 0.2 m, and on by 0.12: still refused on end; let on by 0.25 m it is not."""
    watched, on = guard(), Twist(0.5, 0.0, 0.24)
    for index in range(MOST_REFUSED - 1):
        watched.around.forget()
        watched.observe(*pictured(index, 0.36))
        assert watched.allow(AHEAD) == (None, Event.STOPPED)
        watched.around.forget()
        assert watched.back_off() is not None and watched.allow(on)[0] is not None
    assert watched._refused == MOST_REFUSED - 1
    for _ in range(20):
        assert watched.allow(on)[0] is not None
    assert watched._refused == 0


def test_one_eye_that_turns_beside_something_knows_of_it_until_it_has_driven_on() -> None:
    """A thing seen 0.4 m to the left; two minutes of turns on the spot; then 6 m of way."""
    watched = guard()
    watched.observe(*blind(0, 0.25))
    see(watched, np.array([[0.0, 0.4]]))
    for index in range(1, 250):
        watched.observe(*blind(index, 0.0))
    assert len(watched.around.things()) == 1
    watched = guard()
    watched.observe(*blind(0, 0.0))
    for index in range(1, 25):  # it drives on for 6 m beside a wall
        see(watched, np.array([[0.0, 0.4]]))
        watched.observe(*blind(index, 0.25))
    behind_m = -watched.around.things()[:, 0].min()
    assert 1.0 < behind_m, "what it saw on its last metres it knows"
    for index in range(200, 225):
        watched.observe(*blind(index, 0.25))
    assert not len(watched.around.things())


def test_one_eye_keeps_further_from_what_the_map_does_not_know() -> None:
    """A wall 0.6 m ahead of a robot of 0.3 m: 0.25 m of way to a known one, 0.2 m to one that was read off pictures."""
    watched = guard()
    watched.observe(*pictured(1, 0.6))
    for known, way_m in ((True, 0.25), (False, 0.2)):
        watched.around.map_m = watched.around.things() if known else np.zeros((0, 2))
        assert watched.around.free_way_m(AHEAD, 0.05, 0.5) == pytest.approx(way_m, abs=0.03)


def one_eyed(seen_m: np.ndarray, width_m: float = 2.0) -> tuple[Sentinel, np.ndarray]:
    """One eye in the middle of a free corridor so wide, for which something stands at seen_m (K, 2) of its body frame."""
    pose = np.array([1.0, 0.5 * width_m, 0.0])
    grid = Flatland(ring(width_m=width_m), tuple(pose), ()).grid()
    sentinel = Sentinel(parts(None), grid, (), places=(("a", 4.0, pose[1]),), radius_m=0.3, settings=MissionSettings())
    sentinel.book.open(pose[:2])
    sentinel.guard.observe(*pictured(1, 5.0))
    see(sentinel.guard, seen_m)
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


def test_one_eye_whose_way_is_barred_by_what_it_saw_near_walls_plans_by_the_map_and_does_not_forget_it() -> None:
    """A corridor with 0.8 m between its walls, which a robot of 0.6 m saw 0.1 m too near on both sides."""
    walls = np.array([[0.1 * k, side] for k in range(-9, 30) for side in (-0.28, 0.38)])
    sentinel, pose = one_eyed(walls, width_m=0.9)
    sentinel.guard.around.map_m, sentinel.barred, sentinel.backed = sentinel.watch.walls_near(pose, 2.5), 1, 9
    seen = len(sentinel.guard.around.things())
    assert not sentinel._plan(pose, [])
    assert sentinel._after_failed_plan(pose, []) is None and sentinel.by_map
    assert sentinel._plan(pose, []) and len(sentinel.guard.around.things()) == seen > 0


def test_one_eye_that_saw_one_face_of_a_box_plans_round_the_rest_of_it_where_that_is_hardly_longer() -> None:
    """A face 0.4 m wide 1 m ahead, beside which the shortest way turns in behind it; where a robot of 0.3 m has passed and
    looked nothing is hidden."""
    sentinel, pose = one_eyed(np.zeros((0, 2)))
    face = Scan(BEARINGS, np.where(np.abs(BEARINGS) < 0.2, 1.0 / np.cos(BEARINGS), np.nan), 6.0)
    belief = Belief(se2(*pose), 1e-6 * np.eye(6), BeliefStatus.TRACKING, 1.0)
    for _ in range(3):
        sentinel.note(belief, face)
    hidden_m = sentinel.grid.centres(np.argwhere(sentinel.watch.hidden)) - pose[:2]
    assert 1.3 < hidden_m[:, 0].max() < 1.7 and np.abs(hidden_m[:, 1]).max() < 0.5, "half a metre behind the face"
    assert sentinel._plan(pose, []) and sentinel.path is not None
    way = sentinel.path.points_m - pose[:2]
    way = np.concatenate([np.linspace(a, b, 50) for a, b in zip(way, way[1:], strict=False)])
    assert np.linalg.norm(way[:, None] - hidden_m, axis=2).min() > 0.3 + sentinel.settings.margin_m - 0.1
    past = Belief(se2(1.2, 0.0, 0.0) @ belief.map_from_body, 1e-6 * np.eye(6), BeliefStatus.TRACKING, 1.0)
    sentinel.note(past, scan(4.0))
    assert len(np.argwhere(sentinel.watch.hidden)) < len(hidden_m)
