"""Odometry procrustes on exactly rendered views: right motions, and no confident answer where nothing is seen."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from painted_room import observe, paintings

from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov, exp_se3, inverse, log_se3, se2, transform
from rhs.api.records import Features, FeatureSettings, Observation, Tracking, Twist
from rhs.api.settings import make
from rhs.estimation.views.features import share
from rhs_odometry.features.config import Procrustes
from rhs_odometry.features.floor import on_floor

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0, forward_m=0.1)
START = se2(-0.5, 0.2, 0.3)


def build(seed=0, **settings):
    context = SimpleNamespace(rng=np.random.default_rng(seed), camera=CAMERA, features=FeatureSettings())
    return Procrustes(**settings).build(context)


def view(pose, index=0):
    return observe(CAMERA, pose, paintings(), index)


def follow(odometry, *poses):
    return [odometry.update(view(pose, k)) for k, pose in enumerate(poses)][-1]


def blank(**extra) -> Observation:
    grey, depth = np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 2.0, np.float32)
    return Observation(1, 0.1, CAMERA, grey, depth, **extra)


@pytest.mark.parametrize("refine", ["none", "reprojection"])
@pytest.mark.parametrize("move", [se2(0.2, 0.0, 0.0), se2(0.0, 0.0, 0.17), se2(0.1, 0.02, -0.1)])
def test_motion_of_the_body_is_found(refine, move):
    """Forward, pure yaw and both at once, to 5 mm and 2 mrad; the camera stands 0.1 m ahead of the body's axis."""
    motion = follow(build(refine=refine), START, START @ move)
    error = log_se3(inverse(move) @ motion.previous_from_body)
    assert motion.status is Tracking.OK
    assert np.abs(error[:3]).max() < 0.005
    assert np.abs(error[3:]).max() < 0.002


def test_the_wheels_tell_the_room_from_somebody_who_fills_most_of_the_picture():
    """60 key-points move by themselves, 25 stand still: alone, vision says what most of them say."""
    rng = np.random.default_rng(0)
    first = np.column_stack([rng.uniform(-1.0, 1.0, (85, 2)), rng.uniform(1.5, 4.0, 85)])
    names = rng.normal(size=(85, 128))
    names /= np.linalg.norm(names, axis=1, keepdims=True)
    move, others = se2(0.05, 0.0, 0.1), se2(0.05, -0.15, 0.1)
    mount = CAMERA.body_from_camera

    def views(wheel):
        for index in range(2):
            points = first.copy()
            for rows, motion in ((slice(0, 60), others), (slice(60, 85), move)):
                to_now = inverse(motion @ mount) @ mount if index else np.eye(4)
                points[rows] = transform(to_now, first[rows])
            seen = blank(wheel=wheel if index else None)
            pixels = 100.0 * points[:, :2] / points[:, 2:] + 100.0
            share(seen, FeatureSettings(), Features(pixels, names.astype(np.float32), points))
            yield seen

    for wheel, right, count in ((None, others, 60), (np.array([0.05, 0.0, 0.1]), move, 25)):
        odometry = build()
        motion = [odometry.update(seen) for seen in views(wheel)][-1]
        off = log_se3(inverse(right) @ motion.previous_from_body)
        assert motion.status is Tracking.OK and motion.details["inliers"] == count and np.abs(off).max() < 1e-6


def test_motion_out_of_the_plane_is_found_when_not_planar():
    move = exp_se3(np.array([0.1, 0.0, 0.05, 0.03, -0.05, 0.1]))
    motion = follow(build(planar=False), START, START @ move)
    error = log_se3(inverse(move) @ motion.previous_from_body)
    assert np.abs(error[:3]).max() < 0.01
    assert np.abs(error[3:]).max() < 0.002


def test_identical_views_give_the_identity():
    motion = follow(build(), START, START)
    assert motion.status is Tracking.OK
    assert np.abs(motion.previous_from_body - np.eye(4)).max() < 1e-6


def test_first_view_is_the_identity():
    motion = build().update(view(START))
    assert motion.status is Tracking.OK
    assert np.array_equal(motion.previous_from_body, np.eye(4))


