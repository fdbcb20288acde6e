"""Fitting a pose to sightings of points: exact cases, honest covariance, wrong matches, rolling shutter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.geometry import exp_se3, inverse, log_se3, transform
from rhs_odometry.keyframe.reprojection import Noise, Sightings, at_middle, fit_pose

FOCAL = 500.0
MOVE = exp_se3(np.array([0.1, -0.05, 0.08, 0.02, -0.06, 0.04]))


def sightings(count=200, seed=0, pixel=0.0, inverse_depth=0.0, twist=None):
    """Points 1 to 5 m before the first camera, seen from MOVE with the given noise and shutter twist."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.0, 5.0, count)
    points = np.stack([rng.uniform(-0.5, 0.5, count) * z, rng.uniform(-0.4, 0.4, count) * z, z], axis=1)
    seen = transform(MOVE, points)
    rows = np.zeros(count)
    if twist is not None:
        rows = seen[:, 1] / seen[:, 2]
        seen = seen + rows[:, None] * (twist[:3] + np.cross(twist[3:], seen))
    rays = seen[:, :2] / seen[:, 2:] + rng.normal(0, pixel / FOCAL, (count, 2))
    rho = 1 / seen[:, 2] + rng.normal(0, inverse_depth, count)
    return Sightings(points, np.zeros((count, 3)), 1 / z, np.full(count, 1e-6), rays, rho, rows)


def error(fit):
    return log_se3(inverse(MOVE) @ fit.camera_from_map)


def test_exact_sightings_give_the_exact_pose():
    fit = fit_pose(sightings(), np.eye(4), focal=FOCAL, noise=Noise())
    assert np.abs(error(fit)).max() < 1e-9
    assert fit.inliers.all() and fit.pixel_rms < 1e-6


def test_the_covariance_says_how_far_off_the_pose_is():
    """Squared error over its covariance has mean 6 (chi squared, six freedoms) over 100 draws of the assumed noise."""
    noise = Noise(1.0, 0.003)
    squared = []
    for seed in range(100):
        fit = fit_pose(sightings(seed=seed, pixel=1.0, inverse_depth=0.003), np.eye(4), focal=FOCAL, noise=noise)
        e = log_se3(fit.camera_from_map @ inverse(MOVE))
        squared.append(e @ fit.information @ e)
    assert 4.5 < np.mean(squared) < 8.5


@pytest.mark.parametrize("times", [2.0, 4.0])
def test_the_covariance_holds_where_the_noise_is_worse_than_told(times):
    """The same with noise that nobody told of: taken as told, the mean would grow with its square. Student's weights have
    counted some of it already, so that the covariance is rather too wide than too narrow."""
    squared = []
    for seed in range(100):
        s = sightings(seed=seed, pixel=times * 0.3, inverse_depth=times * 0.001)
        fit = fit_pose(s, MOVE, focal=FOCAL, noise=Noise(0.3, 0.001))
        e = log_se3(fit.camera_from_map @ inverse(MOVE))
        squared.append(e @ fit.information @ e / fit.misfit)
    assert 2.0 < np.mean(squared) < 7.0


def test_a_third_of_wrong_matches_does_not_move_the_pose():
    s = sightings(300, pixel=0.3, inverse_depth=0.001)
    rays = s.rays.copy()
    rays[:100] = np.random.default_rng(1).uniform(-0.4, 0.4, (100, 2))
    fit = fit_pose(replace(s, rays=rays), np.eye(4), focal=FOCAL, noise=Noise(0.5, 0.002), iterations=30)
    assert np.abs(error(fit)).max() < 2e-3
    assert fit.inliers[100:].mean() > 0.95 and fit.inliers[:100].mean() < 0.1


def test_points_of_unknown_depth_still_say_how_the_camera_turned():
    s = sightings(pixel=0.2, inverse_depth=0.003)
    vague = replace(s, sigma_rho=np.full(len(s), 0.3), inverse_depth=np.full(len(s), np.nan))
    sharp = fit_pose(s, MOVE, focal=FOCAL, noise=Noise(0.2))
    fit = fit_pose(vague, MOVE, focal=FOCAL, noise=Noise(0.2))
    sigma, fine = (np.sqrt(np.diag(np.linalg.inv(f.information))) for f in (fit, sharp))
    assert np.abs(error(fit)[3:]).max() < 3e-3
    assert sigma[2] > 5 * fine[2] and sigma[3:].max() < 5 * fine[3:].max()  # the distance got vague, the turn did not


def test_without_depth_along_a_plane_the_information_is_small_not_wrong():
    few = sightings(2)
    fit = fit_pose(few, MOVE, focal=FOCAL, noise=Noise())
    assert not fit.inliers.any() and np.all(fit.information == 0)


@pytest.mark.parametrize("twist", [[0, 0, 0, 0.0, 0.05, 0.0], [0.01, 0, 0, 0.03, 0.0, 0.02]])
def test_a_rolling_shutter_is_seen_through(twist):
    """Rows read while the camera turns by 3 degrees: a global shutter does not explain them, the right twist does."""
    s = sightings(pixel=0.1, inverse_depth=0.0005, twist=np.array(twist))
    rigid = fit_pose(s, np.eye(4), focal=FOCAL, noise=Noise(0.3, 0.001))
    rolling = fit_pose(s, np.eye(4), focal=FOCAL, noise=Noise(0.3, 0.001, shutter_m=0.05, shutter_rad=0.1))
    assert rolling.pixel_rms < 0.2 < rigid.pixel_rms
    assert np.abs(error(rolling)).max() < 3e-3
    assert np.abs(rolling.shutter[3:] - twist[3:]).max() < 5e-3


def test_points_are_carried_to_the_middle_row():
    point = np.array([[0.0, 0.0, 2.0]])
    turned = at_middle(point, np.array([0.5]), np.array([0, 0, 0, 0, 0.02, 0]))
    np.testing.assert_allclose(turned, [[-0.02, 0.0, 2.0]], atol=1e-12)  # half of 0.02 rad times 2 m, the other way
    np.testing.assert_array_equal(at_middle(point, np.array([0.0]), np.ones(6)), point)
