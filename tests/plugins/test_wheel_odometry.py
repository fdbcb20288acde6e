"""Odometry wheel: hands on what the encoders say, and says when they say nothing. Odometry orb: quick and right."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from painted_room import observe, paintings

from rhs.api.geometry import camera_from_fov, inverse, log_se3, planar, se2
from rhs.api.records import FeatureSettings, Observation, Tracking
from rhs_odometry.features.config import Orb
from rhs_odometry.fused.wheel import Wheel

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0)


def view(k, wheel=None):
    return Observation(k, 0.1 * k, CAMERA, wheel=wheel)


def test_a_square_of_wheel_readings_closes():
    odometry, pose = Wheel().build(None), np.eye(4)
    odometry.update(view(0))
    for k in range(4):
        motion = odometry.update(view(k + 1, np.array([1.0, 0.0, np.pi / 2])))
        pose = pose @ motion.previous_from_body
    np.testing.assert_allclose(pose, np.eye(4), atol=1e-12)
    assert motion.status is Tracking.OK


def test_uncertainty_grows_with_distance_and_turn():
    odometry = Wheel(distance_share=0.1, turn_share=0.2, least_m=0.001, least_rad=0.001).build(None)
    odometry.update(view(0))
    motion = odometry.update(view(1, np.array([0.5, 0.0, 0.1])))
    sigma = np.sqrt(np.diag(motion.covariance))
    assert sigma[0] == pytest.approx(0.051) and sigma[5] == pytest.approx(0.021)


@pytest.mark.parametrize("wheel", [None, np.full(3, np.nan)])
def test_a_view_without_a_reading_is_lost(wheel):
    odometry = Wheel().build(None)
    odometry.update(view(0))
    motion = odometry.update(view(1, wheel))
    assert motion.status is Tracking.LOST and "no wheel travel" in motion.reason


def test_orb_finds_the_motion_and_is_lost_without_features():
    context = SimpleNamespace(rng=np.random.default_rng(0), camera=CAMERA, features=FeatureSettings())
    odometry, start, move = Orb().build(context), se2(-0.5, 0.2, 0.3), se2(0.1, 0.02, 0.08)
    odometry.update(observe(CAMERA, start, paintings(), 0))
    motion = odometry.update(observe(CAMERA, start @ move, paintings(), 1))
    error = planar(inverse(move) @ motion.previous_from_body)
    assert motion.status is Tracking.OK and np.abs(error).max() < 0.02
    assert np.abs(log_se3(inverse(move) @ motion.previous_from_body)).max() < 0.02
    blank = Observation(2, 0.2, CAMERA, np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 2.0, np.float32))
    assert odometry.update(blank).status is Tracking.LOST
