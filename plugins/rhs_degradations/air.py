"""Fog, smoke and dust."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Degradation, PartSettings
from rhs.api.errors import within
from rhs.api.records import Capture

from .light import with_grey


@dataclass
class Fog(PartSettings):
    """Fog, smoke or dust: far things fade into grey (Koschmieder 1924), and their depth is lost."""

    extinction_per_m: float = within(0.1, 0.0, 100.0)
    """share of the light that a short way takes, per metre; 0: clear air. Sight reaches 3 / extinction_per_m"""
    air_grey: float = within(200.0, 0.0, 255.0)
    """grey level of the air"""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})

    def build(self, context: Context) -> Degradation:
        return Murky(self, context.rng)


class Murky(Degradation):
    """Contrast by the way of the light; the depth of a pixel by the way there and back."""

    def __init__(self, settings: Fog, rng: np.random.Generator) -> None:
        self._settings, self._rng = settings, rng

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        settings = self._settings
        if settings.extinction_per_m == 0.0 or capture.image is None or capture.depth is None:
            return capture
        known = np.isfinite(capture.depth)
        depth = np.where(known, capture.depth, np.median(capture.depth[known]) if known.any() else 0.0)
        through = np.exp(-np.float32(settings.extinction_per_m) * depth)
        lost = self._rng.random(through.shape, dtype=np.float32) > through**2
        grey = capture.image * through[:, :, None] + np.float32(settings.air_grey) * (1 - through[:, :, None])
        return replace(with_grey(capture, grey), depth=np.where(lost, np.float32(np.nan), capture.depth))
