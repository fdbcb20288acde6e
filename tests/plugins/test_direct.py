"""Views laid on each other by all their pixels: right without corners, vague where nothing tells, silent elsewhere."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from painted_room import observe, paintings, see

from rhs.api.geometry import Camera, exp_se3, inverse, log_se3, se2
from rhs.api.records import FeatureSettings, Observation, Tracking
from rhs.testing.room import FURNISHED, HALL
from rhs_odometry.advanced import DirectSettings
from rhs_odometry.keyframe.config import Keyframe
from rhs_odometry.keyframe.direct import align, levels

HAND = Camera(320, 240, 290.0, 290.0, 159.5, 119.5)
HELD = se2(-0.5, 0.2, 0.3) @ exp_se3(np.array([0, 0, 1.2, 0, 0, 0]))
PAINTED, PLAIN = paintings(), np.full_like(paintings(), 128.0)
USUAL, WIDE = DirectSettings(), np.diag([0.01] * 3 + [0.04] * 3)
STEP = np.array([0.03, -0.02, 0.03, 0.03, -0.02, 0.04])


def noisy(pose, textures, room=HALL, seed=0):
    """A view with 2.5 grey levels and 0.002 1/m of noise."""
    rng = np.random.default_rng(seed)
    view = see(HAND, pose, textures, 0, room)
    grey = view.image.astype(float) + 2.5 * rng.standard_normal(view.image.shape[:2])[..., None]
    depth = 1.0 / (1.0 / view.depth + 0.002 * rng.standard_normal(view.depth.shape))
    return Observation(0, 0.0, HAND, np.clip(grey, 0, 255).astype(np.uint8), depth.astype(np.float32))


def laid(then, now, guess=None):
    a, b = (levels(view.image[..., 0], view.depth, HAND, USUAL) for view in (then, now))
    return align(a, b, HAND, np.eye(4) if guess is None else guess, WIDE, USUAL)


def off(found, move):
    """Right perturbation (6,) that is missing to the true motion of the body."""
    b = HAND.body_from_camera
    return log_se3(inverse(inverse(b) @ move @ b) @ found.then_from_now)


@pytest.mark.parametrize("size", [0.3, 2.0, 4.0])
@pytest.mark.parametrize("textures", [PAINTED, PLAIN], ids=["painted", "plain"])
def test_a_motion_is_found_from_no_guess_with_and_without_a_texture(textures, size):
    """Up to 12 degrees and 19 cm between two views; by surfaces alone, too; as far off as its covariance says."""
    move = exp_se3(size * STEP)
    found = laid(noisy(HELD, textures, FURNISHED), noisy(HELD @ move, textures, FURNISHED, 1))
    error = off(found, move)
    assert np.linalg.norm(error[:3]) < 0.006 and np.linalg.norm(error[3:]) < np.radians(0.15)
    assert error @ np.linalg.solve(found.covariance, error) < 20.0


def test_a_lone_plain_wall_holds_three_directions_and_the_others_stay_unknown():
    flat = Observation(0, 0.0, HAND, np.full((240, 320, 3), 128, np.uint8), np.full((240, 320), 1.5, np.float32))
    nearer = replace(flat, depth=flat.depth - np.float32(0.05))
    found = laid(flat, nearer)
    sigma = np.sqrt(np.diag(found.covariance))
    assert found.then_from_now[2, 3] == pytest.approx(0.05, abs=0.005)
    assert sigma[2] < 0.01 and sigma[0] > 0.05 and sigma[1] > 0.05


def test_other_light_is_no_motion():
    then = noisy(HELD, PAINTED)
    bright = np.clip(0.8 * then.image.astype(float) + 20.0, 0, 255).astype(np.uint8)
    assert np.linalg.norm(log_se3(laid(then, replace(then, image=bright)).then_from_now)[:3]) < 0.003


@pytest.mark.parametrize("gain", [0.9, 1.0, 1.1])
def test_a_picture_at_the_edge_of_a_plain_wall_tells_the_motion_whatever_the_exposure(gain):
    """It moves 14 of its 30 columns out of view; the wall must be explained by the light, not by a gain of nothing."""
    wall, rng = np.full((240, 320, 1), 110.0), np.random.default_rng(0)
    wall[20:100, 290:, 0] = np.repeat(rng.uniform(0, 255, (80, 3)), 10, axis=1)
    moved = np.concatenate([np.full((240, 14, 1), 110.0), wall[:, :-14]], axis=1)
    then, now = (Observation(0, 0.0, HAND, np.clip(grey + 2.5 * rng.standard_normal(grey.shape), 0, 255).astype(np.uint8)
                             .repeat(3, axis=2), np.full((240, 320), 1.5, np.float32)) for grey in (wall, gain * moved))
    corner = np.array([0.75, -0.3, 1.5, 1.0])
    seen = np.stack([corner, np.linalg.solve(laid(then, now).then_from_now, corner)])[:, :3]
    assert np.diff(HAND.project(seen)[:, 0])[0] == pytest.approx(14.0, abs=0.5)


@pytest.mark.parametrize("turn", [1.0, 1.8, 2.6, -1.4])
@pytest.mark.parametrize("textures", [PAINTED, PLAIN], ids=["painted", "plain"])
def test_views_of_different_places_are_not_laid_on_each_other(textures, turn):
    elsewhere = HELD @ exp_se3(np.array([0, 0, 0, 0, 0, turn]))
    assert laid(noisy(HELD, textures, FURNISHED), noisy(elsewhere, textures, FURNISHED, 1)) is None


@pytest.mark.parametrize("unknown", [np.nan, 0.0])
def test_without_depth_there_is_nothing_to_lay(unknown):
    view = noisy(HELD, PAINTED)
    assert laid(view, replace(view, depth=np.full_like(view.depth, unknown))) is None
    assert laid(replace(view, depth=np.full_like(view.depth, unknown)), view) is None


def test_a_hand_that_looks_at_a_plain_room_is_not_lost():
    """No corner anywhere, only surfaces: 12 views along 20 cm and 20 degrees."""
    context = SimpleNamespace(rng=np.random.default_rng(0), camera=HAND, features=FeatureSettings())
    odometry = Keyframe().build(context)
    poses = [HELD @ exp_se3(0.3 * k * STEP) for k in range(12)]
    for k, at in enumerate(poses):
        motion = odometry.update(replace(noisy(at, PLAIN, FURNISHED, k), index=k, stamp_s=0.1 * k))
        missing = log_se3(inverse(inverse(poses[max(k - 1, 0)]) @ at) @ motion.previous_from_body)
        assert motion.status is not Tracking.LOST and np.linalg.norm(missing[:3]) < 0.015


def test_a_picture_of_one_brightness_is_no_picture():
    """Of a dead camera: its views are lost, whatever their depth says."""
    context = SimpleNamespace(rng=np.random.default_rng(0), camera=HAND, features=FeatureSettings())
    odometry = Keyframe().build(context)
    for k in range(4):
        view = replace(noisy(HELD @ exp_se3(0.3 * k * STEP), PAINTED, FURNISHED, k), index=k, stamp_s=0.1 * k)
        motion = odometry.update(replace(view, image=np.full_like(view.image, 128)))
        assert (motion.status is Tracking.LOST) == (k > 0)


def test_a_textured_room_asks_no_pixels(monkeypatch):
    context = SimpleNamespace(rng=np.random.default_rng(0), camera=HAND, features=FeatureSettings())
    odometry = Keyframe().build(context)
    monkeypatch.setattr(odometry._direct, "lay", lambda *_: pytest.fail("asked"))
    for k in range(5):
        odometry.update(observe(HAND, HELD @ exp_se3(0.3 * k * STEP), PAINTED, k))
