"""Odometry `orb`: as procrustes, with ORB features (Rublee et al., ICCV 2011), several times faster than SIFT.

ORB places a key-point on the pixels of its pyramid level, a pixel or two off. So the motion that the features agree on
is only the start: each matched point is then looked up by its patch, warped as that motion and the slope of the surface
say, to a tenth of a pixel, and the motion fitted anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from rhs.api.contracts import Context
from rhs.api.geometry import inverse, transform
from rhs.api.records import Features, Observation
from rhs.estimation.views import features as vision
from rhs.estimation.views.rigid import Rigid, procrustes, refine_reprojection
from rhs_odometry.tracks import tracks

from ..keyframe.patches import find_patches
from ..keyframe.surface import rays_beside, surfaces, warps
from .config import Orb
from .procrustes import ProcrustesOdometry


@dataclass(frozen=True, eq=False)
class Sight:
    """What placing by patches needs of a view: the pyramid of its gray image, and its depth."""

    picture: list[np.ndarray]
    depth: np.ndarray


class OrbOdometry(ProcrustesOdometry):
    """The same estimation on other features, which are placed by patches."""

    def __init__(self, settings: Orb, context: Context) -> None:
        super().__init__(settings, context)
        self._settings: Orb
        self._camera = context.camera
        self._sights: WeakKeyDictionary[Features, Sight] = WeakKeyDictionary()

    def __getstate__(self) -> dict[str, Any]:
        """For pickle."""
        return vars(self) | {"_sights": dict(self._sights)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state | {"_sights": WeakKeyDictionary(state["_sights"])})

    def _features(self, observation: Observation) -> Features:
        features = vision.orb_features(observation, self._settings.features)
        if observation.image is not None and observation.depth is not None:
            picture = tracks.pyramid(tracks.gray(observation.image))
            self._sights[features] = Sight(picture, observation.depth)
        return features

    @property
    def _ratio(self) -> float:
        return self._settings.ratio

    def _refined(self, found: Rigid, p: np.ndarray, q: np.ndarray, seen: tuple[Features, Features, np.ndarray]) -> Rigid:
        if self._settings.placing == "patches" and found.count >= self._settings.min_inliers:
            previous, current, rows = seen
            placed = self._placed(previous, current, rows[:, 1], found.a_from_b)
            if placed is not None:
                return self._fitted(found, *placed)
        return super()._refined(found, p, q, seen)

    def _placed(self, previous: Features, current: Features, rows: np.ndarray, previous_from_current: np.ndarray):
        """Points of the current (p) and previous (q) camera for rows of the previous view whose patches are found again
        where a motion says; None when they are too few."""
        then, now = self._sights[previous], self._sights[current]
        pixels = previous.pixels[rows].astype(float)
        a = self._settings.advanced
        rho, slopes = surfaces(then.depth, pixels, a.surface)
        known = np.isfinite(rho)
        pixels, rho, slopes = pixels[known], rho[known], slopes[known]
        q = self._camera.points(pixels, 1.0 / rho)
        motion = inverse(previous_from_current)
        warped = warps(rays_beside(pixels, self._camera), rho, slopes, now_from_then=motion, camera=self._camera)
        guess = self._camera.project(transform(motion, q))
        seen, found = find_patches(then.picture, now.picture, pixels=pixels, warps=warped, guess=guess, s=a.patches)
        seen, q = seen[found], q[found]
        rho, _ = surfaces(now.depth, seen, a.surface)
        known = np.isfinite(rho)
        p = self._camera.points(seen[known], 1.0 / rho[known])
        return (p, q[known]) if len(p) >= self._settings.min_inliers else None

    def _fitted(self, rough: Rigid, p: np.ndarray, q: np.ndarray) -> Rigid:
        everyone = np.ones(len(p), bool)
        if self._settings.refine == "none":
            gate = self._settings.gate_sigma
            return procrustes(p, q, noise=self._noise, inliers=everyone, gate_sigma=gate) or rough
        start = Rigid(rough.a_from_b, rough.covariance, everyone, rough.misfit)
        return refine_reprojection(start, p, q, noise=self._noise, gate_sigma=self._settings.gate_sigma)
