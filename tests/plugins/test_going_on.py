"""What going on as before is worth: learnt from motions, growing as a speed that errs makes places err."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import exp_se3, inverse, log_se3
from rhs_odometry.advanced import GuessNoise
from rhs_odometry.keyframe.going_on import GoingOn

TOLD = np.diag([0.1**2] * 3 + [0.2**2] * 3)


def motions(count, seed=0, change=(0.002, 0.004)):
    """Of a hand whose speed changes by so much (metres, radians per axis) from view to view."""
    rng = np.random.default_rng(seed)
    speed = np.array([0.01, 0.0, 0.0, 0.0, 0.02, 0.0])
    return [exp_se3(speed := speed + np.repeat(change, 3) * rng.standard_normal(6)) for _ in range(count)]


def test_while_little_has_been_seen_what_is_told_stands():
    again = GoingOn(GuessNoise())
    for motion in motions(8):
        again.measured(motion)
    np.testing.assert_array_equal(again.since(TOLD), TOLD)


def test_the_spread_over_a_gap_is_that_of_what_hands_do_in_it():
    """Gaps of one to five views in twenty drives: places are off by what is said, no more and not much less."""
    for gap in range(1, 6):
        squares = []
        for seed in range(20):
            again, way = GoingOn(GuessNoise()), motions(40 + gap, seed)
            for motion in way[:40]:
                again.measured(motion)
            again.views = gap - 1
            guess, true = np.eye(4), np.eye(4)
            for motion in way[40:]:
                guess, true = guess @ way[39], true @ motion
            off = log_se3(inverse(guess) @ true)
            squares.append(off**2 / np.diag(again.since(TOLD)))
        assert 0.15 < np.mean(squares) < 1.2


def test_never_more_than_told_and_after_a_gap_no_change_is_learnt():
    again = GoingOn(GuessNoise())
    for motion in motions(40, change=(1.0, 1.0)):
        again.measured(motion)
    np.testing.assert_allclose(again.since(TOLD), TOLD)
    calm = GoingOn(GuessNoise())
    for motion in motions(40):
        calm.measured(motion)
    before = calm.since(TOLD)
    calm.views = 3
    calm.measured(exp_se3(np.full(6, 0.5)))
    np.testing.assert_array_equal(calm.since(TOLD), before)
