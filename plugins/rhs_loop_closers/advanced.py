"""Thresholds of the loop closers that a user seldom touches: `loop_closer.advanced.name=value`. Light to import."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import Bounded, within
from rhs.estimation.filters.settings import Effort
from rhs.estimation.scans.settings import LineSettings, ScanLoopSettings
from rhs.estimation.views.settings import DriftBounds, RansacSettings


@dataclass(frozen=True)
class WallSettings(Bounded):
    """Straight walls followed from scan to scan; see walls.py. A radian of turning counts as a metre of way."""

    forget_m: float = within(6.0, 0.0, 1e4)
    """a wall is followed over so much way without sight of it, metres"""
    off_m: float = within(0.06, 0.0, 10.0)
    """how far a sighting may lie off the last one, metres"""
    match_sigma: float = within(3.0, 0.1, 1000.0)
    """the same for its heading, in sigmas, against the last and the first sighting"""
    drift_rad_per_m: float = within(0.005, 0.0, 1.0)
    """since then the odometry may have turned by so much per metre of way as well, radians"""
    drift_share: float = within(0.05, 0.0, 1.0)
    """and by this share of the turning"""
    gap_m: float = within(0.3, 0.0, 100.0)
    """between the stretches seen, metres"""
    sigma_m: float = within(0.01, 1e-6, 1.0)
    """no sighting is better than this, metres (1 sigma): walls are not flat, and depth errs alike in all scans"""
    sigma_deg: float = within(0.1, 1e-4, 45.0)
    """nor its direction, degrees (1 sigma)"""
    least: int = within(3, 1, 10_000)
    """scans that must see a wall"""
    bend_sigma: float = within(3.0, 0.0, 1000.0)
    """a wall whose scans together show more curvature than so many sigmas is bent"""
    bend_per_m: float = within(0.03, 1e-6, 10.0)
    """of one that may be bent by more than this too little was seen, 1/m"""
    fit_sigma: float = within(3.0, 0.1, 1000.0)
    """a wall whose sightings lie further off than this (rms) after solving is none"""
    blind_m: float = within(10.0, 0.1, 1e4)
    """what no scan shows: where along the wall it is, metres (1 sigma)"""
    lines: LineSettings = field(default_factory=LineSettings)


@dataclass
class ClosingAdvanced(Bounded):
    """What both loop closers share: the check of a pair of views, and what a closure may move."""

    base_m: float = within(0.5, 0.0, 1000.0)
    """a closure may move a pose by this at once, beside max_drift_share of the way, metres"""
    ransac: RansacSettings = field(default_factory=RansacSettings)
    depth_share: float = within(0.0, 0.0, 1.0)
    """depths of key-points are wrong by this share of them beside a Kinect's noise (1 sigma), where one camera read them off
    pictures. Loops of the same two stretches of the way then count as one"""


@dataclass
class PoseGraphAdvanced(ClosingAdvanced):
    """Thresholds of `loop_closer=pose_graph`."""

    apart_m: float = within(4.5, 0.1, 1000.0)
    """two views of one place stand at most so far apart, metres; half a metre of drift included"""
    turn_share: float = within(0.05, 0.0, 1.0)
    """odometry may turn by this share too much or too little"""
    edge_sigma_m: float = within(0.02, 1e-6, 10.0)
    """a loop is trusted to this much at best, metres (1 sigma): the check's own covariance leaves out what its
    points share"""
    edge_sigma_rad: float = within(0.005, 1e-6, 1.0)
    """and its heading, radians (1 sigma)"""
    odometry_probability: float = within(1.0, 0.5, 1.0)
    """chance that a true loop passes the chi-square gate of what the odometry and the loop state; 1: not asked, as
    the drift of most odometries is steady and their stated noise is that of a step"""
    gate_probability: float = within(0.999, 0.5, 1.0 - 1e-12)
    """chance that a true loop passes the chi-square gate of the solved graph"""
    level_m: float = within(0.05, 0.0, 10.0)
    """a robot on a floor stays on its plane within this, at each view, metres (1 sigma); 0: nothing is held"""
    level_rad: float = within(0.03, 1e-4, 10.0)
    """and upright within this, radians (1 sigma): it sways"""
    most_poses: int = within(1000, 2, 10_000_000)
    """of a survey of more views only so many, evenly spaced, and those that loops and walls hold are nodes of the graph, the
    others go with their neighbours: solving takes 11 kB a node"""
    spread_poses: int = within(30, 1, 10_000)
    """at so many poses, evenly spaced, it is said how unsure the solved graph is of them,"""
    motion_share: float = within(0.3, 0.0, 100.0)
    """counting this share of the variance that motions state: the errors of neighbouring ones partly take each other away.
    In eight surveys of plain buildings the squared error of the poses by the stated variance was 0.40 in the mean, at most
    0.70 (1 is honest); with 1 it was 0.21, with 0.15 up to 1.1"""
    drift: DriftBounds = field(default_factory=DriftBounds)
    scan_loops: ScanLoopSettings = field(default_factory=ScanLoopSettings)
    walls: WallSettings = field(default_factory=WallSettings)
    effort: Effort = field(default_factory=lambda: Effort(settled=1e-5))
