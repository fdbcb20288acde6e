"""What going on as before is worth, where little measures a motion: learnt from how much the motions of late differed."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import inverse, log_se3

from ..advanced import GuessNoise


class GoingOn:
    """The last motion of a body, taken again (a speed that strays: white noise of acceleration; Bar-Shalom, Li and
    Kirubarajan 2001, section 6.3.2). views: how many on end were guessed so, not measured."""

    def __init__(self, settings: GuessNoise) -> None:
        self._settings = settings
        self._last: np.ndarray | None = None
        self._spread = np.zeros((6, 6))  # covariance of the last motion
        self._square, self._count = np.zeros(2), 0  # of the changes of motion: metres, radians; per axis
        self.views = 0

    def measured(self, motion: np.ndarray, spread: np.ndarray, *, surely: bool) -> None:
        """Take note of a motion (4, 4) per view and its covariance (6, 6). surely: one to learn changes from."""
        if surely and self._last is not None and self.views == 0:
            change = log_se3(inverse(self._last) @ motion)
            self._count += 1
            share = 1.0 / min(self._count, self._settings.again_memory)
            self._square = (1.0 - share) * self._square + share * (change.reshape(2, 3) ** 2).mean(axis=1)
        self._last, self._spread, self.views = motion if surely else None, spread, 0

    def since(self, told: np.ndarray) -> np.ndarray:
        """(6, 6) covariance of the next view against the last one measured; told (6, 6): of one motion, as long as little has
        been seen, and of its change at most."""
        s, n = self._settings, self.views + 1
        times = n * (n + 1) * (2 * n + 1) / 6.0  # the speed errs by sqrt(n) changes, the place by their sum
        if self._count < s.again_memory // 3:
            return told * times
        change = np.repeat(s.again_times**2 * self._square + np.square([s.again_least_m, s.again_least_rad]), 3)
        return n * n * self._spread + times * np.diag(np.minimum(change, np.diag(told)))
