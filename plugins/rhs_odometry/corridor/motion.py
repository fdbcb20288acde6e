"""Where the corridor filter's expectation of the next pose comes from: the command, the wheels, or inertia alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..tracks.track_frames import TrackFrame, common
from .state import BASE, SCALE, SPEED, TURN, BodyMotion

SPIN_VIEWS, SPIN_RAD, SPIN_M_PER_RAD = 4, 0.2, 0.3  # a turn on the spot: so much in so many views, moved less than this
LEAST_POINTS = 8  # fewer followed points say nothing about how the picture moves
STILL_PX = 0.4  # a picture that moves less than this stands still


@dataclass(frozen=True)
class MotionNoise:
    """How wrong the expectation may be, per step; one standard deviation each."""

    forward: float = 0.03
    """share of the distance"""
    forward_floor_m: float = 0.002
    """and never less than this"""
    left_m: float = 0.002
    """and never less than this"""
    turn: float = 0.06
    """share of the turn"""
    turn_floor_rad: float = 0.005
    """share of the turn"""
    speed_walk_mps: float = 0.08
    """change of speed per step, without input only"""
    turn_walk_radps: float = 0.16
    """change of turn rate per step, without input only"""

    def covariance(self, forward_m: float, turn_rad: float) -> np.ndarray:
        """(3, 3) of forward, left, turn."""
        along = self.forward * abs(forward_m) + self.forward_floor_m
        return np.diag([along, self.left_m, self.turn * abs(turn_rad) + self.turn_floor_rad]) ** 2


class Told:
    """The motion command, or the wheel travel, times an unknown constant scale; where nobody said anything, standing
    still with the uncertainty of a normal step."""

    def __init__(self, noise: MotionNoise, *, wheels: bool) -> None:
        self._noise, self._wheels = noise, wheels

    def expect(self, frame: TrackFrame, base: np.ndarray, seconds: float) -> BodyMotion:
        forward, left, turn = frame.wheel if self._wheels else (frame.command[0], 0.0, frame.command[1])
        if not np.isfinite([forward, left, turn]).all():
            return BodyMotion(np.zeros(3), np.zeros((3, BASE)), np.diag([0.2, 0.02, 0.1]) ** 2, np.zeros(BASE))
        by_base = np.zeros((3, BASE))
        by_base[0, SCALE] = forward
        mean = np.array([base[SCALE] * forward, left, turn])
        return BodyMotion(mean, by_base, self._noise.covariance(forward, turn), np.zeros(BASE))


class Inertia:
    """Constant speed and turn rate (thesis eq. 4.5 on the floor), both random walks."""

    def __init__(self, noise: MotionNoise) -> None:
        self._noise = noise

    def expect(self, frame: TrackFrame, base: np.ndarray, seconds: float) -> BodyMotion:
        by_base = np.zeros((3, BASE))
        by_base[0, SPEED] = by_base[2, TURN] = seconds
        mean = np.array([base[SPEED] * seconds, 0.0, base[TURN] * seconds])
        walk = np.zeros(BASE)
        walk[SPEED], walk[TURN] = self._noise.speed_walk_mps**2, self._noise.turn_walk_radps**2
        return BodyMotion(mean, by_base, self._noise.covariance(0.0, 0.0), walk)


class SpinWatch:
    """Notices that the camera, without command or wheels, has turned on the spot and now goes on.

    A turn on the spot teaches that the speed is zero, and nothing followed in it has a depth; what is seen afterwards fits a
    slow camera among near things as well as the true one. So when the picture moves again without turning, the speed is
    as unknown as it was at the start."""

    def __init__(self, focal_px: float) -> None:
        self._focal, self._spun = focal_px, False
        self._before: TrackFrame | None = None

    def goes_on(self, clones: np.ndarray, frame: TrackFrame) -> bool:
        """True once, at the first view after a turn on the spot that moves without turning. clones (N, 5) before it."""
        before, self._before = self._before, frame
        recent = clones[-SPIN_VIEWS - 1 :, :3]
        turned = np.abs(np.diff(np.unwrap(recent[:, 2]))).sum()
        moved = np.hypot(*np.diff(recent[:, :2], axis=0).T).sum()
        if len(recent) > SPIN_VIEWS and turned > SPIN_RAD and moved < SPIN_M_PER_RAD * turned:
            self._spun = True
        if not self._spun or before is None:
            return False
        a, b = common(before, frame)
        if len(a) < LEAST_POINTS:
            return False
        flow = b - a
        calm = abs(np.median(flow[:, 0])) < 0.3 * SPIN_RAD / SPIN_VIEWS * self._focal
        if not calm or np.median(np.hypot(*flow.T)) < STILL_PX:
            return False
        self._spun = False
        return True
