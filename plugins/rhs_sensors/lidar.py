"""The sensor `lidar`: a recorded point cloud of a scanner that looks around in space, handed on as it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import ConfigError, check_ranges

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Sensor


@dataclass
class Lidar:
    """A lidar's point clouds (the extra modality `cloud`) and wheel travel, for recordings; the map is of a band of them."""

    needs: ClassVar[frozenset[str]] = frozenset({"cloud"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "wheel", "command"})

    low_m: float = 0.1
    """the scan is the nearest point on each bearing from this height over the body's origin, metres; above the floor"""
    high_m: float = 1.0
    """up to this height, metres"""
    beams: int = 360
    """beams of the scan, all around"""
    min_range_m: float = 0.5
    """nearer points are the robot itself, metres"""
    max_range_m: float = 50.0
    """further points do not enter the scan, metres"""

    def __post_init__(self) -> None:
        owner = "sensor.lidar"
        check_ranges(owner, self, low_m=(-100.0, 100.0), high_m=(-100.0, 100.0), beams=(8, 10_000),
                     min_range_m=(0.0, 100.0), max_range_m=(0.1, 1000.0))
        for low, high in (("low_m", "high_m"), ("min_range_m", "max_range_m")):
            if getattr(self, low) >= getattr(self, high):
                raise ConfigError(f"{owner}.{low}={getattr(self, low)} is not below {high}={getattr(self, high)}")

    def build(self, context: Context) -> Sensor:
        from .lidar_sensor import LidarSensor

        return LidarSensor(self, context)
