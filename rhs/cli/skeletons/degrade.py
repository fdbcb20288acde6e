"""A degradation for rhs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Context, Degradation
from rhs.api.records import Capture


@dataclass
class Skeleton(Bounded):
    """A lamp that flickers: each picture is darker by a share of its own."""

    sigma: float = within(0.2, 0.0, 1.0)
    """the share by which a picture is darker: half of a normal distribution, 1 sigma; 0: nothing is spoilt"""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self, context.rng)


class Part(Degradation):
    """Built anew for every run; randomness comes from `rng` alone."""

    def __init__(self, settings: Skeleton, rng: np.random.Generator) -> None:
        self.settings, self.rng = settings, rng

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        """A new capture: index and stamp stay, and no array is written to."""
        darker = min(self.settings.sigma * abs(self.rng.standard_normal()), 1.0)
        if darker == 0.0 or capture.image is None:
            return capture
        return replace(capture, image=np.rint((1.0 - darker) * capture.image).astype(np.uint8))
