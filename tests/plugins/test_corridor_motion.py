"""Without command or wheels: going on after a turn on the spot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.geometry import Camera
from rhs_odometry.corridor.motion import GivenMotion, MotionNoise, SpinWatch
from rhs_odometry.corridor.state import SPEED, CorridorState
from rhs_odometry.tracks.track_frames import TrackFrame

FOCAL_PX = 300.0
CAMERA = Camera(320, 240, FOCAL_PX, FOCAL_PX, 159.5, 119.5)
PIXELS = np.stack(np.meshgrid(np.linspace(20, 300, 6), np.linspace(20, 220, 5)), axis=-1).reshape(-1, 2)


def frames(steps: list[np.ndarray]) -> list[TrackFrame]:
    """The same points, moved by each step (px) from view to view."""
    at = np.cumsum([np.zeros((len(PIXELS), 2)), *steps], axis=0)
    return [TrackFrame(0.25 * k, np.arange(len(PIXELS)), PIXELS + move) for k, move in enumerate(at)]


def test_of_a_command_that_something_stopped_any_share_may_have_been_done():
    """0.12 m forward, evenly from 0 to 0.12: 0.06 m in the mean, 0.12 / sqrt(12) off; nothing was turned, so nothing was."""
    given = GivenMotion(MotionNoise(), wheels=False)
    frame = TrackFrame(0.0, np.arange(1), np.zeros((1, 2)), command=np.array([0.12, 0.0, 0.4]))
    done, stopped = (given.expect(one, np.array([0.0, 0.0, 1.0, 1.0]), 0.4) for one in (frame, replace(frame, stopped=True)))
    assert done.mean.tolist() == [0.12, 0.0, 0.0] and stopped.mean.tolist() == [0.06, 0.0, 0.0]
    np.testing.assert_allclose(stopped.noise - done.noise, np.diag([0.12**2 / 12.0, 0.0, 0.0]), atol=1e-15)


SPIN = np.tile([0.1 * FOCAL_PX, 0.0], (len(PIXELS), 1))  # a view of a turn by 0.1 rad
STAND = np.zeros((len(PIXELS), 2))
ON = 0.02 * (PIXELS - [160.0, 120.0])  # the picture grows: straight on
SPINNING = np.column_stack([np.zeros((6, 2)), 0.1 * np.arange(6), np.zeros((6, 2))])
DRIVING = np.column_stack([0.125 * np.arange(6), np.zeros((6, 4))])


def test_going_on_is_noticed_once_and_not_while_it_turns_or_stands():
    watch, seen = SpinWatch(CAMERA), frames([SPIN, SPIN, STAND, ON, ON])
    assert [watch.goes_on(SPINNING, frame) for frame in seen] == [False, False, False, False, True, True]
    watch = SpinWatch(CAMERA)
    told = [watch.goes_on(SPINNING if k < 4 else DRIVING, frame) for k, frame in enumerate(seen)]
    assert told == [False, False, False, False, True, False]


def test_an_arc_is_no_turn_on_the_spot():
    arc = SPINNING.copy()
    arc[:, 0] = 0.07 * np.arange(6)  # 0.7 m round
    watch = SpinWatch(CAMERA)
    assert not any(watch.goes_on(arc, frame) for frame in frames([SPIN, SPIN, ON, ON]))


def test_what_is_forgotten_is_as_unknown_as_at_the_start():
    state = CorridorState(np.array([0.0, 0.0, 1.0, 2.0]), np.full(4, 0.1), np.zeros(5), np.full(5, 0.01))
    state.covariance[SPEED, 5] = state.covariance[5, SPEED] = 5e-4
    before = state.covariance.copy()
    state.forget(SPEED, 0.5, 0.12)
    assert state.base[SPEED] == 0.5 and state.covariance[SPEED, SPEED] == pytest.approx(0.12**2)
    assert state.covariance[SPEED, 5] == state.covariance[5, SPEED] == 0.0
    rest = np.delete(np.delete(state.covariance, SPEED, 0), SPEED, 1)
    np.testing.assert_array_equal(rest, np.delete(np.delete(before, SPEED, 0), SPEED, 1))
