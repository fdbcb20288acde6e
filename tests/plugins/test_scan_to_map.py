"""Laser odometry in hand-made rooms whose geometry and motion are known."""

from __future__ import annotations

import numpy as np
import pytest
from laser_rooms import box, drive, observed, true_wheels

from rhs.api.records import Tracking
from rhs.estimation.scans.planar_poses import between, composed
from rhs_odometry.scan_to_map.config import ScanToMap

# a hall of 10 by 7 m with two pillars, so that no direction is blind
ROOM = np.concatenate([box(-5, -3, 5, 4), box(-1.5, 1.0, -0.7, 2.2), box(2.0, -1.8, 2.6, -1.0)])
WAY = drive([(-4, -2), (4, -2.3), (4, 3), (-4, 3), (-4, -2), (0, 0)])
CORRIDOR = np.array([[[-100, -1], [100, -1]], [[-100, 1], [100, 1]]], float)  # without ends


def led(observations):
    """Motions, poses (N, 3) as revised, and the part."""
    part = ScanToMap().build(None)
    motions = [part.update(one) for one in observations]
    revised = part.revise().poses
    return motions, np.column_stack([revised[:, 0, 3], revised[:, 1, 3], np.arctan2(revised[:, 1, 0], revised[:, 0, 0])])


def error(poses, true=WAY):
    """Metres and radians at the end, the start made to agree."""
    off = between(between(true[0], true[-1]), between(poses[0], poses[-1]))
    return np.hypot(*off[:2]), abs(off[2])


def test_it_stays_within_two_centimetres_round_a_hall():
    metres, radians = error(led(observed(ROOM, WAY))[1])
    assert metres < 0.02 and radians < 0.005


def test_wheels_that_slip_by_a_fifth_and_drift_do_not_matter():
    wheels = true_wheels(WAY) * [0.8, 1.0, 1.15] + [0.0, 0.0, 0.01]
    summed = np.zeros(3)
    for reading in wheels:
        summed = composed(summed, reading)
    wheel_off = np.hypot(*between(between(WAY[0], WAY[-1]), summed)[:2])
    metres, radians = error(led(observed(ROOM, WAY, wheels=wheels))[1])
    assert wheel_off > 1.0 and metres < 0.03 and radians < 0.01


def test_wheels_that_hang_and_catch_up_at_once():
    wheels = true_wheels(WAY)
    for k in range(15, len(wheels) - 8, 25):  # six readings stay the same, the seventh holds all of it
        total = np.zeros(3)
        for reading in wheels[k : k + 7]:
            total = composed(total, reading)
        wheels[k : k + 6], wheels[k + 6] = 0.0, total
    metres, radians = error(led(observed(ROOM, WAY, wheels=wheels))[1])
    assert metres < 0.03 and radians < 0.01


def test_wheels_that_leap_and_never_take_it_back():
    wheels = true_wheels(WAY)
    wheels[40] = composed(wheels[40], np.array([0.9, -0.4, 0.8]))
    wheels[90] = composed(wheels[90], np.array([-0.6, 0.5, -1.2]))
    metres, radians = error(led(observed(ROOM, WAY, wheels=wheels))[1])
    assert metres < 0.03 and radians < 0.01


def test_without_wheels_the_speed_of_late_says_where_to_look():
    metres, radians = error(led(observed(ROOM, WAY, wheels="none"))[1])
    assert metres < 0.05 and radians < 0.01


def test_along_a_corridor_without_ends_only_the_wheels_know():
    """The covariance says so: along the corridor as wide as the wheels are, across it as narrow as the walls are seen."""
    way = drive([(0, 0), (6, 0)])
    with_wheels, _ = led(observed(CORRIDOR, way))
    sigma_m = np.sqrt(np.diag(with_wheels[-1].covariance)[:2])
    assert with_wheels[-1].status is Tracking.OK
    assert sigma_m[0] > 4.0 * sigma_m[1]
    without, _ = led(observed(CORRIDOR, way, wheels="none"))
    assert without[-1].status is Tracking.DEGENERATE
    assert np.sqrt(without[-1].covariance[0, 0]) > 0.1 > 0.05 > np.sqrt(without[-1].covariance[1, 1])


