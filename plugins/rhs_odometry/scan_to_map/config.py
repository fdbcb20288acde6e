"""Settings of the odometry `scan_to_map`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import check_ranges
from rhs.estimation.scans.settings import PointSettings


@dataclass(frozen=True)
class Prediction:
    """Where the next scan is looked for, and how far the wheels are believed. All 1 sigma."""

    least_m: float = 0.04
    """error of the wheels since the last scan they were held against, metres"""
    least_rad: float = 0.02
    """and of their heading, radians"""
    share: float = 0.2
    """the same as a share of way and turn"""
    rad_per_m: float = 0.06
    """and of the heading per metre of way, radians"""
    blind_m: float = 0.15
    """where the wheels say nothing (their reading hangs, leaps, or there is none), metres"""
    blind_rad: float = 0.15
    """and radians"""
    speed_change_mps: float = 2.0
    """wheels that say that the speed changed by more than this between two scans have leapt"""
    turn_radps: float = 5.0
    """so have wheels that turn faster than this since the last scan they were held against"""

    def __post_init__(self) -> None:
        check_ranges("", self, least_m=(1e-6, 10.0), least_rad=(1e-6, 3.0), share=(0.0, 10.0), rad_per_m=(0.0, 10.0),
                     blind_m=(1e-3, 10.0), blind_rad=(1e-3, 3.0), speed_change_mps=(0.01, 1000.0), turn_radps=(0.01, 1000.0))


@dataclass(frozen=True)
class Rescue:
    """What is done where a scan does not fit where it was looked for."""

    least_share: float = 0.55
    """of the points that need a partner in the map, or the fit is poor"""
    typical_share: float = 0.85
    """and of what is usual of late"""
    better: float = 0.1
    """another place must explain this share more"""
    sure_share: float = 0.7
    """and at least this share of the points"""
    window_m: float = 0.8
    """searched to either side, metres"""
    window_rad: float = 1.0
    """and turned either way, radians"""
    cell_m: float = 0.05
    """cells of the search, metres"""
    step_rad: float = 0.03
    """its steps in heading, radians"""
    doubt_m: float = 0.5
    """a rescue further than this from where the scan was looked for waits for the next scan to confirm it, metres"""
    doubt_rad: float = 0.6
    """the same, radians"""
    patience: int = 8
    """after so many poor scans on end the map goes on from where the robot is believed"""

    def __post_init__(self) -> None:
        check_ranges("", self, least_share=(0.0, 1.0), typical_share=(0.0, 1.0), better=(0.0, 1.0), sure_share=(0.0, 1.0),
                     window_m=(0.0, 100.0), window_rad=(0.0, 3.2), cell_m=(0.005, 1.0), step_rad=(1e-3, 1.0),
                     doubt_m=(0.0, 100.0), doubt_rad=(0.0, 4.0), patience=(1, 10_000))


@dataclass
class ScanToMapAdvanced:
    """Thresholds of `odometry=scan_to_map`."""

    prediction: Prediction = field(default_factory=Prediction)
    rescue: Rescue = field(default_factory=Rescue)
    points: PointSettings = field(default_factory=PointSettings)


@dataclass
class ScanToMap:
    """Laser scans laid onto a map of the last key scans, point to line; wheels say where to look, if there are any."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset()

    key_m: float = 0.3
    """A scan becomes part of the map after so much way, metres."""
    key_rad: float = 0.35
    """Or after so much turning, radians."""
    map_m: float = 8.0
    """The map is made of the scans of so much way, metres."""
    map_scans: int = 30
    """And of at most so many."""
    advanced: ScanToMapAdvanced = field(default_factory=ScanToMapAdvanced)

    def __post_init__(self) -> None:
        check_ranges("odometry.scan_to_map", self, key_m=(0.01, 10.0), key_rad=(0.01, 3.2), map_m=(0.5, 1000.0),
                     map_scans=(1, 1000))

    def build(self, context: Context) -> Odometry:
        from .odometry import ScanToMapOdometry

        return ScanToMapOdometry(self)
