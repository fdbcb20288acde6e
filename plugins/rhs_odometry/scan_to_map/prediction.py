"""Where the next scan is looked for: the wheels since the anchor, or, where they say nothing, the speed of late."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from rhs.api.records import Observation
from rhs.estimation.scans.planar_poses import between, composed

from .config import Prediction
from .wheel_bias import WheelBias

MEDIAN_OF = 7
MOVING_MPS, MOVING_RADPS = 0.3, 0.3
MOST_HUNG = 10  # readings on end
COMPARED_LEAST, COMPARED_LAST = 20, 60  # scans
MOVED_M = 0.05  # a shorter way says nothing of how wheels count it
CLEAR = 25.0  # information of a direction that the scan sees, times that of the wheels
CHI2_90 = 2.706  # nine in ten squares of a normal variable are below: one reading in ten may hang or leap unnoticed, no more
LEAST_SHARE = 0.1
UNCHANGED = 1e-8  # metres, radians: what is left of a reading that did not change


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


class WheelError:
    """How wrong the wheels of this robot are, as shares of what the settings allow: measured where the scans see along the
    way and how the robot turned, and taken to hold where they do not."""

    def __init__(self) -> None:
        self._along: deque[float] = deque(maxlen=COMPARED_LAST)  # squares of normalised errors
        self._turned: deque[float] = deque(maxlen=COMPARED_LAST)

    def compare(self, guess: Guess, pose: np.ndarray, seen: np.ndarray, way_m: float) -> None:
        """Hold the wheels' guess against where the scan was laid. seen: its information (3, 3) in its own frame, without
        blind directions; way_m: driven since the last scan."""
        if not (guess.measured and guess.fresh):
            self._along.clear()  # wheels that hang or leap were right before by luck
            self._turned.clear()
            return
        sigma = np.diag(guess.prior) ** -0.5
        strength, directions = np.linalg.eigh(seen * np.outer(sigma, sigma))
        errors = directions.T @ (between(guess.pose, pose) / sigma)
        for direction, square in zip(directions.T[strength > CLEAR], errors[strength > CLEAR] ** 2, strict=True):
            if direction[0] ** 2 > 0.5 and way_m > MOVED_M:
                self._along.append(float(square))
            elif direction[2] ** 2 > 0.5:
                self._turned.append(float(square))

    def trusted(self, prior: np.ndarray) -> np.ndarray:
        """The information (3, 3) of wheels that are as wrong as these."""
        metres, radians = _share(self._along), _share(self._turned)
        scale = np.array([metres, metres, radians])
        return prior / np.outer(scale, scale)

    def proven(self, prior: np.ndarray, least_m: float) -> np.ndarray:
        """The information (3, 3) that a scan is laid with. Of the error of metres what grows with the way is as measured,
        or somebody who walks along with the robot holds it in a bare corridor; `least_m` stays, because wheels slip; every
        scan sees the heading better than wheels that drift."""
        sigma_m = prior[0, 0] ** -0.5
        held = least_m + _share(self._along) * max(sigma_m - least_m, 0.0)
        scale = np.array([held / sigma_m, held / sigma_m, 1.0])
        return prior / np.outer(scale, scale)


def _share(squares: deque[float]) -> float:
    """1 until enough is known; never more, nor less than LEAST_SHARE."""
    if len(squares) < COMPARED_LEAST:
        return 1.0
    ordered, at = sorted(squares), 0.9 * (len(squares) - 1)  # np.quantile, which takes 0.2 ms
    low, high, past = ordered[int(at)], ordered[min(int(at) + 1, len(ordered) - 1)], at - int(at)
    nine_in_ten = high - (high - low) * (1.0 - past) if past >= 0.5 else low + (high - low) * past
    return min(max(math.sqrt(nine_in_ten / CHI2_90), LEAST_SHARE), 1.0)


class Predictor:
    """Keeps the anchor: the last scan that fitted while the wheels were fresh, and what they have said since."""

    def __init__(self, settings: Prediction) -> None:
        self._settings = settings
        self.wide = _information(settings.blind_m, settings.blind_rad)
        self.before: np.ndarray | None = None  # where the last scan was looked for
        self._anchor, self._since, self._since_s = np.zeros(3), np.zeros(3), 0.0
        self._last, self._speed = np.zeros(3), np.zeros(3)
        self._wheel: np.ndarray | None = None
        self._reading: np.ndarray | None = None  # of the wheels, before their bias was taken off
        self._bias = WheelBias()
        self._stamp_s, self._elapsed_s, self._usual_s = 0.0, 0.1, 0.0
        self._guessed = np.zeros(3)
        self._told_to_stand = False
        self._same = 0  # readings on end that did not change
        # of the last readings: neither hangs nor leaps move their median
        self._speeds: deque[np.ndarray] = deque(maxlen=MEDIAN_OF)

    def begin(self, observation: Observation) -> None:
        """The first scan."""
        self._stamp_s = observation.stamp_s

    def predict(self, last: np.ndarray, observation: Observation) -> Guess:
        """Where the scan of this observation is, after one at `last` (3,)."""
        self._clock(observation.stamp_s)
        self._last = last
        wheel = observation.wheel
        self._reading = None if wheel is None or not np.isfinite(wheel).all() else np.asarray(wheel, float)
        self._wheel = None if self._reading is None else self._bias.corrected(self._reading)
        coasting = composed(last, self._speed * self._elapsed_s)
        self.before = self._guessed
        command = observation.command
        self._told_to_stand = command is not None and command.forward_mps == command.turn_radps == 0.0
        if self._wheel is None:
            guess = Guess(coasting, self.wide, (last,), True, False)
        else:
            guess = self._by_wheels(coasting)
        self._guessed = guess.pose
        return guess

    def _by_wheels(self, coasting: np.ndarray) -> Guess:
        assert self._wheel is not None
        fresh = bool(np.abs(self._wheel).max() > UNCHANGED)
        self._same = 0 if fresh else self._same + 1
        if fresh:
            self._speeds.append(self._wheel / self._elapsed_s)
            self._speed = np.median(self._speeds, axis=0)
        self._since = composed(self._since, self._wheel)
        self._since_s += self._elapsed_s
        if not fresh:
            return self._hung(coasting)
        there = composed(self._anchor, self._since)
        if self._leapt():
            return Guess(coasting, self.wide, (there, self._last), True, False)
        return Guess(there, self._trusted(self._since), (coasting, self._last), True, True)

    def _hung(self, coasting: np.ndarray) -> Guess:
        """A reading that did not change: the robot stands, or, as nothing stands at once that was not told to, the reading
        hangs."""
        speed = self._speeds[-1] if self._speeds else np.zeros(3)
        moving = float(np.hypot(*speed[:2])) > MOVING_MPS or abs(float(speed[2])) > MOVING_RADPS
        if moving and self._same <= MOST_HUNG and not self._told_to_stand:
            return Guess(coasting, self.wide, (self._last,), False, False)
        return Guess(self._last, self._trusted(np.zeros(3)), (coasting,), True, True)

    def _leapt(self) -> bool:
        """Whether no robot can have moved as the wheels say since the anchor."""
        speed = float(np.hypot(*self._since[:2])) / self._since_s
        change = abs(speed - float(np.hypot(*self._speed[:2])))
        return change > self._settings.speed_change_mps or abs(self._since[2]) / self._since_s > self._settings.turn_radps

    def stepped(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A pose of the last scan moved on by one reading of the wheels, or the speed of late, and its prior."""
        if self._wheel is None or self._same:
            return composed(pose, self._speed * self._elapsed_s), self.wide
        return composed(pose, self._wheel), self._trusted(self._wheel)

    def learn(self, guess: Guess, pose: np.ndarray, seen: np.ndarray, good: bool) -> None:
        """Hold the last reading against where its scan was laid. seen: its information (3, 3), without blind directions."""
        if not (good and guess.measured and guess.fresh) or self._reading is None:
            self._bias.skip()
            return
        clear = np.diag(np.linalg.inv(seen + 1e-3 * np.eye(3))) * CLEAR < np.diag(guess.prior) ** -1.0
        self._bias.learn(self._reading, between(self._last, pose), (bool(clear[0]), bool(clear[2])))

    def moved_to(self, pose: np.ndarray, *, guess: Guess, good: bool) -> None:
        """The scan is at `pose`; it fits there or not. Where there are wheels the speed is theirs: where a scan is blind
        along a corridor, one that came from scans alone would run away."""
        if good and self._wheel is None:
            speed = between(self._last, pose) / self._elapsed_s
            self._speed = speed * min(1.0, self._settings.speed_change_mps / max(float(np.hypot(*speed[:2])), 1e-9))
        if good and guess.fresh:
            self.anchor_at(pose)

    def anchor_at(self, pose: np.ndarray) -> None:
        """Count the wheels from here."""
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
