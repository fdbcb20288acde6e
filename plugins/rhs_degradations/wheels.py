"""Wheels that spin."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Degradation, PartSettings
from rhs.api.errors import within
from rhs.api.records import Capture


@dataclass
class WheelSlip(PartSettings):
    """Wheels that spin for a stretch of the way: they count more than the robot moves."""

    slip_share: float = within(0.5, 0.0, 100.0)
    """how much more, share of the true travel and turn; 0: nothing"""
    slip_chance: float = within(0.03, 0.0, 1.0)
    """chance that a stretch begins at a view"""
    slip_views: int = within(10, 1, 100_000)
    """length of a stretch, views"""

    needs: ClassVar[frozenset[str]] = frozenset({"wheel"})

    def build(self, context: Context) -> Degradation:
        return Spinning(self, context.rng)


class Spinning(Degradation):
    """Counts the views of a stretch down."""

    def __init__(self, settings: WheelSlip, rng: np.random.Generator) -> None:
        self._settings, self._rng, self._left = settings, rng, 0

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        begins = self._rng.random() < self._settings.slip_chance
        self._left = self._settings.slip_views if begins and self._left == 0 else max(0, self._left - 1)
        if self._left == 0 or capture.travel is None or self._settings.slip_share == 0.0:
            return capture
        return replace(capture, travel=(1.0 + self._settings.slip_share) * np.asarray(capture.travel, float))
