"""Odometry `wheel`: what the encoders say, and nothing else. The baseline that vision must beat."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Odometry, PartSettings
from rhs.api.errors import within
from rhs.api.geometry import se2
from rhs.api.records import Motion, Observation, Tracking

from ..advanced import GuessNoise
from .fallback import guess_motion


@dataclass
class WheelAdvanced:
    """What is taken where a view came without wheel travel."""

    guess: GuessNoise = field(default_factory=GuessNoise)


@dataclass
class Wheel(PartSettings):
    """Wheel encoders: planar motion with errors that grow with distance and turn."""

    needs: ClassVar[frozenset[str]] = frozenset({"wheel"})

    distance_share: float = within(0.05, 0.0, 1.0)
    """One-sigma error as a share of the distance since the last view."""
    turn_share: float = within(0.05, 0.0, 1.0)
    """One-sigma error as a share of the turn since the last view."""
    least_m: float = within(0.001, 1e-6, 1.0)
    """Least error of a reading of distance, metres."""
    least_rad: float = within(0.001, 1e-6, 1.0)
    """Least error of a reading of turn, radians."""
    advanced: WheelAdvanced = field(default_factory=WheelAdvanced)

    def build(self, context: Context) -> Odometry:
        return WheelOdometry(self)


class WheelOdometry(Odometry):
    """Hands on the encoders' travel; says `lost` when a view came without it."""

    def __init__(self, settings: Wheel) -> None:
        self._settings = settings
        self._begun = False

    def update(self, observation: Observation) -> Motion:
        if not self._begun:
            self._begun = True
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view")
        if observation.wheel is None or not np.isfinite(observation.wheel).all():
            name, pose, covariance = guess_motion(observation, np.eye(4), self._settings.advanced.guess)
            return Motion(pose, covariance, Tracking.LOST, f"no wheel travel with this view; took {name}")
        s = self._settings
        sigma_m = s.least_m + s.distance_share * float(np.hypot(*observation.wheel[:2]))
        sigma_rad = s.least_rad + s.turn_share * abs(float(observation.wheel[2]))
        # a wheel says nothing of height, roll and pitch; the floor does
        sigmas = np.array([sigma_m, sigma_m, 1e-3, 1e-3, 1e-3, sigma_rad])
        return Motion(se2(*observation.wheel), np.diag(sigmas**2), Tracking.OK, observability=1.0 / sigmas)
