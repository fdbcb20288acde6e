"""What a robot on a floor cannot do: it moves in the plane, unless it is seen to sway.

A robot that stands firm keeps its height, roll and pitch, and a motion held to the plane is better for it. One that sways (a
soft suspension, a tall mast) tilts about the point where it stands, and a motion held to the plane then takes each nod for a
step. Whether it sways is measured: the rotations between views say so at once. Its motions are then left as they are.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from rhs.api.geometry import exp_se3, inverse, log_se3, planar, se2
from rhs.estimation.filters.kalman import gate

from ..advanced import SwaySettings

# A robot on a floor: how far its height (metres) and its roll and pitch (radians) may stray between two views.
FLOOR_SIGMAS = np.array([np.inf, np.inf, 1e-3, 1e-3, 1e-3, np.inf])
HELD = np.diag(1.0 / FLOOR_SIGMAS**2)  # the information that is
FREE = np.array([0, 1, 5])


class Floor:
    """Holds the motions of one body to the floor that it stands on, one after the other, as long as it stands firm."""

    def __init__(self, settings: SwaySettings) -> None:
        self._settings, self._limit = settings, gate(2, settings.gate_probability)
        self._tilted: deque[bool] = deque(maxlen=settings.views)  # roll or pitch turned by more than their noise explains

    def hold(self, pose: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The motion (4x4) on the floor nearest to a measured one in the sense of its 6x6 information, and its 6x6
        covariance; the measured one while the robot sways."""
        spread = np.linalg.inv(information)
        self.note(pose, spread)
        return (pose, 0.5 * (spread + spread.T)) if self.sways else on_floor(pose, information)

    def note(self, pose: np.ndarray, covariance: np.ndarray) -> None:
        """A motion (4x4) as it was measured, with its 6x6 covariance: evidence of standing firm or swaying."""
        turned = log_se3(pose)[3:5]
        noise = covariance[3:5, 3:5] + np.radians(self._settings.least_deg) ** 2 * np.eye(2)
        self._tilted.append(float(turned @ np.linalg.solve(noise, turned)) > self._limit)

    @property
    def sways(self) -> bool:
        """Whether roll and pitch turned by more than their noise explains, in more of the last views than wrong motions
        account for."""
        return sum(self._tilted) > self._settings.share * len(self._tilted)


def on_floor(pose: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The planar motion (4x4) nearest to `pose` in the sense of its 6x6 information, and its 6x6 covariance.

    Dropping z, roll and pitch would throw away what they say about the rest: a motion that appears to pitch also
    appears to go forward. Instead x, y and yaw are what the measurement gives them once the floor is known.
    """
    of_free = information[FREE]
    free, flat = of_free[:, FREE], se2(*planar(pose))
    for _ in range(2):
        error = log_se3(inverse(flat) @ pose)
        step = np.linalg.solve(free, of_free @ error)
        flat = flat @ exp_se3(np.array([step[0], step[1], 0.0, 0.0, 0.0, step[2]]))
    covariance = np.linalg.inv(information + HELD)
    return flat, 0.5 * (covariance + covariance.T)
