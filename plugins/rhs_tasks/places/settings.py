"""Settings of the task that recognises single views."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.errors import check_ranges
from rhs.api.task import Job, TaskContext


@dataclass
class Recognition:
    """Which views are stored, which are asked, and how far off the route the asked ones are taken."""

    every: int = 3
    """a view is stored every so many steps of the survey (thesis 5.2: 3)"""
    ask_every: int = 3
    """every so many views of the queried lap is asked"""
    checks: int = 5
    """candidates checked by geometry"""
    off_route_m: float = 0.3
    """rms distance of the queried lap from the surveyed route, metres"""
    off_route_deg: float = 8.0
    """rms of its heading against the route, degrees"""
    sequences: int = 25
    """so many times the localiser is started from nothing ..."""
    sequence_m: float = 3.0
    """... and led so far before it is judged, metres"""

    def __post_init__(self) -> None:
        check_ranges("places", self, every=(1, 100_000), ask_every=(1, 100_000), checks=(1, 1000),
                     off_route_m=(0.0, 0.3), off_route_deg=(0.0, 15.0), sequences=(1, 100_000),
                     sequence_m=(0.0, 1000.0))


@dataclass
class Places:
    """Recognise single views: one survey stored, other views asked one by one (thesis 5.2)."""

    places: Recognition = field(default_factory=Recognition)

    needs: ClassVar[frozenset[str]] = frozenset({"driving", "image"})
    provides: ClassVar[frozenset[str]] = frozenset()
    kinds: ClassVar[tuple[str, ...]] = ("source", "sensor", "odometry", "mapper", "localiser")

    def build(self, context: TaskContext) -> Job:
        from .task import PlacesJob

        return PlacesJob(self.places, context)
