"""Beliefs after motions."""

import numpy as np
import pytest

from rhs.api.belief import chance_right, moved
from rhs.api.geometry import planar, se2
from rhs.api.records import Belief, BeliefStatus, Motion, Tracking
from rhs_localisers.odometry_only import OdometryOnly


def _covariance(sigma_m, sigma_rad):
    return np.diag([sigma_m**2] * 3 + [sigma_rad**2] * 3)


def test_the_chance_of_being_right_agrees_with_sampling():
    rng = np.random.default_rng(0)
    sigma_m, sigma_rad = 0.15, np.radians(3.0)
    offsets = rng.normal(0, sigma_m, (200_000, 2))
    yaws = rng.normal(0, sigma_rad, 200_000)
    right = (np.linalg.norm(offsets, axis=1) < 0.25) & (np.abs(yaws) < np.radians(5.0))
    assert chance_right(_covariance(sigma_m, sigma_rad)) == pytest.approx(right.mean(), abs=0.005)


def test_a_sure_pose_is_right_and_a_vague_one_is_not():
    assert chance_right(_covariance(0.001, 0.001)) > 0.999
    assert chance_right(_covariance(10.0, 1.0)) < 0.01


def test_dead_reckoning_once_round_a_square_comes_home_less_sure():
    part = OdometryOnly().build(None)
    part.start(Belief(se2(1.0, 2.0, 0.0), _covariance(0.01, 0.01)))
    motion = Motion(se2(1.0, 0.0, np.pi / 2), _covariance(0.05, 0.02), Tracking.OK)
    beliefs = [part.update(None, motion) for _ in range(4)]
    np.testing.assert_allclose(planar(beliefs[-1].map_from_body), [1.0, 2.0, 0.0], atol=1e-9)
    assert beliefs[-1].probability < beliefs[0].probability < 1.0
    assert np.trace(beliefs[-1].covariance) > np.trace(beliefs[0].covariance)


def test_started_from_nothing_dead_reckoning_says_that_it_is_lost():
    part = OdometryOnly().build(None)
    part.start(None)
    motion = Motion(np.eye(4), _covariance(0.05, 0.02), Tracking.OK)
    belief = part.update(None, motion)
    assert belief.status is BeliefStatus.LOST and belief.probability == 0.0
    assert moved(belief, motion).status is BeliefStatus.LOST
