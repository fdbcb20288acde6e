"""The sensor `laser`: a laser scan and wheel travel; of a recording, handed on as they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Sensor
from rhs.api.errors import ContractError, within
from rhs.api.frozen import freeze
from rhs.api.records import Capture, Observation, Scan

from .degrade import Encoders, Wheeled


@dataclass
class Laser(Wheeled):
    """A laser scanner and wheel encoders, no camera: of recordings (CARMEN logs, bags with LaserScan), or simulated."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "wheel", "command"})

    range_sigma_m: float = within(0.01, 0.0, 10.0)
    """noise of each range, metres (1 sigma); 0.01: a Hokuyo UTM-30LX"""
    min_range_m: float = within(0.05, 0.0, 100.0, below="max_range_m")
    """nearer readings are unknown, metres (dirt and the robot itself)"""
    max_range_m: float = within(30.0, 0.1, 1000.0)
    """readings beyond this say only that nothing is nearer, metres"""

    def build(self, context: Context) -> Sensor:
        return LaserSensor(self, context)


class LaserSensor:
    """Scan and wheel travel; a recording has put its own noise on both. Each noise has its own random stream."""

    senses_ahead = True

    def __init__(self, settings: Laser, context: Context) -> None:
        self._settings, self._camera = settings, context.camera
        self._range_rng, wheel_rng = context.rng.spawn(2)
        self._encoders = Encoders(settings, wheel_rng)

    def sense(self, capture: Capture) -> Observation:
        if capture.scan is None:
            raise ContractError(f"capture {capture.index} has no laser scan; sensor=laser needs a recording with one, or "
                                "source.laser_beams of the simulator")
        return Observation(
            capture.index, capture.stamp_s, self._camera,
            scan=self._measured(capture.scan, exact=capture.sensed), command=capture.command,
            wheel=self._encoders.read(capture.travel, exact=capture.sensed),
        )

    def _measured(self, scan: Scan, *, exact: bool) -> Scan:
        """The scan with noise, and with readings out of range made unknown (near) or free (far)."""
        settings, ranges = self._settings, scan.ranges_m
        reach = min(settings.max_range_m, scan.max_range_m)
        if settings.noise and not exact:
            ranges = ranges + settings.range_sigma_m * self._range_rng.standard_normal(len(ranges))
        with np.errstate(invalid="ignore"):
            ranges = np.where(ranges < settings.min_range_m, np.nan, ranges)
            ranges = np.where(ranges > reach, np.inf, ranges)
        return Scan(scan.bearings_rad, freeze(ranges), reach, scan.origin_xy_m)
