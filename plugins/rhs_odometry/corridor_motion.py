"""Where the corridor filter's expectation of the next pose comes from: the command, the wheels, or inertia alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .corridor_state import BASE, SCALE, SPEED, TURN, BodyMotion
from .track_frames import TrackFrame


@dataclass(frozen=True)
class MotionNoise:
    """How wrong the expectation may be, per step; one standard deviation each."""

    forward: float = 0.03  # share of the distance
    forward_floor_m: float = 0.002  # and never less than this
    left_m: float = 0.002
    turn: float = 0.06  # share of the turn
    turn_floor_rad: float = 0.005
    speed_walk_mps: float = 0.08  # change of speed per step, without input only
    turn_walk_radps: float = 0.16  # change of turn rate per step, without input only

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
