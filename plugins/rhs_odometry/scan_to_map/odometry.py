"""Scan to map: each scan is laid onto the points of the last key scans, from where the wheels say it is.

Source: scan to submap matching as in Cartographer (Hess, Kohler, Rapp, Andor, ICRA 2016), here by points and normals
(point-to-line ICP, Censi 2008). Real wheels hang and leap: a reading stays the same while the robot turns, and then jumps.
So the wheels count from an anchor, the last scan that fitted while they were fresh, never from scan to scan; what does not
fit is tried from other places (the speed of late, standing still, a search); and a place far from what was expected waits
for the next scan before anything is built on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.contracts import Odometry
from rhs.api.geometry import se2
from rhs.api.records import Motion, Observation, Revision, Scan, Tracking
from rhs.estimation.scans.planar_poses import between, lifted
from rhs.estimation.scans.point_map import Cloud, Fit, cloud_of, seen_directions

from .config import ScanToMap
from .local_map import LocalMap
from .prediction import Guess, Predictor, WheelError

FLOOR_M, FLOOR_RAD = 0.004, 0.002  # no scan is laid better than this (1 sigma)
LOST_M, LOST_RAD = 0.5, 0.3  # of a pose that nothing was held against
LEAST_POINTS = 20


class ScanToMapOdometry(Odometry):
    """The pose of each scan in a map of the last key scans."""

    scale_from = "laser"

    def __init__(self, settings: ScanToMap) -> None:
        self._settings, self._rescue = settings, settings.advanced.rescue
        self._map = LocalMap(settings)
        self._predictor, self._wheels = Predictor(settings.advanced.prediction), WheelError()
        self._poses: list[np.ndarray] = []  # in a frame of its own, as believed now
        self._scans: list[Scan | None] = []
        self._spread = np.diag([FLOOR_M, FLOOR_M, FLOOR_RAD]) ** 2  # of the last pose in the map
        self._doubt: np.ndarray | None = None  # the last pose may be this one instead
        self._usual = 0.0  # share of points with a partner, of late
        self._poor = 0  # scans on end that did not fit

    def update(self, observation: Observation) -> Motion:
        """The motion of the body since the last scan."""
        cloud = None if observation.scan is None else cloud_of(observation.scan, self._settings.advanced.points)
        self._scans.append(observation.scan)
        if not self._poses:
            return self._begin(observation, cloud)
        last = self._poses[-1]
        guess = self._predictor.predict(last, observation)
        fit, good, reason = self._laid(cloud, guess)
        now = fit.pose
        seen = seen_directions(fit.information, self._settings.advanced.points)
        step = between(last, now)
        self._predictor.learn(guess, now, seen, good)
        if good:
            self._wheels.compare(guess, now, seen, float(np.hypot(*step[:2])))
        held = guess.measured and not _shows(cloud) and _ends(cloud) > 0  # by the wheels alone
        spread = _spread_of(seen, self._wheels.trusted(guess.prior) if guess.measured else guess.prior, good or held)
        covariance = _carried(self._spread, step) + spread
        self._poses.append(now)
        self._spread = spread
        self._predictor.moved_to(now, guess=guess, good=good)
        self._poor = 0 if good else self._poor + 1
        if cloud is not None and _shows(cloud) and (good or self._poor >= self._rescue.patience):
            self._learn(cloud, now, fit.share if good else self._rescue.least_share)
        status, why = (Tracking.DEGENERATE, f"{reason}; the wheels say") if held else _status(seen, guess, good, reason)
        details = {"share": fit.share, "good": float(good)}
        return Motion(se2(*step), _lifted(covariance), status, why, details=details)

    def revise(self) -> Revision | None:
        """The poses of all scans: those that a later scan proved wrong are where it put them."""
        return Revision(lifted(np.array(self._poses)), tuple(self._scans)) if self._poses else None

    def _begin(self, observation: Observation, cloud: Cloud | None) -> Motion:
        self._predictor.begin(observation)
        self._poses.append(np.zeros(3))
        if cloud is not None and _shows(cloud):
            self._map.add(cloud, self._poses[0])
        return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view")

    def _laid(self, cloud: Cloud | None, guess: Guess) -> tuple[Fit, bool, str]:
        """Where the scan is, whether it fits there, and if not, why not."""
        blind = Fit(guess.pose, np.zeros((3, 3)), 0.0)
        if cloud is None or not _shows(cloud):
            return blind, False, f"{_ends(cloud)} beams of the scan end on something"
        if not self._map.begun:
            self._map.add(cloud, guess.pose)
            return blind, False, "the first scan that shows something"
        if guess.measured:
            trusted = self._wheels.trusted(guess.prior)
            cloud = self._map.still(cloud, guess.pose, trusted)
            prior = self._wheels.proven(guess.prior, self._settings.advanced.prediction.least_m)
            fit = self._fit(cloud, guess.pose, prior, self._reach(trusted))
            if fit.share < self._rescue.typical_share * self._usual:
                fit = self._fit(cloud, guess.pose, guess.prior)
        else:
            fit = self._fit(cloud, guess.pose, guess.prior)
        if not guess.measured:
            fit = self._map.walls.unslid(cloud, fit, guess.pose, self._settings.advanced.points)
        fit = self._doubted(cloud, fit)
        if fit.share >= max(self._rescue.least_share, self._rescue.typical_share * self._usual):
            return fit, True, ""
        other = self._elsewhere(cloud, guess, fit)
        if other is None:
            good = fit.share >= self._rescue.least_share
            why = f"{fit.share:.0%} of the ends lie on walls"
            return (fit, True, "") if good else (replace(blind, share=fit.share), False, why)
        if guess.expects(other.pose, self._rescue.doubt_m, self._rescue.doubt_rad):
            return other, True, ""
        self._doubt = other.pose
        return other, False, "found far from where it was looked for"

    def _doubted(self, cloud: Cloud, fit: Fit) -> Fit:
        """The fit, or that from the doubtful place of the last scan where it explains this one better."""
        doubt, self._doubt = self._doubt, None
        if doubt is None:
            return fit
        start, prior = self._predictor.stepped(doubt)
        other = self._fit(cloud, start, prior)
        if other.share > max(fit.share + 0.05, self._rescue.sure_share):
            return other
        if fit.share >= self._rescue.least_share and self._predictor.before is not None:
            self._poses[-1] = self._predictor.before  # the doubt was wrong
        return fit

    def _elsewhere(self, cloud: Cloud, guess: Guess, fit: Fit) -> Fit | None:
        """A place that explains the scan clearly better than `fit`: from the other guesses, or by a search."""
        wide = self._predictor.wide
        best, score = None, max(self._map.score(cloud, fit) + self._rescue.better,
                                min(self._rescue.sure_share, max(self._rescue.least_share, self._usual)))
        tries = [*guess.others]
        for search in (False, True):
            starts = tries if not search else [self._map.search(cloud, at) for at in guess.centres(self._rescue.window_m)]
            for start in starts:
                if start is None:
                    continue
                other = self._fit(cloud, start, wide)
                if (value := self._map.score(cloud, other)) > score:
                    best, score = other, value
            if best is not None:
                return best
        return None

    def _fit(self, cloud: Cloud, start: np.ndarray, prior: np.ndarray, reach_m: float | None = None) -> Fit:
        points = self._settings.advanced.points
        reach = None if reach_m is None else (reach_m, points.reach_least_m)
        return self._map.walls.fit(cloud, start, prior, points, reach=reach)

    def _reach(self, trusted: np.ndarray) -> float:
        """Partners are looked for as far as the wheels may be wrong (three sigmas), metres: further on somebody who walks
        along with the robot would be taken for one who stands, and the robot with him."""
        points, sigma = self._settings.advanced.points, np.diag(trusted) ** -0.5
        far_m = float(3.0 * max(sigma[0], sigma[1]) + points.lever_m * sigma[2])
        return min(max(far_m, points.reach_least_m), points.reach_m)

    def _learn(self, cloud: Cloud, pose: np.ndarray, share: float) -> None:
        """Make the scan part of the map, if it is far from the last one."""
        self._usual = share if self._usual == 0.0 else 0.9 * self._usual + 0.1 * share
        if self._poor:
            self._predictor.anchor_at(pose)
        if self._poor or self._map.far_from_last(pose):
            self._map.add(cloud, pose)
        self._poor = 0


def _ends(cloud: Cloud | None) -> int:
    """Beams that end on something."""
    return 0 if cloud is None else len(cloud.points)


def _shows(cloud: Cloud | None) -> bool:
    """Whether they are enough to say where the scanner is."""
    return _ends(cloud) >= LEAST_POINTS


def _carried(spread: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The covariance (3, 3) of a pose, in the frame of the pose `step` (3,) further on."""
    c, s = np.cos(step[2]), np.sin(step[2])
    back = np.array([[c, s, s * step[0] - c * step[1]], [-s, c, c * step[0] + s * step[1]], [0.0, 0.0, 1.0]])
    return back @ spread @ back.T


def _lifted(covariance: np.ndarray) -> np.ndarray:
    """(6, 6) of (3, 3): what a laser on a floor knows of height, roll and pitch is the floor."""
    out = 1e-6 * np.eye(6)
    plane = np.ix_([0, 1, 5], [0, 1, 5])
    out[plane] = 0.5 * (covariance + covariance.T)
    return out


def _spread_of(seen: np.ndarray, prior: np.ndarray, good: bool) -> np.ndarray:
    """(3, 3) covariance of the pose in the map. seen, prior: information (3, 3) of scan and guess."""
    if not good:
        return np.diag([LOST_M, LOST_M, LOST_RAD]) ** 2
    return np.linalg.inv(seen + prior) + np.diag([FLOOR_M, FLOOR_M, FLOOR_RAD]) ** 2


def _status(seen: np.ndarray, guess: Guess, good: bool, reason: str) -> tuple[Tracking, str]:
    if not good:
        return Tracking.LOST, reason
    if not guess.measured and np.linalg.eigvalsh(seen)[0] < 1e-6:
        return Tracking.DEGENERATE, "a direction that the scan does not see, and no wheels to say"
    return Tracking.OK, ""
