"""The gate between an odometry that sees and the wheels: a confident wrong motion is replaced, and the table says so.

A picture can lie with many witnesses: a wrong match, people who walk by, a cloud that slides along a flat wall. Wheels lie
otherwise: they spin, and then count too much, never too little. So a motion that is further from every share of the wheel
travel that spinning allows than both covariances explain (chi-square test of the difference, Bar-Shalom, Li and
Kirubarajan 2001, section 5.4) is replaced by the wheel travel, status `lost`. A `degenerate` motion that agrees is joined
with the wheels by their information, so that each direction comes from whoever knows it. Without wheels only a leap is
refused: a speed that differs from what was believed last and from what vision itself said last, where somebody says when
the views were taken.
Where wheels contradict for many views on end they are the ones in doubt (a bag with another frame), and vision is kept.
Somebody who walks by close to the camera has most of the picture, not all of the scan: where the view before, moved as the
wheels say, is seen again and moved as vision says is not, the wheels are not only taken but known to be right. The scan is
asked of smaller differences too, and whether wheels spun: vision stands still before somebody who follows the robot.
"""

from __future__ import annotations

from array import array
from collections import deque
from dataclasses import replace

import numpy as np

from rhs.api.contracts import Odometry
from rhs.api.geometry import exp_se3, inverse, log_se3, planar, se2
from rhs.api.records import Motion, Observation, Revision, Scan, Tracking
from rhs.api.validate import check_motion
from rhs.api.validate_fields import MOST_REASON
from rhs.estimation.filters.kalman import gate as chi_square
from rhs.estimation.filters.time_offset import time_offset_s
from rhs.estimation.views.motion_consistency import ends_again

from .tasks import Gate

FREE = [0, 1, 5]  # what wheels measure: x, y, yaw
# Scans decide between the two: the least share of the last one's beams seen again, and of those not seen as vision says
LEAST_SHARE, MORE_SHARE = 0.4, 0.2
DOUBTED = 0.99  # of good motions pass unasked; of the others, up to the settings' probability, the scan is asked
USUAL_VIEWS = 10  # stamps of arrival come in clumps: no speed is judged over less than the mean interval of so many views
COMPARED_M, COMPARED_RAD = 0.03, 0.03  # from view to view: what is less is mostly noise
COMPARED_LEAST = 20  # views
FLOOR_SIGMA = 0.05  # of z, roll and pitch as wheels have it, from view to view: metres, radians


