"""What a belief becomes after a motion, and how likely it is to be right."""

from __future__ import annotations

from math import erf, exp, sqrt

import numpy as np

from .geometry import compose_covariance, orthonormal
from .records import Belief, Motion

RIGHT_M = 0.25  # a belief is right within this distance ...
RIGHT_RAD = np.radians(5.0)  # ... and this angle (records.Belief)


def chance_right(covariance: np.ndarray, radius_m: float = RIGHT_M, angle_rad: float = RIGHT_RAD) -> float:
    """Chance that a planar pose with this 6x6 covariance lies within radius and angle of the truth.

    The position is taken as round with the mean of its two variances, where the radius follows a Rayleigh law, and as
    independent of the heading.
    """
    variance = max(0.5 * float(covariance[0, 0] + covariance[1, 1]), 1e-12)
    yaw_sigma = sqrt(max(float(covariance[5, 5]), 1e-12))
    return (1.0 - exp(-0.5 * radius_m**2 / variance)) * erf(angle_rad / yaw_sigma / sqrt(2.0))


def moved(belief: Belief, motion: Motion) -> Belief:
    """The belief after one motion with nothing else to go by: pose and covariance composed, status kept.

    Being wrong about the place is not cured by moving, so the chance of being right only falls.
    """
    pose = orthonormal(belief.map_from_body @ motion.previous_from_body)
    covariance = compose_covariance(belief.covariance, motion.previous_from_body, motion.covariance)
    before, after = chance_right(belief.covariance), chance_right(covariance)
    probability = belief.probability * min(1.0, after / before) if before > 0 else 0.0
    return Belief(pose, covariance, belief.status, probability)
