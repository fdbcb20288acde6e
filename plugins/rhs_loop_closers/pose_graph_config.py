"""Settings of the loop closer `pose_graph`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, LoopCloser, PartSettings
from rhs.api.errors import within

from .advanced import PoseGraphAdvanced


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
