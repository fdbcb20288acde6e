"""Settings of the sensor `stereo`: two colour cameras side by side on a robot with wheel encoders."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Sensor
from rhs.api.errors import Bounded, ConfigError, within
from rhs.estimation.scans.settings import BandSettings, FloorEndSettings

from .degrade import Wheeled


@dataclass
class StereoAdvanced(Bounded):
    """Thresholds of `sensor=stereo`."""

    step_penalty: float = within(8.0, 0.0, 1e4, below="jump_penalty")
    """P1 of semi-global matching: of a disparity that differs by 1 from its neighbour's, grey levels times the block's
    pixels (OpenCV's example)"""
    jump_penalty: float = within(32.0, 0.0, 1e4)
    """P2, of one that differs by more"""
    speckle_px: int = within(60, 0, 100_000)
    """smaller islands of disparity are unknown, pixels of an image 320 wide; grows with the image"""
    texture_half_px: int = within(4, 0, 50)
    """texture is measured in a square of this half side, pixels"""
    coarser: int = within(4, 0, 16)
    """obstacles without texture enough are looked for in images so many times smaller too; 0: nowhere"""
    obstacle: BandSettings = field(default_factory=lambda: BandSettings(floor_m=0.1, floor_per_m=0.05, range_m=3.0))
    floor_end: FloorEndSettings = field(default_factory=FloorEndSettings)


@dataclass
class Stereo(Wheeled):
    """Two cameras side by side: depth from their disparity where there is texture, and the scans that a depth camera gives;
    unknown is NaN."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "right_image"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "gray", "depth", "scan", "wheel", "command"})

    image_sigma: float = within(2.0, 0.0, 255.0)
    """noise of each colour channel of both images, grey levels of 255 (1 sigma)"""
    disparity_sigma_px: float = within(0.3, 0.01, 10.0)
    """how well a disparity is known, pixels (1 sigma): depth z is known to sigma_z = z^2 / (f b) of it, f pixels, b metres
    from eye to eye. Only for how far depth is believed: see depth_error_share"""
    depth_error_share: float = within(0.1, 0.001, 1.0)
    """depth is unknown beyond where sigma_z is this share of it: z = depth_error_share f b / disparity_sigma_px"""
    max_range_m: float = within(0.0, 0.0, 1000.0)
    """and beyond this, metres; 0: no other limit"""
    min_range_m: float = within(0.4, 0.01, 100.0)
    """nearer things are not looked for, metres; see search_share"""
    search_share: float = within(0.2, 0.01, 0.9)
    """disparities are looked for up to this share of the image's width at most: the time that takes grows with it"""
    block_px: int = within(5, 1, 31)
    """side of the block that is compared, pixels, odd"""
    uniqueness_percent: int = within(10, 0, 99)
    """a disparity is unknown unless it is better by this many per cent than any other"""
    left_right_px: int = within(1, 0, 100)
    """a disparity is unknown when the one found from the right image differs by more, pixels"""
    texture: float = within(1.5, 0.0, 255.0)
    """root mean square of the slope of grey along the row, grey levels a pixel, below which depth is unknown: a blank wall
    has none to be found. Noise of image_sigma=2 alone makes 1.0"""
    beams: int = within(0, 0, 10_000)
    """beams of the scan, evenly spaced columns; 0 = one per image column"""
    scan_rows: int = within(5, 1, 99)
    """odd number of rows around the camera's height whose median is the scan"""
    advanced: StereoAdvanced = field(default_factory=StereoAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("block_px", "scan_rows"):
            if getattr(self, name) % 2 == 0:
                raise ConfigError(f"{name}={getattr(self, name)} is even; expected an odd number such as 3 or 5")

    def build(self, context: Context) -> Sensor:
        from .stereo_sensor import StereoSensor

        return StereoSensor(self, context)
