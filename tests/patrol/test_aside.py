"""Among people: who stands before the only way lets others come past, and remembers who stood close beside it."""

from dataclasses import replace

import numpy as np
import pytest
from flatland import BEARINGS, Flatland, Oracle, Through, parts, ring

from rhs.api.geometry import camera_from_fov, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Motion, Observation, Scan, Tracking, Twist
from rhs.patrol.aside import (
    AWAY_M,
    ELSEWHERE_M,
    MOST,
    NEAR_M,
    OFF_M,
    PASSED_VIEWS,
    REST_OFF_VIEWS,
    Aside,
    Trails,
    roomy_spot,
)
from rhs.patrol.control import Pace
from rhs.patrol.guard import Guard, GuardSettings
from rhs.patrol.loop import steps
from rhs.patrol.mission import Logbook, MissionSettings
from rhs.patrol.sentinel import Sentinel
from rhs_replan import NewMission

CAMERA = camera_from_fov(32, 24, 57.0, height_m=1.0)
STILL = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)
WALL_M = 4.0 / np.cos(BEARINGS)


class Shy(Flatland):
    """Somebody stands in the gap between robot and place for as long as the robot is near."""

    passed = False

    def drive(self, command):
        self.passed |= bool(np.hypot(*(self.pose[:2, 3] - (2.65, 1.0))) > 2.0)
        if self.passed:
            self.occupied &= ~self.hidden
        return super().drive(command)


def guard():
    return Guard(0.3, Pace(step_m=0.25, turn_step_rad=np.radians(12.0)), GuardSettings())


def test_the_spot_aside_is_roomy_near_by_and_away_from_who_comes():
    """A corridor 1 m wide along y = 2 that opens into a room from x = 5 to 8; another behind its wall at y = 4.2 is no way
    off; somebody stands at x = 2."""
    blocked = np.ones((90, 100), bool)
    blocked[15:25, 0:60] = blocked[0:40, 50:80] = blocked[44:90] = False
    grid = OccupancyGrid(np.where(blocked, 0.95, 0.05).astype(np.float32), 0.1, (0.0, 0.0))
    at, who = np.array([3.5, 2.0]), np.array([2.0, 2.0])
    spot = roomy_spot(who, at[None], grid, blocked)
    assert 5.5 < spot[0] < 7.5 and spot[1] < 4.0
    assert np.linalg.norm(spot - who) > AWAY_M and np.linalg.norm(spot - at) < NEAR_M
    aside = Aside()
    spots = [aside.goal_m.copy() for _ in range(MOST) if aside.go(at, who, grid, blocked)]
    assert len(spots) == MOST and not aside.go(at, who, grid, blocked), "a bound"
    gaps = [np.linalg.norm(a - b) for k, a in enumerate(spots) for b in spots[:k]]
    assert min(gaps) >= ELSEWHERE_M, "elsewhere each time"


def test_the_spot_aside_is_off_the_way_on_which_somebody_was_seen_to_walk():
    """The room of above, somebody walks through its lower half: the robot goes to the upper one, where a wall is nearer."""
    blocked = np.ones((90, 100), bool)
    blocked[15:25, 0:60] = blocked[0:40, 50:80] = False
    grid = OccupancyGrid(np.where(blocked, 0.95, 0.05).astype(np.float32), 0.1, (0.0, 0.0))
    at, who, trails = np.array([3.5, 2.0]), np.array([2.0, 2.0]), Trails()
    trails.note(np.stack([np.linspace(0.0, 7.9, 80), np.full(80, 2.0)], axis=1))
    trails.note(np.stack([np.linspace(5.0, 7.9, 30), np.full(30, 1.0)], axis=1))
    spot = roomy_spot(who, at[None], grid, blocked, trails.points_m)
    assert np.linalg.norm(trails.points_m - spot, axis=1).min() >= OFF_M - 0.1 and spot[1] > 3.0
    assert roomy_spot(who, at[None], grid, blocked)[1] < 3.0, "that is where most room is"


def test_a_robot_that_stands_aside_goes_on_when_somebody_has_come_by():
    aside, at, who = Aside(), np.array([3.5, 2.0]), np.array([2.0, 2.0])
    blocked = np.zeros((90, 100), bool)
    grid = OccupancyGrid(np.full((90, 100), 0.05, np.float32), 0.1, (0.0, 0.0))

    def rest(passed_at: int) -> int:
        assert aside.go(at, who, grid, blocked, np.array([[3.5, 2.0]]))
        where = aside.goal_m
        return sum(aside.resting(where, 0.3, passed=k == passed_at) for k in range(100))

    assert rest(passed_at=-1) == REST_OFF_VIEWS - 1
    assert rest(passed_at=10) == 10 + PASSED_VIEWS - 1


