"""Where the corridor filter's expectation of the next pose comes from: the command, the wheels, or inertia alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera
from rhs.estimation.views.settings import scaled_px

from ..tracks.track_frames import TrackFrame, common
from .config import MotionRules
from .state import BASE, SCALE, SPEED, TURN, BodyMotion

USUAL = MotionRules()


@dataclass(frozen=True)
class MotionNoise:
    """How wrong the expectation may be, per step; one standard deviation each."""

    forward: float = 0.03
    """share of the distance"""
    turn: float = 0.06
    """share of the turn"""
    rules: MotionRules = MotionRules()
    """what it is at least, and how it walks without input"""

    def covariance(self, forward_m: float, turn_rad: float) -> np.ndarray:
        """(3, 3) of forward, left, turn."""
        along = self.forward * abs(forward_m) + self.rules.forward_floor_m
        return np.diag([along, self.rules.left_m, self.turn * abs(turn_rad) + self.rules.turn_floor_rad]) ** 2


class GivenMotion:
    """The motion command, or the wheel travel, times an unknown constant scale; where nobody said anything, standing
    still with the uncertainty of a normal step; where something was in the way, any share of what was said."""

    def __init__(self, noise: MotionNoise, *, wheels: bool) -> None:
        self._noise, self._wheels = noise, wheels

    def expect(self, frame: TrackFrame, base: np.ndarray, seconds: float) -> BodyMotion:
        forward, left, turn = frame.wheel if self._wheels else (frame.command[0], 0.0, frame.command[1])
        if not np.isfinite([forward, left, turn]).all():
            return BodyMotion(np.zeros(3), np.zeros((3, BASE)), np.diag([0.2, 0.02, 0.1]) ** 2, np.zeros(BASE))
        done, spread = (0.5, np.diag([forward, left, turn]) ** 2 / 12.0) if frame.stopped else (1.0, 0.0)  # evenly 0 to 1
        by_base = np.zeros((3, BASE))
        by_base[0, SCALE] = done * forward
        mean = done * np.array([base[SCALE] * forward, left, turn])
        return BodyMotion(mean, by_base, self._noise.covariance(forward, turn) + spread, np.zeros(BASE))


class ConstantVelocity:
    """Constant speed and turn rate (thesis eq. 4.5 on the floor), both random walks."""

    def __init__(self, noise: MotionNoise) -> None:
        self._noise = noise

    def expect(self, frame: TrackFrame, base: np.ndarray, seconds: float) -> BodyMotion:
        by_base = np.zeros((3, BASE))
        by_base[0, SPEED] = by_base[2, TURN] = seconds
        mean = np.array([base[SPEED] * seconds, 0.0, base[TURN] * seconds])
        walk = np.zeros(BASE)
        rules = self._noise.rules
        walk[SPEED], walk[TURN] = rules.speed_walk_mps**2, rules.turn_walk_radps**2
        return BodyMotion(mean, by_base, self._noise.covariance(0.0, 0.0), walk)


class SpinWatch:
    """Notices that the camera, without command or wheels, has turned on the spot and now goes on.

    A turn on the spot teaches that the speed is zero, and nothing followed in it has a depth; what is seen afterwards fits a
    slow camera among near things as well as the true one. So when the picture moves again without turning, the speed is
    as unknown as it was at the start."""

    def __init__(self, camera: Camera, rules: MotionRules = USUAL) -> None:
        self._focal, self._still_px = camera.fx, scaled_px(rules.still_px, camera.width)
        self._rules, self._spun = rules, False
        self._before: TrackFrame | None = None

    def goes_on(self, clones: np.ndarray, frame: TrackFrame) -> bool:
        """True once, at the first view after a turn on the spot that moves without turning. clones (N, 5) before it."""
        r, before, self._before = self._rules, self._before, frame
        recent = clones[-r.spin_views - 1 :, :3]
        turned = np.abs(np.diff(np.unwrap(recent[:, 2]))).sum()
        moved = np.hypot(*np.diff(recent[:, :2], axis=0).T).sum()
        if len(recent) > r.spin_views and turned > r.spin_rad and moved < r.spin_m_per_rad * turned:
            self._spun = True
        if not self._spun or before is None:
            return False
        a, b = common(before, frame)
        if len(a) < r.least_points:
            return False
        flow = b - a
        calm = abs(np.median(flow[:, 0])) < 0.3 * r.spin_rad / r.spin_views * self._focal
        if not calm or np.median(np.hypot(*flow.T)) < self._still_px:
            return False
        self._spun = False
        return True
