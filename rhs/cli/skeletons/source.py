"""A source for rhs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Source, SourceContext
from rhs.api.geometry import camera_from_fov, se2
from rhs.api.records import Capture, Scan, WorldFacts


@dataclass
class Skeleton(Bounded):
    """A laser scanner led straight through a round room: try it by `task=survey sensor=laser`. Read your recording here."""

    views: int = within(40, 1, 1_000_000)
    """how many there are"""
    room_radius_m: float = within(4.0, 1.0, 20.0)
    """of the room, metres"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "wheel"})

    def build(self, context: SourceContext) -> Part:
        return Part(self)


class Part(Source):
    """From one side of the room to the other, half a second a view."""

    def __init__(self, settings: Skeleton) -> None:
        self.settings, self.index = settings, -1
        self.views_expected = settings.views
        self.far_m = 0.7 * settings.room_radius_m
        self.step_m = 2.0 * self.far_m / max(settings.views - 1, 1)
        self.camera = camera_from_fov(320, 240, 60.0, height_m=1.0)  # no picture is taken by it
        reach = settings.room_radius_m + 0.5
        start, bounds = (-self.far_m, 0.0, 0.0), (-reach, -reach, reach, reach)
        self.facts = WorldFacts("round room", start, places=(), bounds_m=bounds, robot_radius_m=0.2)

    def lead(self) -> Capture | None:
        """The next view; None when there is none left."""
        if self.index + 1 >= self.settings.views:
            return None
        self.index += 1
        travel = np.array([self.step_m, 0.0, 0.0]) if self.index else None
        return Capture(self.index, 0.5 * self.index, travel=travel, scan=self.scan())

    def scan(self) -> Scan:
        """Beams all round to the wall: where |eye + range * along| is the radius."""
        bearings, x = np.linspace(-np.pi, np.pi, 360, endpoint=False), self.truth()[0, 3]
        ranges = -x * np.cos(bearings) + np.sqrt(self.settings.room_radius_m**2 - (x * np.sin(bearings)) ** 2)
        return Scan(bearings, ranges, max_range_m=30.0)

    def truth(self) -> np.ndarray:
        """For the judge alone; leave it out where nobody knows."""
        return se2(-self.far_m + self.step_m * self.index, 0.0, 0.0)

    def close(self) -> None:
        """Close your files here."""
