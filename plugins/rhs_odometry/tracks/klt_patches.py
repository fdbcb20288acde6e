"""What each followed point looked like when it was last looked at afresh.

Following from view to view lets small errors add up: after eleven views a point has strayed by a pixel, and all points
of one floor by 1.5 % of their way, since a window that comes nearer is stretched and pulls its point along. A patch that
is kept from its first view and learns its own stretch halves the one and takes most of the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .klt_kernels import MARGIN_PX, PARAMETERS, SIDE, find_again, remember


@dataclass(frozen=True)
class PatchRules:
    iterations: int = 4
    least_px: float = 0.02
    """steps shorter than this end the search"""
    views: int = 12
    """a look is taken afresh after so many views"""
    stretch: float = 1.5
    """or when its size has changed by this factor"""
    misfit: float = 0.5
    """a found patch differs from the first look by no more than this share of its contrast"""
    noise: float = 2.0
    """grey levels that are forgiven beside"""
    leap_px: float = 2.0
    """and lies no further from where the point was followed to"""


class Patches:
    """One patch per followed point, in the order of the tracker's points."""

    def __init__(self, rules: PatchRules) -> None:
        self._rules = rules
        m = SIDE * SIDE
        self._looks = [np.zeros((0, m)), np.zeros((0, m, PARAMETERS)), np.zeros((0, PARAMETERS, PARAMETERS))]
        self._warps, self._age = np.zeros((0, 2, 3)), np.zeros(0, int)

    def clear(self) -> None:
        self.keep(np.zeros(len(self._age), bool))

    def keep(self, mask: np.ndarray) -> None:
        """Forget the points that are not in the (N,) mask."""
        self._looks = [a[mask] for a in self._looks]
        self._warps, self._age = self._warps[mask], self._age[mask]

    def add(self, image: np.ndarray, pixels: np.ndarray) -> None:
        """Remember new points at (M, 2) pixels, which must be `whole`."""
        self._looks = [np.concatenate(pair) for pair in zip(self._looks, remember(image, pixels), strict=True)]
        self._warps = np.concatenate([self._warps, _unmoved(pixels)])
        self._age = np.concatenate([self._age, np.zeros(len(pixels), int)])

    def find(self, image: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(pixels (N, 2), found (N,)) of all points in a new image, from where they are guessed to be (N, 2)."""
        r, warps = self._rules, self._warps.copy()
        warps[:, :, 2] = guess
        misfit = find_again(image, *self._looks, warps, r.iterations, r.least_px)
        size = np.sqrt(np.abs(np.linalg.det(warps[:, :, :2])))
        found = (misfit < r.misfit * self._looks[0].std(axis=1) + r.noise) & (np.abs(np.log(size)) < np.log(2.5))
        found &= np.hypot(*(warps[:, :, 2] - guess).T) < r.leap_px
        self._warps = np.where(found[:, None, None], warps, self._warps)
        self._warps[:, :, 2] = np.where(found[:, None], warps[:, :, 2], guess)
        return self._warps[:, :, 2].copy(), found

    def refresh(self, image: np.ndarray, found: np.ndarray) -> None:
        """Look afresh at points that were not found (N,), that are old, or much larger or smaller than they were."""
        r, pixels = self._rules, np.ascontiguousarray(self._warps[:, :, 2])
        self._age = self._age + 1
        stretch = 0.5 * np.abs(np.log(np.abs(np.linalg.det(self._warps[:, :, :2]))))
        stale = ~found | (self._age >= r.views) | (stretch > np.log(r.stretch))
        stale &= whole(pixels, image)
        for old, new in zip(self._looks, remember(image, pixels[stale]), strict=True):
            old[stale] = new
        self._warps[stale], self._age[stale] = _unmoved(pixels[stale]), 0


def whole(pixels: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(N,) bool: the patch round each of the (N, 2) pixels lies inside the image."""
    high = np.array([image.shape[1], image.shape[0]]) - 1 - MARGIN_PX
    return np.asarray(((pixels >= MARGIN_PX) & (pixels <= high)).all(axis=1))


def _unmoved(pixels: np.ndarray) -> np.ndarray:
    """(N, 2, 3) warps of points just looked at."""
    warps = np.zeros((len(pixels), 2, 3))
    warps[:, 0, 0] = warps[:, 1, 1] = 1.0
    warps[:, :, 2] = pixels
    return warps
