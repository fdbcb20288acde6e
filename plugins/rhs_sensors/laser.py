"""The sensor `laser`: a laser scan and wheel travel; of a recording, handed on as they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import ConfigError, check_ranges

from .wheeled import Wheeled

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Sensor


@dataclass
class Laser(Wheeled):
    """A laser scanner and wheel encoders, no camera: of recordings (CARMEN logs, bags with LaserScan), or simulated."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "wheel", "command"})

    range_sigma_m: float = 0.01
    """noise of each range, metres (1 sigma); 0.01: a Hokuyo UTM-30LX"""
    min_range_m: float = 0.05
    """nearer readings are unknown, metres (dirt and the robot itself)"""
    max_range_m: float = 30.0
    """readings beyond this say only that nothing is nearer, metres"""

    def __post_init__(self) -> None:
        owner = "sensor.laser"
        check_ranges(owner, self, range_sigma_m=(0.0, 10.0), min_range_m=(0.0, 100.0), max_range_m=(0.1, 1000.0))
        if self.min_range_m >= self.max_range_m:
            raise ConfigError(f"{owner}.min_range_m={self.min_range_m} is not below max_range_m={self.max_range_m}")
        self.check_wheels(owner)

    def build(self, context: Context) -> Sensor:
        from .laser_sensor import LaserSensor

        return LaserSensor(self, context)
