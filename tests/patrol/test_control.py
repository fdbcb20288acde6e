"""Pure pursuit by hand-computed cases."""

import numpy as np
import pytest

from rhs.api.geometry import se2
from rhs.api.records import Path, PlanReason
from rhs.patrol.control import Pace, ahead_on_path, closest_on_path, first_on_way, points_at, short_of, steer, turn

LINE = np.array([[0.0, 0.0], [10.0, 0.0]])
CORNER = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]])


def test_on_the_path_and_facing_along_it_the_robot_drives_straight():
    command = steer(LINE, se2(1.0, 0.0, 0.0), Pace())
    assert command.turn_radps == pytest.approx(0.0) and command.forward_mps * command.duration_s == pytest.approx(0.2)


def test_left_of_the_path_it_turns_right():
    assert steer(LINE, se2(1.0, 0.1, 0.0), Pace()).turn_radps < 0


def test_facing_backwards_it_turns_on_the_spot_by_one_bounded_step():
    command = steer(LINE, se2(1.0, 0.0, np.pi * 0.9), Pace(turn_step_rad=0.2))
    assert command.forward_mps == 0.0 and command.turn_radps * command.duration_s == pytest.approx(-0.2)


def test_an_arc_turn_keeps_its_radius():
    command = turn(1.0, Pace(speed_mps=0.5, turn_step_rad=0.1, arc_radius_m=0.7))
    assert command.forward_mps / command.turn_radps == pytest.approx(0.7)
    assert command.turn_radps * command.duration_s == pytest.approx(0.1)


def test_closest_point_and_arc_length_round_a_corner():
    arc, near = closest_on_path(CORNER, np.array([3.4, 1.0]))
    assert arc == pytest.approx(4.0) and np.allclose(near, [3.0, 1.0])
    assert np.allclose(points_at(CORNER, np.array([4.0, 99.0])), [[3.0, 1.0], [3.0, 3.0]])


def test_the_stretch_ahead_begins_here_and_has_the_length_asked_for():
    ahead = ahead_on_path(LINE, np.array([2.0, 0.3]), 1.0)
    assert np.allclose(ahead[0], [2.0, 0.0]) and ahead[-1][0] == pytest.approx(3.0)


def test_no_step_turns_more_than_allowed():
    for angle in np.linspace(-np.pi, np.pi, 37):
        command = steer(LINE, se2(1.0, 0.2, angle), Pace(turn_step_rad=0.15))
        assert abs(command.turn_radps * command.duration_s) <= 0.15 + 1e-9


def test_following_a_corner_stays_close_to_it():
    pose, worst = se2(0.0, 0.0, 0.0), 0.0
    for _ in range(200):
        if np.linalg.norm(pose[:2, 3] - CORNER[-1]) < 0.1:
            break
        command = steer(CORNER, pose, Pace())
        for _ in range(10):
            dt = command.duration_s / 10
            pose = pose @ se2(command.forward_mps * dt, 0.0, command.turn_radps * dt)
        worst = max(worst, float(np.linalg.norm(closest_on_path(CORNER, pose[:2, 3])[1] - pose[:2, 3])))
    assert np.linalg.norm(pose[:2, 3] - CORNER[-1]) < 0.1 and worst < 0.25


def test_the_first_thing_on_the_way_is_not_the_nearest_one():
    """The way leads round a corner; a thing behind the wall is nearer than the one in the way."""
    way, here = Path(PlanReason.OK, CORNER), np.array([0.5, 0.0])
    things = np.array([[0.5, 1.0], [3.1, 2.5], [2.9, 1.0]])
    assert np.array_equal(first_on_way(way, things, here, 0.3), things[2])
    assert np.array_equal(first_on_way(way, things[:1], here, 0.3), things[0]), "none is on it: the nearest"
    assert np.array_equal(first_on_way(way, things[:1], here, 0.3, else_m=here), here)


def test_a_way_is_driven_up_to_so_far_before_what_stands_on_it():
    way = np.array([[0.0, 0.0], [4.0, 0.0]])
    ahead = short_of(way, np.array([0.5, 0.1]), np.array([3.0, 0.0]), 1.0)
    assert np.allclose(ahead[0], [0.5, 0.0]) and 1.9 < ahead[-1, 0] <= 2.0
    assert len(short_of(way, np.array([2.5, 0.0]), np.array([3.0, 0.0]), 1.0)) == 0, "it is there"
