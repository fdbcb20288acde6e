"""Settings of the odometries `section_ekf` and `tube_ekf`: the thesis's filter, with a rectangular or a round section."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import Bounded, ConfigError, check_range, within

from ..tracks.settings import AlarmSettings, FollowOnly


@dataclass
class SectionAdvanced(Bounded):
    """Thresholds of `odometry=section_ekf` and `odometry=tube_ekf`."""

    spin_sigma_radps: float = within(0.1, 1e-6, 10.0)
    """turn rate at the start, rad/s (1 sigma)"""
    centre_sigma_m: float = within(0.01, 1e-6, 10.0)
    """where the middle of the section is at the start, metres (1 sigma)"""
    axis_sigma_rad: float = within(0.005, 1e-6, 3.0)
    """its direction at the start, radians (1 sigma)"""
    centre_walk_m: float = within(0.002, 0.0, 10.0)
    """change of the section's middle per view, metres (1 sigma): keeps it adjustable"""
    axis_walk_rad: float = within(0.0005, 0.0, 3.0)
    """change of its direction per view, radians (1 sigma)"""
    farthest_m: float = within(15.0, 0.1, 1e4)
    """points further along the tube are not used, metres: they say little and are the first to lie on something else"""
    gate_probability: float = within(0.99, 0.5, 1.0 - 1e-12)
    """chance that a true point passes its chi-square gate"""
    few_tracks: int = within(8, 0, 10_000)
    """fewer followed points than this and the view says nothing: lost"""
    line_m: float = within(12.0, 0.1, 1000.0)
    """the sketch draws the walls that far ahead and behind, metres (thesis 5.7: two parallel lines per step)"""
    alarm_views: int = within(12, 4, 100)
    """views a point is followed before its own depth is compared with the section's"""
    strong_share: float = within(0.1, 0.0, 10.0)
    """a point has a depth of its own when its inverse depth is known better than this share of it (1 sigma)"""
    stray_sigmas: float = within(3.0, 0.0, 1000.0)
    """it does not lie on the section when it is off by more than so many sigmas"""
    stray_share: float = within(0.1, 0.0, 10.0)
    """and this share of its inverse depth"""
    doubt: float = within(10.0, 1.0, 1000.0)
    """where the section ends the filter's sigmas count so many times"""
    alarm: AlarmSettings = field(default_factory=AlarmSettings)
    follow: FollowOnly = field(default_factory=FollowOnly)


@dataclass
class SectionEkf(Bounded):
    """The thesis's filter (chapter 4): constant velocity and one straight section, here rectangular (section 4.4)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "walls"})

    half_size_m: float = within(1.0, 0.1, 50.0)
    """half the width of the corridor; the only thing that fixes the scale"""
    size_sigma: float = within(0.005, 1e-4, 3.0)
    """how well the size is known, share (1 sigma of its logarithm)"""
    aspect: float = within(1.25, 0.1, 10.0)
    """height over width of the section"""
    speed_mps: float = within(0.5, 0.0, 10.0)
    """speed expected at the start"""
    speed_sigma_mps: float = within(0.12, 1e-4, 10.0)
    """how wrong the expected speed may be (1 sigma)"""
    drift_sigma_mps: float = within(0.03, 1e-4, 10.0)
    """how fast the camera may move sideways or up and down at the start (1 sigma)"""
    speed_walk_mps: float = within(0.04, 1e-5, 10.0)
    """change of speed per view (1 sigma)"""
    turn_walk_radps: float = within(0.04, 1e-5, 10.0)
    """change of turn rate per view (1 sigma)"""
    start_error_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """start wrongly: forward, left, up"""
    start_error_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """start wrongly: roll, pitch, yaw"""
    start_sigma_m: float = within(0.05, 1e-4, 10.0)
    """how wrong the filter thinks its start may be (1 sigma)"""
    start_sigma_deg: float = within(2.0, 1e-3, 90.0)
    """how wrong the filter thinks each start angle may be (1 sigma)"""
    pixel_sigma_px: float = within(0.7, 0.05, 20.0)
    """noise of a followed point (1 sigma)"""
    iterations: int = within(1, 1, 20)
    """linearisations per view: 1 is the thesis; 3 forgets a wrong start of 10 degrees sooner"""
    pairs: int = within(60, 8, 400)
    """points used per view at most: the state stays as it is, the time grows"""
    points: int = within(130, 20, 400)
    """points followed at most"""
    save_tracks: bool = False
    """write the survey's tracks to tracks.npz in the run folder, for python -m rhs_odometry"""
    scan_range_m: float = within(8.0, 0.5, 50.0)
    """the walls are put into the scan up to this distance"""
    advanced: SectionAdvanced = field(default_factory=SectionAdvanced)

    shape: ClassVar[str] = "rectangular"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, limit in (("start_error_m", 10.0), ("start_error_deg", 90.0)):
            values = getattr(self, name)
            if len(values) != 3:
                raise ConfigError(f"{name}={list(values)} has {len(values)} numbers, expected 3")
            for value in values:
                check_range("", name, value, low=-limit, high=limit)

    def build(self, context: Context) -> Odometry:
        from .ekf import build_section_ekf

        return build_section_ekf(self, context)


@dataclass
class TubeEkf(SectionEkf):
    """The thesis's filter (chapter 4): constant velocity and one straight round tube with logarithmic radius."""

    half_size_m: float = 1.12
    """radius of the tube; that of a circle with the perimeter's mean for a 2 x 2.5 m corridor"""

    shape: ClassVar[str] = "round"