def test_a_blank_view_is_lost_and_the_wheels_are_believed():
    odometry = build()
    odometry.update(view(START))
    motion = odometry.update(blank(wheel=np.array([0.2, 0.0, 0.05]), command=Twist(9.0, 9.0, 1.0)))
    assert motion.status is Tracking.LOST
    assert "wheel" in motion.reason
    assert np.allclose(motion.previous_from_body, se2(0.2, 0.0, 0.05))
    assert np.sqrt(motion.covariance[0, 0]) > 0.02


def test_without_wheels_the_command_is_believed_and_without_it_the_last_motion():
    odometry = build()
    follow(odometry, START, START @ se2(0.1, 0.0, 0.0))
    commanded = odometry.update(blank(command=Twist(0.5, 0.0, 0.4)))
    assert np.allclose(commanded.previous_from_body, se2(0.2, 0.0, 0.0))
    repeated = odometry.update(blank())
    assert np.allclose(repeated.previous_from_body, commanded.previous_from_body)
    assert repeated.covariance[0, 0] > commanded.covariance[0, 0]


def test_what_a_blank_view_guessed_wrongly_is_made_good_afterwards():
    """The wheels spun over a blank view; the next good view is matched with the last good one, so the sum is right."""
    odometry = build()
    odometry.update(view(START))
    lost = odometry.update(blank(wheel=np.array([0.5, 0.0, 0.2])))
    found = odometry.update(view(START @ se2(0.2, 0.0, 0.05), 2))
    assert found.status is not Tracking.LOST
    assert np.abs(lost.previous_from_body @ found.previous_from_body - se2(0.2, 0.0, 0.05)).max() < 0.005
    assert found.covariance[0, 0] > 0.5 * lost.covariance[0, 0]  # of this one step nobody is sure


def test_all_depth_unknown_is_lost():
    odometry = build()
    odometry.update(view(START))
    seen = view(START @ se2(0.1, 0.0, 0.0))
    motion = odometry.update(Observation(1, 0.1, CAMERA, seen.image, np.full((240, 320), np.nan, np.float32)))
    assert motion.status is Tracking.LOST
    assert motion.details["matches"] > 50
    assert motion.details["inliers"] == 0


def test_an_unrelated_view_is_not_a_confident_answer():
    odometry = build()
    odometry.update(view(START))
    motion = odometry.update(observe(CAMERA, START, paintings(seed=77)))
    assert motion.status is Tracking.LOST


def test_a_motion_known_too_badly_is_degenerate():
    motion = follow(build(max_sigma_m=1e-5), START, START @ se2(0.1, 0.0, 0.0))
    assert motion.status is Tracking.DEGENERATE
    assert "translation" in motion.reason


def test_covariance_is_symmetric_and_positive_definite():
    for settings in ({"planar": True}, {"planar": False}):
        covariance = follow(build(**settings), START, START @ se2(0.1, 0.0, 0.0)).covariance
        assert np.array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] > 0


def test_same_seed_same_numbers():
    poses = START, START @ se2(0.1, 0.0, 0.1)
    first, second = (follow(build(seed=3), *poses).previous_from_body for _ in range(2))
    assert np.array_equal(first, second)


def test_projection_on_the_floor_uses_what_the_other_axes_say():
    """If pitch and forward are measured only together (their sum, well), all of an apparent pitch is forward motion."""
    information = np.eye(6) * 1.0
    together = np.array([1.0, 0, 0, 0, 1.0, 0])
    information += 1e6 * np.outer(together, together)
    pose, covariance = on_floor(exp_se3(np.array([0.10, 0, 0, 0, 0.02, 0])), information)
    assert pose[0, 3] == pytest.approx(0.12, abs=1e-4)
    assert pose[2, 3] == 0.0
    assert np.sqrt(covariance[0, 0]) == pytest.approx(1e-3 * np.sqrt(2), rel=0.01)


@pytest.mark.parametrize("wrong", [{"hypotheses": 0}, {"gate_sigma": float("nan")}, {"refine": "icp"},
                                   {"min_inliers": -1}, {"max_sigma_m": float("inf")}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=rf"^odometry\.{next(iter(wrong))}="):
        make(Procrustes, wrong, "odometry")
