"""Settings of the odometry `scan_to_map`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry, PartSettings
from rhs.api.errors import Bounded, within
from rhs.estimation.scans.settings import PointSettings


@dataclass(frozen=True)
class Prediction(Bounded):
    """Where the next scan is looked for, and how far the wheels are believed. All 1 sigma."""

    least_m: float = within(0.04, 1e-6, 10.0)
    """error of the wheels since the last scan they were held against, metres"""
    least_rad: float = within(0.02, 1e-6, 3.0)
    """and of their heading, radians"""
    share: float = within(0.2, 0.0, 10.0)
    """the same as a share of way and turn"""
    rad_per_m: float = within(0.06, 0.0, 10.0)
    """and of the heading per metre of way, radians"""
    blind_m: float = within(0.15, 1e-3, 10.0)
    """where the wheels say nothing (their reading hangs, leaps, or there is none), metres"""
    blind_rad: float = within(0.15, 1e-3, 3.0)
    """and radians"""
    speed_change_mps: float = within(2.0, 0.01, 1000.0)
    """wheels that say that the speed changed by more than this between two scans have leapt"""
    turn_radps: float = within(5.0, 0.01, 1000.0)
    """so have wheels that turn faster than this since the last scan they were held against"""


@dataclass(frozen=True)
class Rescue(Bounded):
    """What is done where a scan does not fit where it was looked for."""

    least_share: float = within(0.55, 0.0, 1.0)
    """of the points that need a partner in the map, or the fit is poor"""
    typical_share: float = within(0.85, 0.0, 1.0)
    """and of what is usual of late"""
    better: float = within(0.1, 0.0, 1.0)
    """another place must explain this share more"""
    sure_share: float = within(0.7, 0.0, 1.0)
    """and at least this share of the points"""
    window_m: float = within(0.8, 0.0, 100.0)
    """searched to either side, metres"""
    window_rad: float = within(1.0, 0.0, 3.2)
    """and turned either way, radians"""
    cell_m: float = within(0.05, 0.005, 1.0)
    """cells of the search, metres"""
    step_rad: float = within(0.03, 1e-3, 1.0)
    """its steps in heading, radians"""
    doubt_m: float = within(0.5, 0.0, 100.0)
    """a rescue further than this from where the scan was looked for waits for the next scan to confirm it, metres"""
    doubt_rad: float = within(0.6, 0.0, 4.0)
    """the same, radians"""
    patience: int = within(8, 1, 10_000)
    """after so many poor scans on end the map goes on from where the robot is believed"""


@dataclass
class ScanToMapAdvanced:
    """Thresholds of `odometry=scan_to_map`."""

    prediction: Prediction = field(default_factory=Prediction)
    rescue: Rescue = field(default_factory=Rescue)
    points: PointSettings = field(default_factory=PointSettings)


@dataclass
class ScanToMap(PartSettings):
    """Laser scans laid onto a map of the last key scans, point to line; wheels say where to look, if there are any."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})

    key_m: float = within(0.3, 0.01, 10.0)
    """A scan becomes part of the map after so much way, metres."""
    key_rad: float = within(0.35, 0.01, 3.2)
    """Or after so much turning, radians."""
    map_m: float = within(8.0, 0.5, 1000.0)
    """The map is made of the scans of so much way, metres."""
    map_scans: int = within(30, 1, 1000)
    """And of at most so many."""
    advanced: ScanToMapAdvanced = field(default_factory=ScanToMapAdvanced)

    def build(self, context: Context) -> Odometry:
        from .odometry import ScanToMapOdometry

        return ScanToMapOdometry(self)
