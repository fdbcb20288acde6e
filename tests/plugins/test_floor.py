"""A robot that stands firm moves in the plane; one that sways is left its nods, and is seen to sway within a view or two."""

import numpy as np

from rhs.api.geometry import exp_so3, inverse, log_se3, planar, se2, se3
from rhs_odometry.advanced import SwaySettings
from rhs_odometry.features.floor import Floor

SIGMAS = np.array([0.002] * 3 + [0.001] * 3)
INFORMATION = np.diag(SIGMAS**-2.0)


def _motions(tilt_rad, views=60, noise=True):
    """True and measured motions (4x4) of 0.2 m a view, the body tilted by tilt_rad(metres) (roll, pitch) on the way."""
    rng = np.random.default_rng(3)
    poses = [se2(0.2 * k, 0.0, 0.0) @ se3(exp_so3(np.array([*tilt_rad(0.2 * k), 0.0])), np.zeros(3)) for k in range(views)]
    true = [inverse(a) @ b for a, b in zip(poses[:-1], poses[1:], strict=True)]
    jolts = SIGMAS * rng.standard_normal((len(true), 6)) * noise
    return true, [t @ se3(exp_so3(j[3:]), j[:3]) for t, j in zip(true, jolts, strict=True)]


def _firm(metres):
    return 0.0, 0.0


def _nodding(metres):
    return 0.0, np.radians(3.0) * np.sin(2.0 * metres)


def test_a_robot_that_stands_firm_moves_in_the_plane():
    floor = Floor(SwaySettings())
    for measured in _motions(_firm)[1]:
        motion, _ = floor.hold(measured, INFORMATION)
        np.testing.assert_allclose(log_se3(motion)[2:5], 0.0, atol=1e-9)
    assert not floor.sways


def test_a_nod_is_no_step():
    """Held to the plane, a nod of a view of 1.15 degrees would count as a tilt that is not there: the way is bent."""
    floor = Floor(SwaySettings())
    true, measured = _motions(_nodding)
    wrong = [log_se3(inverse(t) @ floor.hold(m, INFORMATION)[0]) for t, m in zip(true, measured, strict=True)]
    assert floor.sways
    assert np.abs(wrong[1:]).max() < 5.0 * SIGMAS.max()  # what was measured, with its noise


def test_the_way_of_a_nodding_robot_stays_straight():
    floor, pose = Floor(SwaySettings()), np.eye(4)
    for measured in _motions(_nodding)[1]:
        pose = pose @ floor.hold(measured, INFORMATION)[0]
    x_m, y_m, _ = planar(pose)
    assert abs(x_m - 0.2 * 59) < 0.05 and abs(y_m) < 0.1


def test_one_wrong_motion_is_no_sway():
    floor = Floor(SwaySettings())
    measured = _motions(_firm)[1]
    for k, motion in enumerate(measured):
        floor.hold(se3(exp_so3(np.array([0.0, 0.2, 0.0])), np.zeros(3)) if k in (30, 45) else motion, INFORMATION)
        assert not floor.sways
