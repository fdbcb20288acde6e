"""What going on as before is worth: learnt from motions, growing as a speed that errs makes places err."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import Camera, exp_se3, inverse, log_se3
from rhs_odometry.advanced import GuessNoise
from rhs_odometry.keyframe.going_on import GoingOn

HAND, SURE = Camera(320, 240, 290.0, 290.0, 159.5, 119.5), 1e-8 * np.eye(6)
TOLD = np.diag([0.1**2] * 3 + [0.2**2] * 3)


def motions(count, seed=0, change=(0.002, 0.004)):
    """Of a hand whose speed changes by so much (metres, radians per axis) from view to view."""
    rng = np.random.default_rng(seed)
    speed = np.array([0.01, 0.0, 0.0, 0.0, 0.02, 0.0])
    return [exp_se3(speed := speed + np.repeat(change, 3) * rng.standard_normal(6)) for _ in range(count)]


def moved(count, seed=0, change=(0.002, 0.004), camera=HAND):
    """A camera that was measured all that way, and the motions."""
    again, way = GoingOn(GuessNoise(), camera), motions(count, seed, change)
    for motion in way:
        again.measured(inverse(camera.body_from_camera) @ motion @ camera.body_from_camera, SURE)
    return again, way


def test_while_little_has_been_seen_what_is_told_stands():
    again, way = moved(8)
    np.testing.assert_allclose(np.linalg.eigvalsh(again.since(TOLD)), np.linalg.eigvalsh(TOLD))
    np.testing.assert_allclose(again.motion, way[-1], atol=1e-9)


@pytest.mark.parametrize("gap", [1, 2, 3, 4, 5])
def test_the_spread_over_a_gap_is_that_of_what_hands_do_in_it(gap):
    """In twenty drives places are off by what is said, no more and not much less."""
    b, squares = HAND.body_from_camera, []
    for seed in range(20):
        again, _ = moved(40, seed)
        again.views, guess, true = gap - 1, np.eye(4), np.eye(4)
        for motion in motions(40 + gap, seed)[40:]:
            guess, true = guess @ again.motion, true @ motion
        off = log_se3(inverse(b) @ inverse(guess) @ true @ b)
        squares.append(off @ np.linalg.solve(again.since(TOLD), off) / 6.0)
    assert 0.15 < np.mean(squares) < 1.2


def test_never_more_than_told():
    wild, _ = moved(40, change=(1.0, 1.0))
    np.testing.assert_allclose(np.trace(wild.since(TOLD)), np.trace(TOLD), rtol=1e-3)


def test_a_motion_that_was_hardly_measured_is_not_taken_again_until_the_old_one_is_stale():
    again, way = moved(40)
    vague = inverse(HAND.body_from_camera) @ exp_se3(np.full(6, 0.05)) @ HAND.body_from_camera
    spread = 0.02**2 * np.eye(6)
    again.measured(vague, spread)
    np.testing.assert_allclose(again.motion, way[-1], atol=1e-9)
    before = np.trace(again.since(TOLD))
    for _ in range(60):
        again.felt()
    assert np.trace(again.since(TOLD)) > 10.0 * before
    again.measured(vague, spread)
    np.testing.assert_allclose(again.motion, exp_se3(np.full(6, 0.05)), atol=1e-9)


def test_a_jump_forgets_what_motions_were_worth():
    again, _ = moved(40)
    again.forget()
    np.testing.assert_allclose(np.trace(again.since(TOLD)), np.trace(TOLD))
