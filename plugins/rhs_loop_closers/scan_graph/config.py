"""Settings of the loop closer `scan_graph`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, LoopCloser
from rhs.api.errors import check_ranges
from rhs.estimation.scans.settings import PointSettings
from rhs.estimation.views.settings import DriftBounds


@dataclass(frozen=True)
class Windows:
    """Where a place seen again is looked for, and what is believed of it."""

    every_m: float = 1.0
    """a loop is looked for after so much way, metres"""
    way_m: float = 8.0
    """way along the graph between two passages of a place, at least, metres"""
    radius_m: float = 0.8
    """the window to either side, metres"""
    growth: float = 0.03
    """it grows by this share of the way along the graph: what the odometry may drift"""
    most_m: float = 8.0
    """and no larger, metres"""
    turn_rad: float = 0.08
    """the window of headings, radians"""
    turn_growth: float = 0.004
    """grows by so much per metre of that way, radians"""
    turn_most_rad: float = 0.5
    """and no larger, radians"""
    source_m: float = 1.5
    """what is looked for: the scans of so much way on both sides, metres"""
    target_m: float = 6.0
    """where it is looked for: the same of the earlier passage, metres"""
    passages: int = 3
    """earlier passages tried, nearest first"""
    cell_m: float = 0.1
    """cells of the search, metres"""
    sigma_m: float = 0.1
    """and how close to a wall a point must lie (1 sigma), metres"""
    step_rad: float = 0.015
    """its steps in heading, radians"""
    points: int = 200
    """points looked for at most"""
    least_score: float = 0.55
    """mean closeness of the points to walls"""
    rival: float = 0.94
    """another place with this share of the best score makes both doubtful"""
    least_share: float = 0.6
    """of the points that must find a partner"""
    through: float = 0.13
    """most of the walls that the beams may look through"""
    alone_m: float = 1.3
    """a loop in a smaller window needs no other that agrees, if ..."""
    alone_share: float = 0.75
    """... so many points find a partner"""
    three_m: float = 4.0
    """in a larger window three must agree, else two, metres"""
    beside_m: float = 8.0
    """and stand within so much way of one another, metres"""

    def __post_init__(self) -> None:
        check_ranges("", self, every_m=(0.05, 100.0), way_m=(1.0, 1e4), radius_m=(0.05, 100.0), growth=(0.0, 1.0),
                     most_m=(0.1, 100.0), turn_rad=(0.01, 3.2), turn_growth=(0.0, 1.0), turn_most_rad=(0.01, 3.2),
                     source_m=(0.1, 100.0), target_m=(0.1, 100.0), passages=(1, 100), cell_m=(0.01, 1.0),
                     sigma_m=(0.01, 1.0),
                     step_rad=(1e-3, 1.0), points=(20, 10_000), least_score=(0.0, 1.0), rival=(0.0, 1.0),
                     least_share=(0.0, 1.0), through=(0.0, 1.0), alone_m=(0.0, 100.0), alone_share=(0.0, 1.0),
                     three_m=(0.0, 100.0), beside_m=(0.1, 1000.0))


@dataclass(frozen=True)
class Refinement:
    """The last rounds: pairs of key scans, then every scan onto the key scans around it."""

    rounds: int = 3
    """of key scans laid onto other passages; 0: none"""
    map_m: float = 3.0
    """a passage is the scans of so much way on both sides of the nearest one, metres"""
    near_m: float = 3.0
    """a key scan is laid onto other passages this near, metres"""
    partners: int = 3
    """at most so many of each key scan"""
    least_share: float = 0.35
    """of the points that must find a partner"""
    reach_m: float = 0.3
    """partners are looked for as far as this, metres, and ..."""
    shrink: float = 0.7
    """... this share of it in each further round"""
    around_m: float = 3.0
    """every scan is laid onto the key scans this near, metres"""
    around: int = 8
    """at most so many"""
    cell_m: float = 0.1
    """whose points are one where they are nearer than this, metres"""

    def __post_init__(self) -> None:
        check_ranges("", self, rounds=(0, 100), map_m=(0.1, 100.0), near_m=(0.1, 100.0), partners=(0, 100),
                     least_share=(0.0, 1.0),
                     reach_m=(0.02, 10.0), shrink=(0.1, 1.0), around_m=(0.1, 100.0), around=(1, 1000),
                     cell_m=(0.005, 2.0))


@dataclass
class ScanGraphAdvanced:
    """Thresholds of `loop_closer=scan_graph`."""

    windows: Windows = field(default_factory=Windows)
    refinement: Refinement = field(default_factory=Refinement)
    points: PointSettings = field(default_factory=PointSettings)
    agreeing: DriftBounds = field(default_factory=lambda: DriftBounds(0.25, 0.02, 0.06, 0.004))
    map_m: float = 8.0
    """the odometry laid each scan onto those of so much way before, metres"""
    odometry_m: float = 0.02
    """what the odometry is trusted to between two key scans at best (1 sigma), metres"""
    odometry_rad: float = 0.01
    """and radians"""
    odometry_share: float = 0.1
    """and as a share of way and turn"""
    odometry_rad_per_m: float = 0.03
    """and of the heading per metre of way, radians"""
    loose_m: float = 0.5
    """where a scan did not fit (1 sigma), metres"""
    loose_rad: float = 0.3
    """and radians"""
    floor_m: float = 0.03
    """no loop is better than this (1 sigma), metres"""
    floor_rad: float = 0.01
    """and radians"""

    def __post_init__(self) -> None:
        check_ranges("", self, map_m=(0.5, 1000.0), odometry_m=(1e-4, 10.0), odometry_rad=(1e-4, 3.0),
                     odometry_share=(0.0, 10.0), odometry_rad_per_m=(0.0, 10.0), loose_m=(1e-3, 100.0),
                     loose_rad=(1e-3, 3.2),
                     floor_m=(1e-4, 10.0), floor_rad=(1e-4, 3.0))


@dataclass
class ScanGraph:
    """Places that laser scans see again, a pose graph, and every scan laid onto its neighbours. After the survey."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset()

    key_m: float = 0.5
    """A scan is a node of the graph after so much way, metres."""
    key_rad: float = 0.5
    """Or after so much turning, radians."""
    kernel_sigma: float = 3.0
    """Loops that lie further off than this count less and less (Cauchy), sigmas."""
    wrong_over: float = 0.04
    """A map in which beams look through a larger share of the walls of other passages reads wrong: loops are looked for
    again in wider windows."""
    wider: float = 2.0
    """By this factor."""
    tries: int = 2
    """At most so often."""
    advanced: ScanGraphAdvanced = field(default_factory=ScanGraphAdvanced)

    def __post_init__(self) -> None:
        check_ranges("loop_closer.scan_graph", self, key_m=(0.01, 10.0), key_rad=(0.01, 3.2), kernel_sigma=(0.1, 1000.0),
                     wrong_over=(0.0, 1.0), wider=(1.0, 100.0), tries=(0, 100))

    def build(self, context: Context) -> LoopCloser:
        from .closer import ScanGraphCloser

        return ScanGraphCloser(self)
