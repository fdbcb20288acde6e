"""What the wheels of this robot get wrong always: metres counted too long or short, turns likewise, a drift while it drives.

Learnt while the scans see the motion well, by robust least squares over the last stretches of way, and taken off every
reading: where a corridor or an empty place then says nothing, the wheels are as good as they can be. Source: systematic
errors of odometry as in Borenstein and Feng (UMBmark, 1996), found on the way as in Martinelli, Tomatis and Siegwart
(Simultaneous localization and odometry self calibration, Autonomous Robots 22, 2007); here by weighted least squares with
Cauchy's weights instead of a filter, because single readings hang and leap.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from rhs.estimation.scans.planar_poses import composed

STRETCH_M, STRETCH_RAD = 0.5, 0.5  # a row of the fit: so much way, or turning
ROWS = 100
PRIOR = np.array([0.1, 0.1, 0.1])  # 1 sigma of the scales of metres and turns, and of the drift, radians per metre
NOISE_M, NOISE_RAD = 0.03, 0.02  # of a stretch (1 sigma)
ROUNDS = 4


class WheelBias:
    """Scales of metres and turns and a drift: what `corrected` takes off a reading."""

    def __init__(self) -> None:
        self.metres, self.turns, self.drift = 1.0, 1.0, 0.0
        self._ways: deque[tuple[float, float]] = deque(maxlen=ROWS)  # by the wheels, by the scans
        self._turns: deque[tuple[float, float, float]] = deque(maxlen=ROWS)  # turn and way by the wheels, turn by the scans
        self._read: np.ndarray = np.zeros(3)  # of the stretch that is under way
        self._stepped: np.ndarray = np.zeros(3)
        self._way_m: float = 0.0
        self._turn: float = 0.0
        self._seen: tuple[bool, bool] = (True, True)

    def corrected(self, reading: np.ndarray) -> np.ndarray:
        """A reading (3,) as it would be without the bias."""
        way_m = float(np.hypot(*reading[:2]))
        return np.array([self.metres * reading[0], self.metres * reading[1], self.turns * reading[2] + self.drift * way_m])

    def learn(self, reading: np.ndarray, step: np.ndarray, seen: tuple[bool, bool]) -> None:
        """A reading (3,) of the wheels, the same motion by the scans, and whether those saw its way and its turn."""
        self._read, self._stepped = composed(self._read, reading), composed(self._stepped, step)
        self._way_m += float(np.hypot(*reading[:2]))
        self._turn += abs(float(reading[2]))
        self._seen = self._seen[0] and seen[0], self._seen[1] and seen[1]
        if self._way_m < STRETCH_M and self._turn < STRETCH_RAD:
            return
        if self._seen[0] and self._way_m >= 0.5 * STRETCH_M:
            self._ways.append((float(np.hypot(*self._read[:2])), float(np.hypot(*self._stepped[:2]))))
            told, true = np.array(self._ways).T
            self.metres = float(_fitted(told[:, None], true, np.array([1.0]), PRIOR[:1], NOISE_M)[0])
        if self._seen[1]:
            self._turns.append((float(self._read[2]), self._way_m, float(self._stepped[2])))
            rows = np.array(self._turns)
            self.turns, self.drift = (float(v) for v in _fitted(rows[:, :2], rows[:, 2], np.array([1.0, 0.0]), PRIOR[1:],
                                                                NOISE_RAD))
        self.skip()

    def skip(self) -> None:
        """The stretch begins anew: it is over, or something in between cannot be used."""
        self._read, self._stepped, self._way_m, self._turn = np.zeros(3), np.zeros(3), 0.0, 0.0
        self._seen = True, True


def _fitted(told: np.ndarray, true: np.ndarray, expected: np.ndarray, sigma: np.ndarray, noise: float) -> np.ndarray:
    """(P,) factors of the columns of told (N, P) that give true (N,) best, near the expected ones."""
    factors = expected
    for _ in range(ROUNDS):
        weights = 1.0 / (noise**2 * (1.0 + ((true - told @ factors) / (2.0 * noise)) ** 2))
        information = (told * weights[:, None]).T @ told + np.diag(sigma**-2.0)
        factors = np.linalg.solve(information, (told * weights[:, None]).T @ true + expected / sigma**2)
    return factors
