"""Settings of the task that recognises single views."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import PartSettings
from rhs.api.errors import Bounded, within
from rhs.api.task import Job, TaskContext


@dataclass
class Recognition(Bounded):
    """Which views are stored, which are asked, and how far off the route the asked ones are taken."""

    every: int = within(3, 1, 100_000)
    """a view is stored every so many steps of the survey (thesis 5.2: 3)"""
    ask_every: int = within(3, 1, 100_000)
    """every so many views of the queried lap is asked"""
    checks: int = within(5, 1, 1000)
    """candidates checked by geometry"""
    off_route_m: float = within(0.3, 0.0, 0.3)
    """rms distance of the queried lap from the surveyed route, metres"""
    off_route_deg: float = within(8.0, 0.0, 15.0)
    """rms of its heading against the route, degrees"""
    sequences: int = within(25, 1, 100_000)
    """so many times the localiser is started from nothing ..."""
    sequence_m: float = within(3.0, 0.0, 1000.0)
    """... and led so far before it is judged, metres"""


@dataclass
class Places(PartSettings):
    """Recognise single views: one survey stored, other views asked one by one (thesis 5.2)."""

    places: Recognition = field(default_factory=Recognition)

    needs: ClassVar[frozenset[str]] = frozenset({"driving", "image"})
    kinds: ClassVar[tuple[str, ...]] = ("source", "sensor", "odometry", "mapper", "localiser")

    def build(self, context: TaskContext) -> Job:
        from .task import PlacesJob

        return PlacesJob(self.places, context)
