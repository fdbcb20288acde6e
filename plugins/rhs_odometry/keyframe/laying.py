"""When a view is laid by all its pixels (direct.py) on an earlier one, on which, and what that says beside its points.

One view is kept to lay the next ones on, so that errors do not add up from view to view, until too little of it is left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rhs.api.geometry import Camera, exp_se3, inverse, log_se3, orthonormal
from rhs.estimation.filters.kalman import gate

from .config import Keyframe
from .direct import Aligned, Level, align, levels
from .reprojection import PoseFit

if TYPE_CHECKING:
    from .keyframe_map import KeyframeMap
    from .tracker import PreparedView, Tracker


@dataclass(frozen=True, eq=False)
class Laid:
    """map_from_camera (4, 4) of a view and the covariance (6, 6) of its right perturbation; adding (6, 6): what it adds to
    that of the way, where the guess of one motion by the last hands its error on."""

    map_from_camera: np.ndarray
    covariance: np.ndarray
    adding: np.ndarray


@dataclass(frozen=True, eq=False)
class Kept:
    """The levels of a view, the serial of its key frame, keyframe_from_camera (4, 4), and how surely (metres, 1 sigma) the
    first view was laid on it."""

    levels: list[Level]
    serial: int
    hangs: np.ndarray
    sigma: float


class Direct:
    """Lays views on a kept one. Only for views that ask for it. on_floor: wheels tell what the views do not."""

    def __init__(self, settings: Keyframe, camera: Camera, keyframes: KeyframeMap, *, on_floor: bool) -> None:
        self._settings, self._camera, self._map, self._on_floor = settings, camera, keyframes, on_floor
        self._advanced = settings.advanced
        s = self._direct = self._advanced.direct
        if on_floor:  # wheels bring it near
            self._direct = replace(s, levels=1, grey_sigma=s.floor_grey_sigma, bent_per_m=s.floor_bent_per_m)
        self._gate = gate(6, self._direct.probability)
        self._kept: Kept | None = None

    def noise(self, fit: PoseFit, followed: int) -> bool:
        """Whether most of what was followed is there no more: noise, not corners. Rows read one by one bend a view, and make
        corners fail, too."""
        return self._camera.readout_s == 0.0 and bool(fit.inliers.sum() < self._advanced.corner_share * followed)

    def wanted(self, fit: PoseFit | None, followed: int) -> bool:
        """Whether all pixels are worth asking, too."""
        few = self._advanced.direct_share * self._settings.points
        if self._on_floor or self._camera.readout_s > 0.0:  # of which all pixels know nothing
            few = self._advanced.outvote * self._settings.min_inliers
        return fit is None or (not self._on_floor and self.noise(fit, followed)) or bool(fit.inliers.sum() < few)

    def lay(self, look: PreparedView, tracker: Tracker, start: np.ndarray, guess: np.ndarray,
            wides: tuple[np.ndarray, ...]) -> Laid | None:
        """The view on the one kept, or on the tracker's last one, which is then kept. start, guess: of its map_from_camera;
        wides (6, 6): covariance of the camera's guessed motion, and in a hand of any. None, too, of a picture all of one
        brightness: no camera that works shows that, noise being what it is, and who believes its depth?"""
        if np.ptp(look.picture[0]) == 0:
            return None
        s, camera = self._direct, self._camera
        now = levels(look.picture[0], look.depth, camera, s)
        if self._kept is not None:
            pose = self._map.stand(np.array([self._kept.serial]))[0] @ self._kept.hangs
            found, wide = self._aligned(self._kept.levels, now, inverse(pose) @ np.stack([start, guess]), wides)
            if found is not None and found.shared > s.keep_shared and not self._vague(found) and (
                    _size(found.covariance) < s.keep_sigmas * self._kept.sigma):
                return self._found(pose, found, wide)
        assert tracker.look is not None
        then, pose = levels(tracker.look.picture[0], tracker.look.depth, camera, s), tracker.pose
        found, wide = self._aligned(then, now, inverse(pose) @ np.stack([start, guess]), wides)
        self._kept = None if found is None or self._vague(found) else Kept(
            then, int(self._map.serials[-1]), inverse(self._map.poses[-1]) @ pose, _size(found.covariance))
        return None if found is None or self._vague(found) else self._found(pose, found, wide)

    def _vague(self, found: Aligned) -> bool:
        """Whether noise decides where a view lies, along a lone plain wall: no wheels are there to tell it."""
        return not self._on_floor and _size(found.covariance) > self._direct.vague_m

    def _found(self, pose: np.ndarray, found: Aligned, wide: np.ndarray) -> Laid:
        """What a view laid on one at a pose says. Of wheels no error is handed on into the next motion."""
        adding = found.covariance if self._on_floor else _adding(found.covariance, wide)
        return Laid(orthonormal(pose @ found.then_from_now), found.covariance, adding)

    def _aligned(self, then: list[Level], now: list[Level], starts: np.ndarray, wides: tuple[np.ndarray, ...]):
        """How `now` lies on `then` from where to start and what is guessed (2, 4, 4), and the covariance that the guess had:
        the second where the views show a jerk that the first one denies."""
        start, guess = starts
        for wide in wides:
            found = align(then, now, self._camera, guess, wide, self._direct, start)
            if found is None:
                continue
            off = log_se3(inverse(guess) @ found.then_from_now)
            if off @ np.linalg.solve(wide, off) < self._gate:
                break
        return found, wide

    def joined(self, look: PreparedView, tracker: Tracker, fit: PoseFit | None, laid: Laid,
               followed: tuple[np.ndarray, np.ndarray]) -> PoseFit | None:
        """What the points and all pixels say together. Where they contradict, many points are right, and a few are looked up
        anew from where the pixels put the view; None when those do not bear the pixels out, and on a floor, where wheels and
        pixels know more than a few points. followed: ids (N,) and pixels (N, 2) before the view."""
        if self._on_floor:
            return None
        if fit is not None and fit.inliers.sum() >= self._advanced.outvote * self._settings.min_inliers:
            if self._contradicts(fit, laid):
                self._kept = None
                return fit
        elif fit is None or self._contradicts(fit, laid):
            tracker.ids, tracker.pixels = followed
            fit = tracker.find(look, laid.map_from_camera)
            if fit.inliers.sum() < self._settings.min_inliers or self._contradicts(fit, laid):
                return None
        more = np.linalg.inv(laid.covariance)
        information = self._information(fit) + more
        step = np.linalg.solve(information, more @ _apart(fit, laid))
        return replace(fit, camera_from_map=orthonormal(exp_se3(step) @ fit.camera_from_map), information=information)

    def _contradicts(self, fit: PoseFit, laid: Laid) -> bool:
        """Whether points and pixels cannot both be right."""
        off, spread = _apart(fit, laid), np.linalg.inv(self._information(fit) + 1e-3 * np.eye(6)) + laid.covariance
        return bool(off @ np.linalg.solve(spread, off) > self._gate)

    def _information(self, fit: PoseFit) -> np.ndarray:
        return fit.information / self._advanced.correlated


def _adding(covariance: np.ndarray, wide: np.ndarray) -> np.ndarray:
    """(6, 6) per view of the sum of motions, each with this covariance, where the guess had `wide`: the share 1 - K of an
    error that a view does not correct goes on into the next (long-run variance of an autoregression)."""
    corrected = np.eye(6) - covariance @ np.linalg.inv(wide) + 1e-3 * np.eye(6)
    long = np.linalg.solve(corrected, covariance)
    return long + long.T - covariance


def _apart(fit: PoseFit, laid: Laid) -> np.ndarray:
    """(6,) left perturbation of the fit's camera_from_map that leads to the laid one."""
    return log_se3(inverse(laid.map_from_camera) @ inverse(fit.camera_from_map))


def _size(covariance: np.ndarray) -> float:
    """Deviation of a position (m) with this covariance (6, 6), along its worst direction."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
