"""Settings of the odometries `section_ekf` and `tube_ekf`: the thesis's filter, with a rectangular or a round section."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import ConfigError, check_range, check_ranges

from ..tracks.settings import AlarmSettings, FollowOnly


@dataclass
class SectionAdvanced:
    """Thresholds of `odometry=section_ekf` and `odometry=tube_ekf`."""

    spin_sigma_radps: float = 0.1
    """turn rate at the start, rad/s (1 sigma)"""
    centre_sigma_m: float = 0.01
    """where the middle of the section is at the start, metres (1 sigma)"""
    axis_sigma_rad: float = 0.005
    """its direction at the start, radians (1 sigma)"""
    centre_walk_m: float = 0.002
    """change of the section's middle per view, metres (1 sigma): keeps it adjustable"""
    axis_walk_rad: float = 0.0005
    """change of its direction per view, radians (1 sigma)"""
    farthest_m: float = 15.0
    """points further along the tube are not used, metres: they say little and are the first to lie on something else"""
    gate_probability: float = 0.99
    """chance that a true point passes its chi-square gate"""
    few_tracks: int = 8
    """fewer followed points than this and the view says nothing: lost"""
    line_m: float = 12.0
    """the sketch draws the walls that far ahead and behind, metres (thesis 5.7: two parallel lines per step)"""
    alarm_views: int = 12
    """views a point is followed before its own depth is compared with the section's"""
    strong_share: float = 0.1
    """a point has a depth of its own when its inverse depth is known better than this share of it (1 sigma)"""
    stray_sigmas: float = 3.0
    """it does not lie on the section when it is off by more than so many sigmas"""
    stray_share: float = 0.1
    """and this share of its inverse depth"""
    doubt: float = 10.0
    """where the section ends the filter's sigmas count so many times"""
    alarm: AlarmSettings = field(default_factory=AlarmSettings)
    follow: FollowOnly = field(default_factory=FollowOnly)

    def __post_init__(self) -> None:
        check_ranges("", self, spin_sigma_radps=(1e-6, 10.0), centre_sigma_m=(1e-6, 10.0), axis_sigma_rad=(1e-6, 3.0),
                     centre_walk_m=(0.0, 10.0), axis_walk_rad=(0.0, 3.0), farthest_m=(0.1, 1e4),
                     gate_probability=(0.5, 1.0 - 1e-12), few_tracks=(0, 10_000), line_m=(0.1, 1000.0), alarm_views=(4, 100),
                     strong_share=(0.0, 10.0), stray_sigmas=(0.0, 1000.0), stray_share=(0.0, 10.0), doubt=(1.0, 1000.0))


@dataclass
class SectionEkf:
    """The thesis's filter (chapter 4): constant velocity and one straight section, here rectangular (section 4.4)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "walls"})

    half_size_m: float = 1.0
    """half the width of the corridor; the only thing that fixes the scale"""
    size_sigma: float = 0.005
    """how well the size is known, share (1 sigma of its logarithm)"""
    aspect: float = 1.25
    """height over width of the section"""
    speed_mps: float = 0.5
    """speed expected at the start"""
    speed_sigma_mps: float = 0.12
    """how wrong the expected speed may be (1 sigma)"""
    drift_sigma_mps: float = 0.03
    """how fast the camera may move sideways or up and down at the start (1 sigma)"""
    speed_walk_mps: float = 0.04
    """change of speed per view (1 sigma)"""
    turn_walk_radps: float = 0.04
    """change of turn rate per view (1 sigma)"""
    start_error_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """start wrongly: forward, left, up"""
    start_error_deg: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """start wrongly: roll, pitch, yaw"""
    start_sigma_m: float = 0.05
    """how wrong the filter thinks its start may be (1 sigma)"""
    start_sigma_deg: float = 2.0
    """how wrong the filter thinks each start angle may be (1 sigma)"""
    pixel_sigma_px: float = 0.7
    """noise of a followed point (1 sigma)"""
    iterations: int = 1
    """linearisations per view: 1 is the thesis; 3 forgets a wrong start of 10 degrees sooner"""
    pairs: int = 60
    """points used per view at most: the state stays as it is, the time grows"""
    points: int = 130
    """points followed at most"""
    save_tracks: bool = False
    """write the survey's tracks to tracks.npz in the run folder, for python -m rhs_odometry"""
    scan_range_m: float = 8.0
    """the walls are put into the scan up to this distance"""
    advanced: SectionAdvanced = field(default_factory=SectionAdvanced)

    owner: ClassVar[str] = "odometry.section_ekf"
    shape: ClassVar[str] = "rectangular"

    def __post_init__(self) -> None:
        check_ranges(self.owner, self, half_size_m=(0.1, 50.0), size_sigma=(1e-4, 3.0), aspect=(0.1, 10.0),
                     speed_mps=(0.0, 10.0), speed_sigma_mps=(1e-4, 10.0), drift_sigma_mps=(1e-4, 10.0),
                     speed_walk_mps=(1e-5, 10.0), turn_walk_radps=(1e-5, 10.0), start_sigma_m=(1e-4, 10.0),
                     start_sigma_deg=(1e-3, 90.0), pixel_sigma_px=(0.05, 20.0), iterations=(1, 20), pairs=(8, 400),
                     points=(20, 400), scan_range_m=(0.5, 50.0))
        for name, limit in (("start_error_m", 10.0), ("start_error_deg", 90.0)):
            values = getattr(self, name)
            if len(values) != 3:
                raise ConfigError(f"{self.owner}.{name}={list(values)} has {len(values)} numbers, expected 3")
            for value in values:
                check_range(self.owner, name, value, low=-limit, high=limit)

    def build(self, context: Context) -> Odometry:
        from .ekf import build_section_ekf

        return build_section_ekf(self, context)


@dataclass
class TubeEkf(SectionEkf):
    """The thesis's filter (chapter 4): constant velocity and one straight round tube with logarithmic radius."""

    half_size_m: float = 1.12
    """radius of the tube; that of a circle with the perimeter's mean for a 2 x 2.5 m corridor"""

    owner: ClassVar[str] = "odometry.tube_ekf"
    shape: ClassVar[str] = "round"
