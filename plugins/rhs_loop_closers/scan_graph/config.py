"""Settings of the loop closer `scan_graph`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, LoopCloser, PartSettings
from rhs.api.errors import Bounded, within
from rhs.estimation.scans.settings import PointSettings
from rhs.estimation.views.settings import DriftBounds


@dataclass(frozen=True)
class Windows(Bounded):
    """Where a place seen again is looked for, and what is believed of it."""

    every_m: float = within(1.0, 0.05, 100.0)
    """a loop is looked for after so much way, metres"""
    way_m: float = within(8.0, 1.0, 1e4)
    """way along the graph between two passages of a place, at least, metres"""
    radius_m: float = within(0.8, 0.05, 100.0)
    """the window to either side, metres"""
    growth: float = within(0.03, 0.0, 1.0)
    """it grows by this share of the way along the graph: what the odometry may drift"""
    most_m: float = within(8.0, 0.1, 100.0)
    """and no larger, metres"""
    turn_rad: float = within(0.08, 0.01, 3.2)
    """the window of headings, radians"""
    turn_growth: float = within(0.004, 0.0, 1.0)
    """grows by so much per metre of that way, radians"""
    turn_most_rad: float = within(0.5, 0.01, 3.2)
    """and no larger, radians"""
    source_m: float = within(1.5, 0.1, 100.0)
    """what is looked for: the scans of so much way on both sides, metres"""
    target_m: float = within(6.0, 0.1, 100.0)
    """where it is looked for: the same of the earlier passage, metres"""
    passages: int = within(3, 1, 100)
    """earlier passages tried, nearest first"""
    cell_m: float = within(0.1, 0.01, 1.0)
    """cells of the search, metres"""
    sigma_m: float = within(0.1, 0.01, 1.0)
    """and how close to a wall a point must lie (1 sigma), metres"""
    step_rad: float = within(0.015, 1e-3, 1.0)
    """its steps in heading, radians"""
    points: int = within(200, 20, 10_000)
    """points looked for at most"""
    least_score: float = within(0.55, 0.0, 1.0)
    """mean closeness of the points to walls"""
    rival: float = within(0.94, 0.0, 1.0)
    """another place with this share of the best score makes both doubtful"""
    least_share: float = within(0.6, 0.0, 1.0)
    """of the points that must find a partner"""
    through: float = within(0.13, 0.0, 1.0)
    """most of the walls that the beams may look through"""
    alone_m: float = within(1.3, 0.0, 100.0)
    """a loop in a smaller window needs no other that agrees, if ..."""
    alone_share: float = within(0.75, 0.0, 1.0)
    """... so many points find a partner"""
    three_m: float = within(4.0, 0.0, 100.0)
    """in a larger window three must agree, else two, metres"""
    beside_m: float = within(8.0, 0.1, 1000.0)
    """and stand within so much way of one another, metres"""


@dataclass(frozen=True)
class Refinement(Bounded):
    """The last rounds: pairs of key scans, then every scan onto the key scans around it."""

    rounds: int = within(3, 0, 100)
    """of key scans laid onto other passages; 0: none"""
    map_m: float = within(3.0, 0.1, 100.0)
    """a passage is the scans of so much way on both sides of the nearest one, metres"""
    near_m: float = within(3.0, 0.1, 100.0)
    """a key scan is laid onto other passages this near, metres"""
    partners: int = within(3, 0, 100)
    """at most so many of each key scan"""
    least_share: float = within(0.35, 0.0, 1.0)
    """of the points that must find a partner"""
    least_met: float = within(0.2, 0.0, 10.0)
    """of the walls that a scan sees, those that it must share with the other passage: its beams end at them. In ten surveys,
    four of them of mazes, 328 of 390 pairs that were wrong by 6 to 10 cm and more had less, and 41 of 1,726 others"""
    reach_m: float = within(0.3, 0.02, 10.0)
    """partners are looked for as far as this, metres, and ..."""
    shrink: float = within(0.7, 0.1, 1.0)
    """... this share of it in each further round"""
    around_m: float = within(3.0, 0.1, 100.0)
    """every scan is laid onto the key scans this near, metres"""
    around: int = within(8, 1, 1000)
    """at most so many"""
    cell_m: float = within(0.1, 0.005, 2.0)
    """whose points are one where they are nearer than this, metres"""


@dataclass
class ScanGraphAdvanced(Bounded):
    """Thresholds of `loop_closer=scan_graph`."""

    windows: Windows = field(default_factory=Windows)
    refinement: Refinement = field(default_factory=Refinement)
    points: PointSettings = field(default_factory=PointSettings)
    agreeing: DriftBounds = field(default_factory=lambda: DriftBounds(0.25, 0.02, 0.06, 0.004))
    map_m: float = within(8.0, 0.5, 1000.0)
    """the odometry laid each scan onto those of so much way before, metres"""
    odometry_m: float = within(0.02, 1e-4, 10.0)
    """what the odometry is trusted to between two key scans at best (1 sigma), metres"""
    odometry_rad: float = within(0.01, 1e-4, 3.0)
    """and radians"""
    odometry_share: float = within(0.1, 0.0, 10.0)
    """and as a share of way and turn"""
    odometry_rad_per_m: float = within(0.03, 0.0, 10.0)
    """and of the heading per metre of way, radians"""
    loose_m: float = within(0.5, 1e-3, 100.0)
    """where a scan did not fit (1 sigma), metres"""
    loose_rad: float = within(0.3, 1e-3, 3.2)
    """and radians"""
    floor_m: float = within(0.03, 1e-4, 10.0)
    """no loop is better than this (1 sigma), metres"""
    floor_rad: float = within(0.01, 1e-4, 3.0)
    """and radians"""


@dataclass
class ScanGraph(PartSettings):
    """Places that laser scans see again, a pose graph, and every scan laid onto its neighbours. After the survey."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})

    key_m: float = within(0.5, 0.01, 10.0)
    """A scan is a node of the graph after so much way, metres."""
    key_rad: float = within(0.5, 0.01, 3.2)
    """Or after so much turning, radians."""
    kernel_sigma: float = within(3.0, 0.1, 1000.0)
    """Loops that lie further off than this count less and less (Cauchy), sigmas."""
    wrong_over: float = within(0.04, 0.0, 1.0)
    """A map in which beams look through a larger share of the walls of other passages reads wrong: loops are looked for
    again in wider windows."""
    wider: float = within(2.0, 1.0, 100.0)
    """By this factor."""
    tries: int = within(2, 0, 100)
    """At most so often."""
    advanced: ScanGraphAdvanced = field(default_factory=ScanGraphAdvanced)

    def build(self, context: Context) -> LoopCloser:
        from .closer import ScanGraphCloser

        return ScanGraphCloser(self)