def test_wheels_are_believed_as_far_as_the_scans_found_them_right():
    """A corridor with a hall before it: there good wheels are seen to be good, slipping ones not; in an endless corridor
    nobody can tell, and both are believed as little."""
    def along_m(wheels, room, way):
        motions, _ = led(observed(room, way, wheels=wheels))
        return np.sqrt(motions[-1].covariance[0, 0])

    way = np.concatenate([WAY, drive([tuple(WAY[-1][:2]), (4, 0), (30, 0)])[1:]])
    hall = np.concatenate([box(-5, -3, 5, 4)[[0, 2, 3]], box(-1.5, 1.0, -0.7, 2.2), CORRIDOR + [[5 + 100.0, 0.0]]])
    good, slipping = true_wheels(way) * [1.02, 1.0, 1.02], true_wheels(way)
    slipping[:, 0] *= 1.0 + 0.3 * np.random.default_rng(0).standard_normal(len(way))
    assert along_m(good, hall, way) < 0.03
    assert along_m(slipping, hall, way) > 0.3 * 0.15, "a reading of 15 cm is 4.5 cm off"
    straight = drive([(0, 0), (20, 0)])
    assert along_m(true_wheels(straight) * [1.15, 1.0, 1.0], CORRIDOR, straight) > 0.06


def test_wheels_that_hang_in_a_corridor_do_not_send_the_robot_away():
    """Seen on a real log with hanging wheels: a speed taken from blind scans grew to metres per scan."""
    way = drive([(0, 0), (30, 0)])
    wheels = true_wheels(way)
    for k in (40, 80, 120):
        wheels[k + 6] = wheels[k : k + 7].sum(axis=0)
        wheels[k : k + 6] = 0.0
    assert error(led(observed(CORRIDOR, way, wheels=wheels))[1], way)[0] < 1.0


def test_a_scan_without_a_single_end_is_lost():
    observations = observed(ROOM, WAY[:4])
    blind = observed(np.array([[[500.0, 500.0], [501.0, 500.0]]]), WAY[:5])[4]
    motions, _ = led([*observations, blind])
    assert motions[-1].status is Tracking.LOST and "0 beams" in motions[-1].reason
    assert motions[-1].covariance[0, 0] > 0.2


def test_a_scan_with_a_few_ends_is_held_by_the_wheels():
    """A wall of which ten beams see something: too little to say where the robot is, and the wheels know."""
    observations = observed(ROOM, WAY[:5])
    far = np.array([[[20.0, -1.7], [20.0, 1.7]]]) + WAY[4, :2]
    few = observed(far, WAY[:5])[4]
    assert 0 < np.isfinite(few.scan.ranges_m).sum() < 20
    motions, poses = led([*observations[:4], few])
    assert motions[-1].status is Tracking.DEGENERATE and "wheels" in motions[-1].reason
    assert error(poses, WAY[:5])[0] < 0.03
    assert np.sqrt(motions[-1].covariance[0, 0]) < 0.15


@pytest.mark.parametrize("seed", [1, 2])
def test_its_errors_are_not_wider_than_its_sigmas(seed):
    motions, _ = led(observed(ROOM, WAY, seed=seed, wheels=true_wheels(WAY) * [0.9, 1.0, 1.1]))
    true = true_wheels(WAY)
    surprise = []
    for motion, was in zip(motions[1:], true[1:], strict=True):
        off = between(was, np.array([*motion.previous_from_body[:2, 3],
                                     np.arctan2(motion.previous_from_body[1, 0], motion.previous_from_body[0, 0])]))
        spread = motion.covariance[np.ix_([0, 1, 5], [0, 1, 5])]
        surprise.append(off @ np.linalg.solve(spread, off) / 3.0)
    assert np.mean(surprise) < 1.0 and np.max(surprise) < 5.0
