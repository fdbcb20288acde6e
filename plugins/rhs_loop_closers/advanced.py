"""Thresholds of the loop closers that a user seldom touches: `loop_closer.advanced.name=value`. Light to import."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import check_ranges
from rhs.estimation.filters.settings import Effort
from rhs.estimation.scans.settings import LineSettings, ScanLoopSettings
from rhs.estimation.views.settings import DriftBounds, RansacSettings


@dataclass(frozen=True)
class WallSettings:
    """Straight walls followed from scan to scan; see walls.py. A radian of turning counts as a metre of way."""

    forget_m: float = 6.0
    """a wall is followed over so much way without sight of it, metres"""
    off_m: float = 0.06
    """how far a sighting may lie off the last one, metres"""
    match_sigma: float = 3.0
    """the same for its heading, in sigmas, against the last and the first sighting"""
    drift_rad_per_m: float = 0.005
    """since then the odometry may have turned by so much per metre of way as well, radians"""
    drift_share: float = 0.05
    """and by this share of the turning"""
    gap_m: float = 0.3
    """between the stretches seen, metres"""
    sigma_m: float = 0.01
    """no sighting is better than this, metres (1 sigma): walls are not flat, and depth errs alike in all scans"""
    sigma_deg: float = 0.1
    """nor its direction, degrees (1 sigma)"""
    least: int = 3
    """scans that must see a wall"""
    bend_sigma: float = 3.0
    """a wall whose scans together show more curvature than so many sigmas is bent"""
    bend_per_m: float = 0.03
    """of one that may be bent by more than this too little was seen, 1/m"""
    fit_sigma: float = 3.0
    """a wall whose sightings lie further off than this (rms) after solving is none"""
    blind_m: float = 10.0
    """what no scan shows: where along the wall it is, metres (1 sigma)"""
    lines: LineSettings = field(default_factory=LineSettings)

    def __post_init__(self) -> None:
        check_ranges("", self, forget_m=(0.0, 1e4), off_m=(0.0, 10.0), match_sigma=(0.1, 1000.0), drift_rad_per_m=(0.0, 1.0),
                     drift_share=(0.0, 1.0), gap_m=(0.0, 100.0), sigma_m=(1e-6, 1.0), sigma_deg=(1e-4, 45.0),
                     least=(1, 10_000), bend_sigma=(0.0, 1000.0), bend_per_m=(1e-6, 10.0), fit_sigma=(0.1, 1000.0),
                     blind_m=(0.1, 1e4))


@dataclass
class ClosingAdvanced:
    """What both loop closers share: the check of a pair of views, and what a closure may move."""

    base_m: float = 0.5
    """a closure may move a pose by this at once, beside max_drift_share of the way, metres"""
    ransac: RansacSettings = field(default_factory=RansacSettings)
    depth_share: float = 0.0
    """depths of key-points are wrong by this share of them beside a Kinect's noise (1 sigma), where one camera read them off
    pictures. Loops of the same two stretches of the way then count as one"""

    def __post_init__(self) -> None:
        check_ranges("", self, base_m=(0.0, 1000.0), depth_share=(0.0, 1.0))


@dataclass
class ErrorDistributionAdvanced(ClosingAdvanced):
    """Thresholds of `loop_closer=error_distribution`."""

    min_coverage: float = 0.0
    """least share of the key-points which both views should show that are found again; 0: not asked"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges("", self, min_coverage=(0.0, 1.0))


@dataclass
class PoseGraphAdvanced(ClosingAdvanced):
    """Thresholds of `loop_closer=pose_graph`."""

    apart_m: float = 4.5
    """two views of one place stand at most so far apart, metres; half a metre of drift included"""
    turn_share: float = 0.05
    """odometry may turn by this share too much or too little"""
    edge_sigma_m: float = 0.02
    """a loop is trusted to this much at best, metres (1 sigma): the check's own covariance leaves out what its
    points share"""
    edge_sigma_rad: float = 0.005
    """and its heading, radians (1 sigma)"""
    odometry_probability: float = 1.0
    """chance that a true loop passes the chi-square gate of what the odometry and the loop state; 1: not asked, as
    the drift of most odometries is steady and their stated noise is that of a step"""
    gate_probability: float = 0.999
    """chance that a true loop passes the chi-square gate of the solved graph"""
    level_m: float = 0.05
    """a robot on a floor stays on its plane within this, at each view, metres (1 sigma); 0: nothing is held"""
    level_rad: float = 0.03
    """and upright within this, radians (1 sigma): it sways"""
    most_poses: int = 1000
    """of a survey of more views only so many, evenly spaced, and those that loops and walls hold are nodes of the graph, the
    others go with their neighbours: solving takes 11 kB a node"""
    spread_poses: int = 30
    """at so many poses, evenly spaced, it is said how unsure the solved graph is of them,"""
    motion_share: float = 0.3
    """counting this share of the variance that motions state: the errors of neighbouring ones partly take each other away.
    In eight surveys of plain buildings the squared error of the poses by the stated variance was 0.40 in the mean, at most
    0.70 (1 is honest); with 1 it was 0.21, with 0.15 up to 1.1"""
    drift: DriftBounds = field(default_factory=DriftBounds)
    scan_loops: ScanLoopSettings = field(default_factory=ScanLoopSettings)
    walls: WallSettings = field(default_factory=WallSettings)
    effort: Effort = field(default_factory=lambda: Effort(settled=1e-5))

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges("", self, apart_m=(0.1, 1000.0), turn_share=(0.0, 1.0), edge_sigma_m=(1e-6, 10.0),
                     edge_sigma_rad=(1e-6, 1.0), level_m=(0.0, 10.0), level_rad=(1e-4, 10.0),
                     odometry_probability=(0.5, 1.0), gate_probability=(0.5, 1.0 - 1e-12), most_poses=(2, 10_000_000),
                     spread_poses=(1, 10_000), motion_share=(0.0, 100.0))
