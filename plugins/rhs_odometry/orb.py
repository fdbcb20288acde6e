"""Odometry `orb`: as procrustes, with ORB features (Rublee et al., ICCV 2011), several times faster than SIFT."""

from __future__ import annotations

from rhs import vision
from rhs.records import Features, Observation

from .procrustes import ProcrustesOdometry


class OrbOdometry(ProcrustesOdometry):
    """The same estimation on other features."""

    def _features(self, observation: Observation) -> Features:
        return vision.orb_features(observation, self._settings.features)

    @property
    def _ratio(self) -> float:
        return self._settings.ratio
