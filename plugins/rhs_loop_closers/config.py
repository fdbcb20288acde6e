"""Settings of the loop closers `pose_graph`, `error_distribution` and `none`, and the thresholds that a user seldom touches:
`loop_closer.advanced.name=value`. Light to import."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, LoopCloser, PartSettings
from rhs.api.errors import Bounded, one_of, within
from rhs.api.records import Closure, View
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


@dataclass
class PoseGraph(PartSettings):
    """Finds loops anywhere on the route, refuses those that do not fit together, and solves a robust pose graph."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    min_way_m: float = within(5.0, 0.1, 10000.0)
    """Two views closer than this along the way are neighbours, not a loop, metres."""
    min_turn_deg: float = within(90.0, 1.0, 180.0)
    """Views closer than min_way_m are a loop all the same when the camera looked away by more than this between them
    and back, degrees: a hand hardly moves on."""
    checks: int = within(60, 1, 100000)
    """So many pairs of views, the likeliest ones, are checked by geometry: about 8 ms each at 320x240."""
    min_inliers: int = within(20, 6, 10000)
    """Key-points that must agree on one motion between the views."""
    min_coverage: float = within(0.12, 0.0, 1.0)
    """Least share of the key-points that both views should show which are found again; look-alike paintings in a
    different setting fall below it."""
    support: int = within(2, 1, 1000)
    """An edge needs so many different later views near it (window_m) that close the same loop."""
    window_m: float = within(3.0, 0.1, 1000.0)
    """Metres of way in which the supporting views must lie."""
    max_drift_share: float = within(0.15, 0.0, 10.0)
    """A loop may not move a pose by more than this share of the way between its ends (plus half a metre)."""
    scan_every_m: float = within(1.0, 0.0, 1000.0)
    """Where a corridor is walked back the other way round its scans are tried every so many metres; 0: never."""
    walls_every_m: float = within(0.6, 0.0, 1000.0)
    """Straight walls hold the way between loops: the scans of every so many metres (a radian of turning counts as
    one) are looked at; 0: never. No camera that is carried, and no scan that was made from walls an odometry
    believes in."""
    scale_sigma: float = within(0.03, 1e-6, 1.0)
    """With walls: the odometry's metres may all be too long or too short by such a share (1 sigma), which is solved
    for; a wheel whose radius is not quite known is 0.01 to 0.03 off."""
    drift_m_per_m: float = within(0.03, 1e-5, 1.0)
    """Odometry noise the graph assumes at least: metres per metre (a steady drift is larger than the noise of a
    step)."""
    drift_rad_per_m: float = within(0.01, 1e-5, 1.0)
    """Odometry noise of the heading the graph assumes at least: radians per metre."""
    kernel_sigma: float = within(3.0, 0.1, 1000.0)
    """Scale of the robust (Cauchy) kernel on loop edges, sigmas."""
    advanced: PoseGraphAdvanced = field(default_factory=PoseGraphAdvanced)

    def build(self, context: Context) -> LoopCloser:
        from .pose_graph import PoseGraphCloser

        return PoseGraphCloser(self, context)


@dataclass
class ErrorDistribution(PartSettings):
    """Spreads the error of the end pose over the survey in proportion to the way travelled (thesis eq. 3.14)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    positions: str = one_of("turned", "printed")
    """printed: the equation alone, axis by axis; turned: angles first, then the steps are walked again with them."""
    reach_views: int = within(6, 1, 1000)
    """The last and the first so many stored views are compared."""
    checks: int = within(8, 1, 1000)
    """So many of their pairs, those with most matches, are checked by geometry."""
    min_inliers: int = within(20, 6, 10000)
    """Key-points that must agree on one rigid motion."""
    max_drift_share: float = within(0.15, 0.0, 10.0)
    """A closure that moves the end by more than this share of the distance travelled (plus half a metre) is refused:
    visual odometry drifts by 1-4 %, in bad light by 10 %."""
    advanced: ClosingAdvanced = field(default_factory=ClosingAdvanced)

    def build(self, context: Context) -> LoopCloser:
        from .error_distribution import ErrorSpreader

        return ErrorSpreader(self, context)


@dataclass
class NoClosing(PartSettings):
    """Leaves the survey as it is."""

    def build(self, context: Context) -> LoopCloser:
        return Unclosed()


class Unclosed:
    """Returns the poses it was given."""

    def close(self, views: Sequence[View]) -> Closure:
        from rhs.estimation.views.loops import covariances_of, poses_of

        return Closure(poses_of(views), covariances=covariances_of(views))
