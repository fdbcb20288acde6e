"""Settings of the odometry `corridor_ekf`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import ConfigError, check_choice, check_range

from .advanced import CorridorAdvanced

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Odometry


@dataclass
class CorridorEkf:
    """Monocular, in corridors whose plan is not known: a window of poses and a list of walls, right angles a soft prior."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "walls"})

    motion: str = "command"
    """what predicts the next pose: command, wheel, or none (constant speed and turn rate)"""
    motion_scale_sigma: float = 0.1
    """how wrong the command or wheel distance may be all along, share (1 sigma)"""
    forward_noise: float = 0.04
    """noise of one motion's length, share of it (1 sigma)"""
    turn_noise: float = 0.08
    """noise of one motion's turn, share of it (1 sigma)"""
    speed_mps: float = 0.5
    """motion=none: the speed expected at the start"""
    speed_sigma_mps: float = 0.12
    """motion=none: how wrong the expected speed may be (1 sigma)"""
    height_known: bool = True
    """the camera's height above the floor sets the scale through points of the floor"""
    height_sigma_m: float = 0.01
    """how well the height is known (1 sigma): a tape held beside the robot"""
    width_m: float = 0.0
    """width of the corridors; 0: unknown and constant"""
    width_sigma_m: float = 0.05
    """how well a width that is given is known (1 sigma)"""
    right_angle_sigma_deg: float = 0.5
    """how far walls may be from right angles (1 sigma); 1 for old buildings, 0.17 where a plan promises them"""
    wobble_sigma_deg: float = 0.1
    """pitch and roll of a view (1 sigma): wheels on an ordinary floor; 1.2 for a camera that sways"""
    start_heading_sigma_deg: float = 2.0
    """how well the start heading is known relative to the walls (1 sigma): a robot put down by eye"""
    window: int = 12
    """views a track may span; 10-14 did equally well, 6 loses heading after corners"""
    pixel_sigma_px: float = 1.0
    """noise of a track; five times the residual, as errors along a track go together"""
    points: int = 130
    """points followed at most"""
    save_tracks: bool = False
    """write the survey's tracks to tracks.npz in the run folder, for python -m rhs_odometry"""
    scan_range_m: float = 8.0
    """walls are put into the scan up to this distance"""
    advanced: CorridorAdvanced = field(default_factory=CorridorAdvanced)

    def __post_init__(self) -> None:
        owner = "odometry.corridor_ekf"
        check_choice(owner, "motion", self.motion, ("command", "wheel", "none"))
        for name in ("motion_scale_sigma", "forward_noise", "turn_noise"):
            check_range(owner, name, getattr(self, name), low=1e-4, high=1.0)
        check_range(owner, "speed_mps", self.speed_mps, low=0.0, high=10.0, unit="m/s")
        check_range(owner, "speed_sigma_mps", self.speed_sigma_mps, low=1e-4, high=10.0, unit="m/s")
        check_range(owner, "height_sigma_m", self.height_sigma_m, low=1e-4, high=1.0, unit="m")
        check_range(owner, "width_m", self.width_m, low=0.0, high=50.0, unit="m")
        check_range(owner, "width_sigma_m", self.width_sigma_m, low=1e-4, high=10.0, unit="m")
        for name in ("right_angle_sigma_deg", "wobble_sigma_deg", "start_heading_sigma_deg"):
            check_range(owner, name, getattr(self, name), low=1e-3, high=30.0, unit="degrees")
        check_range(owner, "window", self.window, low=5, high=40)
        check_range(owner, "pixel_sigma_px", self.pixel_sigma_px, low=0.05, high=20.0, unit="px")
        check_range(owner, "points", self.points, low=20, high=400)
        check_range(owner, "scan_range_m", self.scan_range_m, low=0.5, high=50.0, unit="m")
        if self.advanced.least_views > self.window:
            raise ConfigError(f"{owner}.advanced.least_views={self.advanced.least_views} is above window={self.window}")
        if self.motion == "none" and not self.height_known and self.width_m == 0.0:
            raise ConfigError(f"{owner}: nothing fixes the scale with motion=none, height_known=false and width_m=0; "
                              "give one of them")

    def build(self, context: Context) -> Odometry:
        from .ekf import build_corridor_ekf

        return build_corridor_ekf(self, context)