def test_a_robot_that_somebody_waits_for_goes_aside_and_then_gets_on():
    """Who stands in the only way goes on when the robot has left: waiting alone would last for ever."""
    hidden = np.zeros((80, 80), bool)
    hidden[1:20, 25:28] = hidden[60:79, 25:28] = True
    world = Shy(ring(), (1.0, 1.0, 0.0), (("a", 4.0, 1.0),), hidden=hidden)
    oracle = Oracle(world)
    given = parts(oracle)
    given.planner.corners, given.replan = False, NewMission()
    sentinel = Sentinel(given, world.grid(), (), places=(("a", 4.0, 1.0),), radius_m=world.radius,
                        settings=MissionSettings())
    count = 0
    for step in steps(world, Through(world.camera), oracle, sentinel):
        sentinel.guard.around.moved_s = sentinel.guard.around.now_s  # people about
        count += 1
        assert count < 600 and not step.collided
    assert sentinel.book.missions[-1].status == "arrived" and world.passed


@pytest.mark.parametrize(("away_m", "known"), [(0.45, True), (1.2, False)])
def test_who_came_close_beside_the_robot_is_not_forgotten_for_being_out_of_sight(away_m, known):
    """Somebody comes up ahead; the robot turns away for ten seconds, and nobody sees him go."""
    watched = guard()
    for index in range(1, 8):
        ranges = np.where(np.abs(BEARINGS) < 0.25, away_m if index > 3 else np.inf, WALL_M)
        ranges = np.minimum(ranges, WALL_M)
        watched.observe(Observation(index, 0.5 * index, CAMERA, scan=Scan(BEARINGS, ranges, 6.0)), STILL)
    assert watched.moves
    half = replace(STILL, previous_from_body=se2(0.0, 0.0, np.pi))
    for index in range(8, 28):
        view = Observation(index, 0.5 * index, CAMERA, scan=Scan(BEARINGS, WALL_M, 6.0))
        watched.observe(view, half if index == 8 else STILL)
    assert (watched.around.free_way_m(Twist(-0.5, 0.0, 0.5), 0.05, 1.5) < 1.0) == known


def test_who_walks_off_by_a_step_a_view_from_where_he_stood_is_seen_to_move():
    """0.4 m wide, 2 m ahead for fifteen seconds, then 10 cm to the left in each view: never far from where he was. A thing
    that goes on standing there is not seen to move, though its edges are seen to by 3 cm."""
    for step_m, moves in ((0.1, True), (0.0, False)):
        watched = guard()
        for index in range(1, 50):
            left_m = step_m * max(index - 30, 0) + (0.03 if index % 2 else 0.0)
            there = np.abs(2.0 * np.tan(BEARINGS) - left_m) < 0.2
            ranges = np.where(there & (np.abs(BEARINGS) < 1.0), 2.0 / np.cos(BEARINGS), WALL_M)
            watched.observe(Observation(index, 0.5 * index, CAMERA, scan=Scan(BEARINGS, ranges, 6.0)), STILL)
        assert watched.moves == moves


def test_ground_round_who_came_has_not_been_seen_since():
    """Somebody comes up 1.5 m ahead onto ground that was seen empty: what lies behind him has to be seen anew."""
    watched = guard()
    for index in range(1, 6):
        ranges = np.where((np.abs(BEARINGS) < 0.2) & (index > 3), 1.5, WALL_M)
        watched.observe(Observation(index, 0.5 * index, CAMERA, scan=Scan(BEARINGS, ranges, 6.0)), STILL)
        behind = watched.around.still_unseen(np.array([[1.75, 0.0]]), 0.0)
        assert (len(behind) > 0) == (index > 3)


def test_where_somebody_moves_a_low_thing_out_of_sight_is_kept_if_the_map_knows_it_and_a_trail_is_not():
    """Something low was seen 0.6 m ahead, where the camera then looks over it; the map has a wall there, or 0.3 m beside."""
    for wall_m, known in ((0.6, True), (0.9, False)):
        watched = guard()
        for index in range(1, 40):
            low = Scan(BEARINGS, 0.6 / np.cos(BEARINGS) if index < 3 else WALL_M, 5.0, (0.0, 0.0), 3.0)
            watched.observe(Observation(index, 0.5 * index, CAMERA, scan=Scan(BEARINGS, WALL_M, 6.0), obstacle=low), STILL)
        watched.around.moved_s = watched.around.now_s
        watched.around.map_m = np.stack([np.full(21, wall_m), np.linspace(-0.5, 0.5, 21)], axis=1)
        assert (watched.around.free_way_m(Twist(0.5, 0.0, 0.5), 0.05, 1.0) < 0.5) == known


def test_a_place_put_off_here_is_worth_a_try_from_elsewhere():
    book = Logbook((("a", 1.0, 0.0), ("b", 2.0, 0.0)))
    here = np.array([5.0, 5.0])
    book.put_off(here)
    book.places = (book.places[1], book.places[0])
    assert book.others(here) == 0 and book.others(here + 1.0) == 1


def test_a_face_seen_edge_on_that_shows_with_a_step_of_the_robot_is_nobody_who_came():
    """Five beams that saw nothing end one behind the other over 0.4 m, within 8 cm across the line of sight."""
    watched = guard()
    for index in range(1, 8):
        ranges = np.broadcast_to(WALL_M, len(BEARINGS)).astype(float).copy()
        if index > 3:
            ranges[18:23] = np.linspace(0.7, 1.1, 5)
        watched.observe(Observation(index, 0.5 * index, CAMERA, scan=Scan(BEARINGS, ranges, 6.0)), STILL)
    assert not watched.moves
