"""Settings of the odometry `corridor_ekf`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import Bounded, ConfigError, one_of, within

from .advanced import CorridorAdvanced


@dataclass
class CorridorEkf(Bounded):
    """Monocular, in corridors whose plan is not known: a window of poses and a list of walls, right angles a soft prior."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "walls"})

    motion: str = one_of("command", "wheel", "none")
    """what predicts the next pose: command, wheel, or none (constant speed and turn rate)"""
    motion_scale_sigma: float = within(0.1, 1e-4, 1.0)
    """how wrong the command or wheel distance may be all along, share (1 sigma)"""
    forward_noise: float = within(0.04, 1e-4, 1.0)
    """noise of one motion's length, share of it (1 sigma)"""
    turn_noise: float = within(0.08, 1e-4, 1.0)
    """noise of one motion's turn, share of it (1 sigma)"""
    speed_mps: float = within(0.5, 0.0, 10.0)
    """motion=none: the speed expected at the start"""
    speed_sigma_mps: float = within(0.12, 1e-4, 10.0)
    """motion=none: how wrong the expected speed may be (1 sigma)"""
    height_known: bool = True
    """the camera's height above the floor sets the scale through points of the floor"""
    height_sigma_m: float = within(0.01, 1e-4, 1.0)
    """how well the height is known (1 sigma): a tape held beside the robot"""
    width_m: float = within(0.0, 0.0, 50.0)
    """width of the corridors; 0: unknown and constant"""
    width_sigma_m: float = within(0.05, 1e-4, 10.0)
    """how well a width that is given is known (1 sigma)"""
    right_angle_sigma_deg: float = within(0.5, 1e-3, 30.0)
    """how far walls may be from right angles (1 sigma); 1 for old buildings, 0.17 where a plan promises them"""
    wobble_sigma_deg: float = within(0.1, 1e-3, 30.0)
    """pitch and roll of a view (1 sigma): wheels on an ordinary floor; 1.2 for a camera that sways"""
    start_heading_sigma_deg: float = within(2.0, 1e-3, 30.0)
    """how well the start heading is known relative to the walls (1 sigma): a robot put down by eye"""
    window: int = within(12, 5, 40)
    """views a track may span; 10-14 did equally well, 6 loses heading after corners"""
    pixel_sigma_px: float = within(1.0, 0.05, 20.0)
    """noise of a track; five times the residual, as errors along a track go together"""
    points: int = within(130, 20, 400)
    """points followed at most"""
    save_tracks: bool = False
    """write the survey's tracks to tracks.npz in the run folder, for python -m rhs_odometry"""
    scan_range_m: float = within(8.0, 0.5, 50.0)
    """walls are put into the scan up to this distance"""
    advanced: CorridorAdvanced = field(default_factory=CorridorAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.advanced.least_views > self.window:
            raise ConfigError(f"advanced.least_views={self.advanced.least_views} is above window={self.window}")
        if self.motion == "none" and not self.height_known and self.width_m == 0.0:
            raise ConfigError("motion=none: nothing fixes the scale with height_known=false and width_m=0; give one of them")

    def build(self, context: Context) -> Odometry:
        from .ekf import build_corridor_ekf

        return build_corridor_ekf(self, context)
