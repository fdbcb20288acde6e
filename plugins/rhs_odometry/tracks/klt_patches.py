"""What each followed point looked like when it was last looked at afresh.

Following from view to view lets small errors add up: after eleven views a point has strayed by a pixel, and all points
of one floor by 1.5 % of their way, since a window that comes nearer is stretched and pulls its point along. A patch that
is kept from its first view and learns its own stretch halves the one and takes most of the other.
"""

from __future__ import annotations

import numpy as np

from rhs.estimation.views.settings import scaled_px

from .klt_kernels import PARAMETERS, find_again, remember
from .settings import PatchRules


class Patches:
    """One patch per followed point, in the order of the tracker's points, for images of one width."""

    def __init__(self, rules: PatchRules, width_px: int = 320) -> None:
        self._rules = rules
        self._half = max(round(scaled_px(rules.half_px, width_px)), 1)
        self._soft_px, self._leap_px = scaled_px(rules.soft_px, width_px), scaled_px(rules.leap_px, width_px)
        m = (2 * self._half + 1) ** 2
        self._looks = [np.zeros((0, m)), np.zeros((0, m, PARAMETERS)), np.zeros((0, PARAMETERS, PARAMETERS))]
        self._warps, self._age = np.zeros((0, 2, 3)), np.zeros(0, int)

    def keep(self, mask: np.ndarray) -> None:
        """Forget the points that are not in the (N,) mask."""
        self._looks = [a[mask] for a in self._looks]
        self._warps, self._age = self._warps[mask], self._age[mask]

    def add(self, image: np.ndarray, pixels: np.ndarray) -> None:
        """Remember new points at (M, 2) pixels, which must be `whole`."""
        self._looks = [np.concatenate(pair) for pair in zip(self._looks, self._remembered(image, pixels), strict=True)]
        self._warps = np.concatenate([self._warps, _unmoved(pixels)])
        self._age = np.concatenate([self._age, np.zeros(len(pixels), int)])

    def find(self, image: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(pixels (N, 2), found (N,)) of all points in a new image, from where they are guessed to be (N, 2)."""
        r, warps = self._rules, self._warps.copy()
        warps[:, :, 2] = guess
        patches, rows, gains = self._looks
        misfit = find_again(image, patches, rows, gains, warps, r.iterations, r.least_px, self._half)
        size = np.sqrt(np.abs(np.linalg.det(warps[:, :, :2])))
        found = misfit < r.misfit * self._looks[0].std(axis=1) + r.noise
        found &= np.abs(np.log(size)) < np.log(r.largest_stretch)
        found &= np.hypot(*(warps[:, :, 2] - guess).T) < self._leap_px
        self._warps = np.where(found[:, None, None], warps, self._warps)
        self._warps[:, :, 2] = np.where(found[:, None], warps[:, :, 2], guess)
        return self._warps[:, :, 2].copy(), found

    def refresh(self, image: np.ndarray, found: np.ndarray) -> None:
        """Look afresh at points that were not found (N,), that are old, or much larger or smaller than they were."""
        r, pixels = self._rules, np.ascontiguousarray(self._warps[:, :, 2])
        self._age = self._age + 1
        stretch = 0.5 * np.abs(np.log(np.abs(np.linalg.det(self._warps[:, :, :2]))))
        stale = ~found | (self._age >= r.views) | (stretch > np.log(r.stretch))
        stale &= self.whole(pixels, image)
        for old, new in zip(self._looks, self._remembered(image, pixels[stale]), strict=True):
            old[stale] = new
        self._warps[stale], self._age[stale] = _unmoved(pixels[stale]), 0

    def whole(self, pixels: np.ndarray, image: np.ndarray) -> np.ndarray:
        """(N,) bool: the patch round each of the (N, 2) pixels lies inside the image."""
        margin = self._half + 2
        high = np.array([image.shape[1], image.shape[0]]) - 1 - margin
        return np.asarray(((pixels >= margin) & (pixels <= high)).all(axis=1))

    def _remembered(self, image: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return remember(image, pixels, self._half, self._soft_px)


def _unmoved(pixels: np.ndarray) -> np.ndarray:
    """(N, 2, 3) warps of points just looked at."""
    warps = np.zeros((len(pixels), 2, 3))
    warps[:, 0, 0] = warps[:, 1, 1] = 1.0
    warps[:, :, 2] = pixels
    return warps
