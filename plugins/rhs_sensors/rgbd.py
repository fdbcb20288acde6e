"""Settings of the sensor `rgbd`: a Kinect-like colour and depth camera on a robot with wheel encoders."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Sensor
from rhs.api.errors import ConfigError, within
from rhs.estimation.scans.settings import BandSettings
from rhs.estimation.views.settings import DepthNoiseSettings

from .degrade import Wheeled


@dataclass
class RgbdAdvanced:
    """Thresholds of `sensor=rgbd`."""

    obstacle: BandSettings = field(default_factory=BandSettings)
    depth_noise: DepthNoiseSettings = field(default_factory=DepthNoiseSettings)


@dataclass
class Rgbd(Wheeled):
    """Colour, depth, the scan in the depth row at the camera's height and the nearest thing between floor and robot's
    height, with the noise of a Kinect."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "gray", "depth", "scan", "wheel", "command"})

    min_range_m: float = within(0.4, 0.0, 100.0, below="max_range_m")
    """nearer depths are unknown, metres along the optical axis (Kinect: 0.4)"""
    max_range_m: float = within(8.0, 0.1, 1000.0)
    """further depths are unknown, metres (Kinect: 8)"""
    depth_noise: float = within(1.0, 0.0, 1000.0)
    """deviation of the noise of depth, times that of a Kinect; nobody is told, the parts measure it in the views"""
    depth_constant_m: float = within(0.0012, 0.0, 1.0)
    """sigma_z = constant + quadratic * (z - 0.4 m)^2, metres (Nguyen 2012, Kinect)"""
    depth_quadratic_per_m: float = within(0.0019, 0.0, 1.0)
    """the quadratic part of sigma_z, 1/m (Nguyen 2012, Kinect); see depth_constant_m"""
    disparity_step_px: float = within(0.125, 0.0, 10.0)
    """disparity is reported in steps of this many pixels (Kinect: 1/8); 0 = exact"""
    disparity_m_px: float = within(43.5, 0.1, 10_000.0, unit="m px")
    """focal length times baseline, metre pixels (Kinect: 580 px * 0.075 m)"""
    image_sigma: float = within(2.0, 0.0, 255.0)
    """noise of each colour channel, grey levels of 255 (1 sigma)"""
    beams: int = within(0, 0, 10_000)
    """beams of the scan, evenly spaced columns; 0 = one per image column"""
    scan_rows: int = within(1, 1, 99)
    """odd number of rows around the camera's height whose median is the scan; 1 = the thesis"""
    advanced: RgbdAdvanced = field(default_factory=RgbdAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scan_rows % 2 == 0:
            raise ConfigError(f"scan_rows={self.scan_rows} is even; expected an odd number such as 1 or 3")

    def build(self, context: Context) -> Sensor:
        from .rgbd_sensor import RgbdSensor

        return RgbdSensor(self, context)
