"""Views that arrive late, or never."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.contracts import Context, Degradation, PartSettings
from rhs.api.errors import within
from rhs.api.records import Capture


@dataclass
class Latency(PartSettings):
    """Views arrive late: image, depth and scan of some views ago, wheels and command of now."""

    delay_views: int = within(1, 0, 1000)
    """views of delay; 0: none. At the beginning the first view stands still"""

    def build(self, context: Context) -> Degradation:
        return Late(self)


class Late(Degradation):
    """A queue."""

    def __init__(self, settings: Latency) -> None:
        self._queue: deque[Capture] = deque(maxlen=settings.delay_views + 1)

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        self._queue.append(capture)
        seen = self._queue[0]
        return replace(capture, image=seen.image, depth=seen.depth, scan=seen.scan, sensed=seen.sensed)


@dataclass
class Dropped(PartSettings):
    """Views that never arrive: the robot goes on with its command, the wheels count on."""

    drop_chance: float = within(0.1, 0.0, 0.95)
    """chance that a view is lost; 0: none"""

    def build(self, context: Context) -> Degradation:
        return Lossy(self, context.rng)


class Lossy(Degradation):
    """Each view alone; the first always arrives."""

    def __init__(self, settings: Dropped, rng: np.random.Generator) -> None:
        self._chance, self._rng, self._begun = settings.drop_chance, rng, False

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture | None:
        lost = self._rng.random() < self._chance and self._begun
        self._begun = True
        return None if lost else capture
