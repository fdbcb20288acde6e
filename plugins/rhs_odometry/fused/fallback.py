"""What to believe about the motion when vision has nothing to say: wheels, else the command, else more of the same."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import planar, se2
from rhs.api.records import Observation

from ..advanced import GuessNoise

USUAL = GuessNoise()


def told_motion(observation: Observation) -> tuple[str, np.ndarray | None]:
    """Who tells of the motion of the body since the view before, `wheel` or `command`, and the motion (4x4); or nobody."""
    if observation.wheel is not None and np.isfinite(observation.wheel).all():
        return "wheel", se2(*observation.wheel)
    return ("", None) if observation.command is None else ("command", se2(*observation.command.travel))


def guess_motion(
    observation: Observation, last: np.ndarray, noise: GuessNoise = USUAL
) -> tuple[str, np.ndarray, np.ndarray]:
    """(name of the guess, previous_from_body 4x4, covariance 6x6) from what the observation carries.

    last: the previous motion, taken again when there is neither wheel travel nor a command.
    """
    name, pose = told_motion(observation)
    if pose is None:
        name, pose = "same again", last
    distance, turn = float(np.linalg.norm(pose[:3, 3])), abs(float(planar(pose)[2]))
    share, least_m, least_rad = noise.of(name)
    sigma_m, sigma_rad = least_m + share * distance, least_rad + share * turn
    return name, pose, np.diag([sigma_m**2] * 3 + [sigma_rad**2] * 3)
