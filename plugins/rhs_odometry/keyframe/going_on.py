"""What going on as before is worth, where nothing measures a motion: learnt from how much the motions of late differed."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import inverse, log_se3

from ..advanced import GuessNoise


class GoingOn:
    """The last motion of a body, taken again. views: how many on end were guessed so, not measured.

    A motion that differs from the one before by so much is, taken n times, off by its square times 1 + 4 + .. + n n: the speed
    errs by sqrt(n), the place by its sum. Hands and recordings of them show 1.0 to 1.2 times that for n up to 8."""

    def __init__(self, settings: GuessNoise) -> None:
        self._settings = settings
        self._last: np.ndarray | None = None
        self._square, self._count = np.zeros(2), 0  # of the changes of motion: metres, radians; per axis
        self.views = 0

    def measured(self, motion: np.ndarray) -> None:
        """Take note of a measured motion (4, 4) of one view."""
        if self._last is not None and self.views == 0:
            change = log_se3(inverse(self._last) @ motion)
            self._count += 1
            share = 1.0 / min(self._count, self._settings.again_memory)
            self._square = (1.0 - share) * self._square + share * (change.reshape(2, 3) ** 2).mean(axis=1)
        self._last, self.views = motion, 0

    def since(self, told: np.ndarray) -> np.ndarray:
        """(6, 6) covariance of the next view against the last one measured; told (6, 6) of one motion while little has been
        seen, and at most."""
        s, n = self._settings, self.views + 1
        times = n * (n + 1) * (2 * n + 1) / 6.0
        if self._count < s.again_memory // 3:
            return told * times
        least = np.square([s.again_least_m, s.again_least_rad])
        return np.minimum(told * times, np.diag(np.repeat(times * (s.again_times**2 * self._square + least), 3)))