class GatedOdometry:
    """An odometry whose motions pass the gate; all else is the odometry's own."""

    def __init__(self, odometry: Odometry, settings: Gate, who: str = "", *, timed: bool = True) -> None:
        self._odometry, self._settings, self._timed = odometry, settings, timed
        self._who = who or f"odometry {type(odometry).__name__}"
        self.keeps_moving, self.short_steps = odometry.keeps_moving, odometry.short_steps
        self.scale_from = odometry.scale_from
        self._limit, self._doubted = chi_square(3, settings.probability), chi_square(3, min(DOUBTED, settings.probability))
        self._stamp_s = float("nan")
        self._intervals_s: deque[float] = deque(maxlen=USUAL_VIEWS)
        self._moved: list[tuple[np.ndarray, float]] = []  # twists (6,), believed last and said last by vision, in seconds
        self._lost = 0  # views since vision last knew: what it says next may put right its own guesses over all of them
        self._contradicted = 0
        self._replaced = 0
        self._ratios = {"wheel_way_ratio": array("d"), "wheel_turn_ratio": array("d")}  # of wheels over vision, by view
        self._turns = array("d")  # of each view: stamp, turn as vision was sure of it, turn of the wheels; NaN: unknown
        self._scan: Scan | None = None  # of the view before
        self._now: Scan | None = None

    def update(self, observation: Observation) -> Motion:
        """The odometry's motion, or what the wheels say where it contradicts them."""
        said = check_motion(self._odometry.update(observation), who=self._who)
        elapsed_s = observation.stamp_s - self._stamp_s
        self._stamp_s = observation.stamp_s
        self._intervals_s.append(elapsed_s)
        self._scan, self._now = self._now, observation.scan
        seen = planar(said.previous_from_body)[2] if said.status is Tracking.OK else np.nan
        self._turns.extend((observation.stamp_s, seen, np.nan if observation.wheel is None else observation.wheel[2]))
        if not np.isfinite(elapsed_s):  # the first view: nothing moved
            self._intervals_s.clear()
            return said
        if said.status is Tracking.LOST:
            self._lost, self._moved = self._lost + 1, []
            return said
        wheel = observation.wheel
        if wheel is not None and np.isfinite(wheel).all():
            motion = self._beside_wheels(said, wheel)
        else:
            motion = self._without_wheels(said, elapsed_s)
        self._lost = 0
        self._replaced += motion.replaced
        return motion

    def revise(self) -> Revision | None:
        """The odometry's last word; none where motions were replaced, which it does not know of."""
        revision = self._odometry.revise()
        return None if self._replaced else revision

    def wheel_figures(self) -> dict[str, float]:
        """Way and turn that wheels told of over what vision saw where it was sure, medians; nothing of too few views."""
        return {name: float(np.median(each)) for name, each in self._ratios.items() if len(each) >= COMPARED_LEAST}

    def views_late_s(self) -> float:
        """How much later the views are stamped than the wheels' readings, seconds; NaN where too little was turned."""
        return time_offset_s(*np.asarray(self._turns).reshape(-1, 3).T) if self._timed else float("nan")

    def _compare(self, seen: np.ndarray, told: np.ndarray) -> None:
        """Note how much further wheels went, or turned, than vision, where that is more than noise: (3,) dx, dy, dyaw."""
        if abs(seen[2]) > COMPARED_RAD:
            self._ratios["wheel_turn_ratio"].append(told[2] / seen[2])
        elif (squared := float(seen[:2] @ seen[:2])) > COMPARED_M**2:
            self._ratios["wheel_way_ratio"].append(seen[:2] @ told[:2] / squared)

    def _beside_wheels(self, said: Motion, wheel: np.ndarray) -> Motion:
        if said.status is Tracking.OK:
            self._compare(planar(said.previous_from_body), wheel)
        s = self._settings
        metres = s.wheel_least_m + s.wheel_share * float(np.hypot(wheel[0], wheel[1]))
        spread = np.diag([metres**2, metres**2, (s.wheel_least_rad + s.wheel_share * abs(float(wheel[2]))) ** 2])
        apart = contradiction(said, wheel, spread * (1 + self._lost) ** 2, slip_share=s.slip_share)
        doubted = contradiction(said, wheel, spread, slip_share=0.0) > self._doubted
        known = doubted and self._borne_out(se2(*wheel), said.previous_from_body)
        if apart <= self._limit and not known:
            self._contradicted = 0
            return joined(said, wheel, spread) if said.status is Tracking.DEGENERATE else said
        self._contradicted += not known
        both = f"vision {_words(said.previous_from_body)} and wheels {_words(se2(*wheel))}"
        what = f"{both} are {np.sqrt(apart):.1f} sigmas apart"
        if self._contradicted > s.patience:
            return replace(said, reason=_with(said.reason, f"{what}: wheels doubted"))
        why = f"{what}; {'the scan agrees with' if known else 'took'} wheel"
        wheels = _instead(said, se2(*wheel), on_floor(spread), why)
        return replace(wheels, status=Tracking.DEGENERATE) if known else wheels

    def _borne_out(self, wheels: np.ndarray, vision: np.ndarray) -> bool:
        """Whether the wheels' motion (4x4) is seen in the scan, and some of it by theirs alone: what stands still, beside
        somebody who moves along. Where wheels spin the scan shows nothing that vision does not."""
        again, else_ = (ends_again(self._scan, self._now, moved, fine=True) for moved in (wheels, vision))
        told = np.isfinite(again)
        both = told & np.isfinite(else_)
        if not both.any() or again[told].mean() < LEAST_SHARE:
            return False
        return bool((again[both] > else_[both]).mean() > MORE_SHARE)

    def _without_wheels(self, said: Motion, elapsed_s: float) -> Motion:
        """Refuse a leap: no body changes its speed so much between two views."""
        s, usual_s = self._settings, float(np.mean(self._intervals_s))
        if not self._timed or elapsed_s <= 0.0:
            return said
        now = (log_se3(said.previous_from_body), elapsed_s)
        speed, *speeds = (twist / max(seconds, usual_s) for twist, seconds in (now, *self._moved))
        changes = [speed - before for before in speeds]
        leaps = [np.linalg.norm(c[:3]) > s.leap_mps or np.linalg.norm(c[3:]) > s.leap_radps for c in changes]
        if not leaps or not all(leaps):
            self._moved = [now, now]
            return said
        self._moved = [self._moved[0], now]
        guess = exp_se3(speeds[0] * elapsed_s)
        sigmas = np.repeat([0.05 + s.leap_mps * elapsed_s / 3.0, 0.05 + s.leap_radps * elapsed_s / 3.0], 3)
        what = f"vision {_words(said.previous_from_body)} in {elapsed_s:.3f} s leaps from {_words(guess)}"
        return _instead(said, guess, np.diag(sigmas**2), f"{what}; took same again")


