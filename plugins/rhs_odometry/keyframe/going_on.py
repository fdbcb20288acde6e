"""What going on as before is worth, where little measures a motion: learnt from how much the motions of late differed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, adjoint, exp_se3, inverse, log_se3

from ..advanced import GuessNoise


@dataclass
class Adrift:
    """A camera that lost its way. since: serial of the first key frame that nobody knows where to put; spread (6, 6): of
    the guessed motion up to it; blind: nothing but the last motion was there to guess from; views: since then."""

    since: int
    spread: np.ndarray
    blind: bool
    views: int = 0


class GoingOn:
    """The last motion (4, 4) of a body that was well measured, taken again: a speed that strays (white noise of
    acceleration; Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2). views: how many on end were guessed so."""

    def __init__(self, settings: GuessNoise, camera: Camera) -> None:
        self._settings, self._b = settings, camera.body_from_camera
        self.motion, self._spread = np.eye(4), np.zeros((6, 6))
        self._square, self._count = np.zeros(2), 0  # of the changes of motion: metres, radians; per axis
        self._stale = 0  # views since the motion was measured, not counting those guessed on end
        self.views = 0

    def measured(self, way: np.ndarray, spread: np.ndarray) -> None:
        """Take note of the camera's way (4, 4) since the last view that was not guessed, with its covariance (6, 6), unless
        the motion of before still tells more."""
        views, move = self.views + 1, adjoint(self._b)
        motion = self._b @ exp_se3(log_se3(way) / views) @ inverse(self._b)
        spread = move @ spread @ move.T / views**2
        self.felt()
        if self._known and np.trace(spread[:3, :3]) > np.trace((self._spread + self._stale * self._change())[:3, :3]):
            return
        if self._stale == 1:
            change = log_se3(inverse(self.motion) @ motion)
            self._count += 1
            share = 1.0 / min(self._count, self._settings.again_memory)
            self._square = (1.0 - share) * self._square + share * (change.reshape(2, 3) ** 2).mean(axis=1)
        self.motion, self._spread, self._stale = motion, spread, 0

    def felt(self) -> None:
        """A view was measured in some directions only, by the guess in the others."""
        self._stale, self.views = self._stale + self.views + 1, 0

    def forget(self) -> None:
        """The motion stays, but nobody knows what it is worth."""
        self._count, self._square, self._stale, self.views = 0, np.zeros(2), 0, 0

    def since(self, told: np.ndarray) -> np.ndarray:
        """(6, 6) covariance of the camera's next view against the last one measured; told (6, 6): of one motion of the body,
        as long as little has been seen, and of its change at most."""
        n, move = self.views + 1, adjoint(inverse(self._b))
        times = n * (n + 1) * (2 * n + 1) / 6.0  # the speed errs by sqrt(n) changes, the place by their sum
        spread = told * times
        if self._known:
            change = np.minimum(self._change(), told)
            spread = n * n * (self._spread + self._stale * change) + times * change
        return move @ spread @ move.T

    @property
    def _known(self) -> bool:
        return self._count >= self._settings.again_memory // 3

    def _change(self) -> np.ndarray:
        """(6, 6) covariance of what a motion differs by from the one before."""
        s = self._settings
        return np.diag(np.repeat(s.again_times**2 * self._square + np.square([s.again_least_m, s.again_least_rad]), 3))
