"""Settings of the localiser `sift_db`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Localiser
from rhs.api.errors import check_choice, check_ranges

from .advanced import SiftDbAdvanced


@dataclass
class SiftDb:
    """Odometry corrected by recognised places: a few Kalman filters, weighed against each other (thesis 5.2)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset()

    every: int = 3
    """The places are asked every so many views, and at each view while lost."""
    retrieval: str = "vlad"
    """How candidates are found: votes (the thesis), kd_tree or vlad (fastest)."""
    checks: int = 5
    """So many candidates are checked by geometry: about 7 ms each at 320x240."""
    min_inliers: int = 15
    """Key-points that must agree on one motion between the views."""
    p_true: float = 0.95
    """Chance that a verified answer is right; with 8 unique paintings of 71 about 97 % are."""
    kidnap_rate: float = 0.0001
    """Chance per view that somebody carries the robot elsewhere."""
    match_every: int = 3
    """The scan is laid onto the map every so many views, so that the walls hold the robot where no place is
    recognised (a corridor driven the other way round); 0: never."""
    drift_m_per_m: float = 0.02
    """Drift assumed beside the odometry's own covariance, metres per metre (visual odometry: 0.002 to 0.02)."""
    drift_rad_per_m: float = 0.003
    """Turn assumed to drift beside the odometry's own covariance, radians per metre."""
    tracking_above: float = 0.9
    """Above this chance of being right the robot calls itself tracking."""
    lost_below: float = 0.5
    """Below this chance of being right the robot calls itself lost."""
    advanced: SiftDbAdvanced = field(default_factory=SiftDbAdvanced)

    def __post_init__(self) -> None:
        owner = "localiser.sift_db"
        check_choice(owner, "retrieval", self.retrieval, ("votes", "kd_tree", "vlad"))
        check_ranges(owner, self, every=(1, 10000), checks=(1, 1000), min_inliers=(6, 10000), p_true=(0.5, 0.9999),
                     kidnap_rate=(1e-9, 0.5), match_every=(0, 10000), drift_m_per_m=(0.0, 1.0),
                     drift_rad_per_m=(0.0, 1.0), tracking_above=(0.5, 0.9999), lost_below=(0.0, self.tracking_above))

    def build(self, context: Context) -> Localiser:
        from .sift_db import PlaceLocaliser

        return PlaceLocaliser(self, context)
