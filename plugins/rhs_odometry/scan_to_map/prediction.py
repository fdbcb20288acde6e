"""Where the next scan is looked for: the wheels since the anchor, or, where they say nothing, the speed of late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.records import Observation
from rhs.estimation.scans.planar_poses import between, composed

from .config import Prediction


@dataclass(frozen=True, eq=False)
class Guess:
    """pose (3,) and prior (3, 3) information about it; others: poses that are as likely if it is wrong. fresh: the wheels
    have moved since the last scan; measured: the guess is theirs."""

    pose: np.ndarray
    prior: np.ndarray
    others: tuple[np.ndarray, ...]
    fresh: bool
    measured: bool

    def expects(self, pose: np.ndarray, within_m: float, within_rad: float) -> bool:
        """Whether a pose is near one of the guesses."""
        return any(np.hypot(*(gap := between(one, pose))[:2]) < within_m and abs(gap[2]) < within_rad
                   for one in (self.pose, *self.others))

    def centres(self, apart_m: float) -> list[np.ndarray]:
        """The guesses that are worth a search of their own."""
        out = [self.pose]
        for other in self.others:
            if all(np.hypot(*(gap := between(one, other))[:2]) > 0.5 * apart_m or abs(gap[2]) > 0.5 for one in out):
                out.append(other)
        return out


class Predictor:
    """Keeps the anchor: the last scan that fitted while the wheels were fresh, and what they have said since."""

    def __init__(self, settings: Prediction) -> None:
        self._settings = settings
        self.wide = _information(settings.blind_m, settings.blind_rad)
        self.before: np.ndarray | None = None  # where the last scan was looked for
        self._anchor, self._since, self._since_s = np.zeros(3), np.zeros(3), 0.0
        self._last, self._speed = np.zeros(3), np.zeros(3)
        self._wheel: np.ndarray | None = None
        self._stamp_s, self._elapsed_s, self._usual_s = 0.0, 0.1, 0.0
        self._guessed = np.zeros(3)

    def begin(self, observation: Observation) -> None:
        """The first scan."""
        self._stamp_s = observation.stamp_s

    def predict(self, last: np.ndarray, observation: Observation) -> Guess:
        """Where the scan of this observation is, after one at `last` (3,)."""
        self._clock(observation.stamp_s)
        self._last = last
        wheel = observation.wheel
        self._wheel = None if wheel is None or not np.isfinite(wheel).all() else np.asarray(wheel, float)
        coasting = composed(last, self._speed * self._elapsed_s)
        self.before = self._guessed
        if self._wheel is None:
            guess = Guess(coasting, self.wide, (last,), True, False)
        else:
            guess = self._by_wheels(coasting)
        self._guessed = guess.pose
        return guess

    def _by_wheels(self, coasting: np.ndarray) -> Guess:
        assert self._wheel is not None
        fresh = bool(self._wheel.any())
        self._since = composed(self._since, self._wheel)
        self._since_s += self._elapsed_s
        if not fresh:
            return Guess(self._last, self.wide, (coasting,), False, False)
        there = composed(self._anchor, self._since)
        if self._leapt():
            return Guess(coasting, self.wide, (there, self._last), True, False)
        return Guess(there, self._trusted(self._since), (coasting, self._last), True, True)

    def _leapt(self) -> bool:
        """Whether no robot can have moved as the wheels say since the anchor."""
        speed = float(np.hypot(*self._since[:2])) / self._since_s
        change = abs(speed - float(np.hypot(*self._speed[:2])))
        return change > self._settings.speed_change_mps or abs(self._since[2]) / self._since_s > self._settings.turn_radps

    def stepped(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A pose of the last scan moved on by one reading of the wheels, or the speed of late, and its prior."""
        if self._wheel is None or not self._wheel.any():
            return composed(pose, self._speed * self._elapsed_s), self.wide
        return composed(pose, self._wheel), self._trusted(self._wheel)

    def moved_to(self, pose: np.ndarray, *, fresh: bool, good: bool) -> None:
        """The scan is at `pose`; it fits there or not."""
        if good:
            self._speed = between(self._last, pose) / self._elapsed_s
        if good and fresh:
            self._anchor, self._since, self._since_s = pose.copy(), np.zeros(3), 0.0

    def _clock(self, stamp_s: float) -> None:
        """Stamps may be poor: no interval is taken to be much shorter than usual."""
        gap_s = stamp_s - self._stamp_s
        self._stamp_s = stamp_s
        self._usual_s = gap_s if self._usual_s == 0.0 else 0.95 * self._usual_s + 0.05 * min(gap_s, 2.0 * self._usual_s)
        self._elapsed_s = max(gap_s, 0.5 * self._usual_s, 1e-3)

    def _trusted(self, moved: np.ndarray) -> np.ndarray:
        """(3, 3) information of what the wheels say of a motion (3,)."""
        s, way_m = self._settings, float(np.hypot(*moved[:2]))
        return _information(s.least_m + s.share * way_m, s.least_rad + s.share * abs(float(moved[2])) + s.rad_per_m * way_m)


def _information(sigma_m: float, sigma_rad: float) -> np.ndarray:
    return np.diag([sigma_m**-2, sigma_m**-2, sigma_rad**-2])
