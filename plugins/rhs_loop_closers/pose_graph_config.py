"""Settings of the loop closer `pose_graph`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, LoopCloser
from rhs.api.errors import check_ranges

from .advanced import PoseGraphAdvanced


@dataclass
class PoseGraph:
    """Finds loops anywhere on the route, refuses those that do not fit together, and solves a robust pose graph."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset()

    min_way_m: float = 5.0
    """Two views closer than this along the way are neighbours, not a loop, metres."""
    min_turn_deg: float = 90.0
    """Views closer than min_way_m are a loop all the same when the camera looked away by more than this between them
    and back, degrees: a hand hardly moves on."""
    checks: int = 60
    """So many pairs of views, the likeliest ones, are checked by geometry: about 8 ms each at 320x240."""
    min_inliers: int = 20
    """Key-points that must agree on one motion between the views."""
    min_coverage: float = 0.12
    """Least share of the key-points that both views should show which are found again; look-alike paintings in a
    different setting fall below it."""
    support: int = 2
    """An edge needs so many different later views near it (window_m) that close the same loop."""
    window_m: float = 3.0
    """Metres of way in which the supporting views must lie."""
    max_drift_share: float = 0.15
    """A loop may not move a pose by more than this share of the way between its ends (plus half a metre)."""
    scan_every_m: float = 1.0
    """Where a corridor is walked back the other way round its scans are tried every so many metres; 0: never."""
    walls_every_m: float = 0.6
    """Straight walls hold the way between loops: the scans of every so many metres (a radian of turning counts as
    one) are looked at; 0: never. No camera that is carried, and no scan that was made from walls an odometry
    believes in."""
    scale_sigma: float = 0.03
    """With walls: the odometry's metres may all be too long or too short by such a share (1 sigma), which is solved
    for; a wheel whose radius is not quite known is 0.01 to 0.03 off."""
    drift_m_per_m: float = 0.03
    """Odometry noise the graph assumes at least: metres per metre (a steady drift is larger than the noise of a
    step)."""
    drift_rad_per_m: float = 0.01
    """Odometry noise of the heading the graph assumes at least: radians per metre."""
    kernel_sigma: float = 3.0
    """Scale of the robust (Cauchy) kernel on loop edges, sigmas."""
    advanced: PoseGraphAdvanced = field(default_factory=PoseGraphAdvanced)

    def __post_init__(self) -> None:
        check_ranges("loop_closer.pose_graph", self, min_way_m=(0.1, 10000.0), min_turn_deg=(1.0, 180.0), checks=(1, 100000),
                     min_inliers=(6, 10000), min_coverage=(0.0, 1.0), support=(1, 1000), window_m=(0.1, 1000.0),
                     max_drift_share=(0.0, 10.0), scan_every_m=(0.0, 1000.0), walls_every_m=(0.0, 1000.0),
                     scale_sigma=(1e-6, 1.0), drift_m_per_m=(1e-5, 1.0), drift_rad_per_m=(1e-5, 1.0),
                     kernel_sigma=(0.1, 1000.0))

    def build(self, context: Context) -> LoopCloser:
        from .pose_graph import PoseGraphCloser

        return PoseGraphCloser(self, context)