def contradiction(said: Motion, wheel: np.ndarray, spread: np.ndarray, *, slip_share: float) -> float:
    """Squared Mahalanobis distance (3 degrees of freedom) of a motion from the nearest wheel travel s * wheel with
    1 - slip_share <= s <= 1. wheel: (3,) dx, dy, dyaw; spread: (3, 3) its covariance."""
    vision, counted = log_se3(said.previous_from_body)[FREE], log_se3(se2(*wheel))[FREE]
    weight = np.linalg.inv(said.covariance[np.ix_(FREE, FREE)] + spread)
    length = float(counted @ weight @ counted)
    share = float(counted @ weight @ vision) / length if length > 0.0 else 1.0
    off = vision - np.clip(share, 1.0 - slip_share, 1.0) * counted
    return float(off @ weight @ off)


def on_floor(spread: np.ndarray) -> np.ndarray:
    """(6, 6) covariance of wheel travel whose x, y and yaw have the covariance `spread` (3, 3): wheels stay on the floor."""
    covariance = np.diag([0.0, 0.0, FLOOR_SIGMA**2, FLOOR_SIGMA**2, FLOOR_SIGMA**2, 0.0])
    covariance[np.ix_(FREE, FREE)] = spread
    return covariance


def joined(said: Motion, wheel: np.ndarray, spread: np.ndarray) -> Motion:
    """The motion corrected by the wheel travel (Kalman update); status and reason stay. What vision hardly knows of height,
    roll and pitch is the floor's too: else the belief of a robot before somebody's coat tilts, and its metres with it."""
    off = log_se3(inverse(said.previous_from_body) @ se2(*wheel))
    noise = on_floor(spread)
    gain = said.covariance @ np.linalg.inv(said.covariance + noise)
    rest = np.eye(6) - gain
    covariance = rest @ said.covariance @ rest.T + gain @ noise @ gain.T  # Joseph's form stays positive definite
    pose = said.previous_from_body @ exp_se3(gain @ off)
    return replace(said, previous_from_body=pose, covariance=0.5 * (covariance + covariance.T),
                   reason=_with(said.reason, "joined with wheel"))


def _instead(said: Motion, pose: np.ndarray, covariance: np.ndarray, why: str) -> Motion:
    return replace(said, previous_from_body=pose, covariance=covariance, status=Tracking.LOST, reason=f"gated: {why}",
                   observability=None, replaced=True)


def _with(reason: str, more: str) -> str:
    """What the odometry said and what the gate adds, no longer than a reason may be."""
    return "; ".join(filter(None, [reason[:MOST_REASON - len(more) - 2], more]))


def _words(pose: np.ndarray) -> str:
    twist = log_se3(pose)
    return f"{np.linalg.norm(pose[:3, 3]):.2f} m {np.degrees(np.linalg.norm(twist[3:])):.1f} deg"


def gated(odometry: Odometry, needs: frozenset[str], settings: Gate, who: str = "", *, timed: bool = True) -> Odometry:
    """The odometry behind the gate, if it is one that the gate is for. who: what to call it in errors. timed: of
    the source."""
    return GatedOdometry(odometry, settings, who, timed=timed) if settings.act != "off" and "depth" in needs else odometry
