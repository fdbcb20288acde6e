"""The sensor `laser`: a recorded laser scan and wheel travel, handed on as they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import ConfigError, check_range

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Sensor


@dataclass
class Laser:
    """A laser scanner and wheel encoders without a camera, for recordings (CARMEN logs, bags with LaserScan)."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "wheel", "command"})

    min_range_m: float = 0.05
    """nearer readings are unknown, metres (dirt and the robot itself)"""
    max_range_m: float = 30.0
    """readings beyond this say only that nothing is nearer, metres"""

    def __post_init__(self) -> None:
        owner = "sensor.laser"
        check_range(owner, "min_range_m", self.min_range_m, low=0.0, high=100.0, unit="m")
        check_range(owner, "max_range_m", self.max_range_m, low=0.1, high=1000.0, unit="m")
        if self.min_range_m >= self.max_range_m:
            raise ConfigError(f"{owner}.min_range_m={self.min_range_m} is not below max_range_m={self.max_range_m}")

    def build(self, context: Context) -> Sensor:
        from .laser_sensor import LaserSensor

        return LaserSensor(self, context)
