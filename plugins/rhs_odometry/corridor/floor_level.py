"""Which points lie on the floor, where the floor alone sets the scale.

How far off a point is, the camera's motion tells up to the scale. Points along the top of a skirting board lie on a plane
as those of the floor do, and agree on a scale that is too large by their share of the camera's height. So the floor is the
lowest level: the points of the last views are a mixture of the floor and of an even spread a little above it, all off by
one error of the scale, found by maximum likelihood together with the share that is floor.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from .config import FloorRules
from .fit import TrackFit
from .state import SCALE, CorridorState
from .walls import met_at

ERRORS = np.linspace(-0.25, 0.25, 101)[:, None]  # of the scale, share of it, that are tried
LEAST_SIGMA = 0.01  # no point's height is known better, nor is the scale, share
FAR_OFF = 9.0  # of points that are not before the camera, or meet no floor


class FloorLevel:
    """Remembers how high points of the last views seemed, shares of the camera's height."""

    def __init__(self, rules: FloorRules) -> None:
        self._rules = rules
        self._known = self._with_now = np.zeros((0, 3))  # nearness, its sigma, and the motion's scale when they were seen

    def lies_on(self, state: CorridorState, fit: TrackFit) -> np.ndarray:
        """(T,) bool: points that are sooner of the floor than a little above it. state, fit: before the update."""
        seen = self._seen(state, fit)
        telling = (np.abs(seen[:, 0]) < self._rules.apart_share) & (seen[:, 1] < self._rules.known_share)
        known = self._with_now = np.vstack([self._known, seen[telling]])[-self._rules.kept:]
        if len(known) < self._rules.least:
            return np.zeros(len(seen), bool)
        scale = state.base[SCALE]
        near = (1.0 + known[:, 0]) * known[:, 2] / scale - 1.0
        error, share = self._level(near, known[:, 1], np.sqrt(state.covariance[SCALE, SCALE]) / scale)
        floor, above = self._densities(seen[:, 0] - error, seen[:, 1])
        return share * floor > (1.0 - share) * above + self._rules.stray

    def remember(self) -> None:
        """Keep the points that were asked about last."""
        self._known = self._with_now

    def _seen(self, state: CorridorState, fit: TrackFit) -> np.ndarray:
        """(T, 3): by how much nearer each point is than the floor on its ray, share of that (for a point a little above the
        floor its height by the camera's), its sigma, and the scale now."""
        floor = next(plane for plane in state.planes if plane.is_floor)
        there, _ = met_at(floor, fit.anchor, fit.directions())
        good = fit.good & (there > 0.03) & (fit.rho > 0.0)
        near = np.where(good, fit.rho / np.where(good, there, 1.0) - 1.0, FAR_OFF)
        sigma = np.where(good, fit.rho_sigma / np.where(good, fit.rho, 1.0), FAR_OFF) + LEAST_SIGMA
        return np.column_stack([near, sigma, np.full(len(near), state.base[SCALE])])

    def _level(self, near: np.ndarray, sigma: np.ndarray, scale_sigma: float) -> tuple[float, float]:
        """The likeliest error of the scale and share of points on the floor, of (N,) points."""
        floor, above = self._densities(near - ERRORS, sigma)
        prior = -0.5 * (ERRORS[:, 0] / max(scale_sigma, LEAST_SIGMA)) ** 2
        fits = np.array([np.log(s * floor + (1.0 - s) * above + self._rules.stray).sum(axis=1) + prior
                         for s in self._rules.shares])
        best, at = np.unravel_index(np.argmax(fits), fits.shape)
        return float(ERRORS[at, 0]), self._rules.shares[best]

    def _densities(self, near: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of points of the floor, and of points evenly spread up to `above_share`."""
        z, top = near / sigma, self._rules.above_share
        return np.exp(-0.5 * z * z) / (np.sqrt(2.0 * np.pi) * sigma), (ndtr(z) - ndtr((near - top) / sigma)) / top
