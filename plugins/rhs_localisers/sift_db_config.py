"""Settings of the localiser `sift_db`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Localiser, PartSettings
from rhs.api.errors import check_range, one_of, within

from .advanced import SiftDbAdvanced


@dataclass
class SiftDb(PartSettings):
    """Odometry corrected by recognised places: a few Kalman filters, weighed against each other (thesis 5.2)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    every: int = within(3, 1, 10000)
    """The places are asked every so many views, and at each view while lost."""
    retrieval: str = one_of("vlad", "votes", "kd_tree")
    """How candidates are found: votes (the thesis), kd_tree or vlad (fastest)."""
    checks: int = within(5, 1, 1000)
    """So many candidates are checked by geometry: about 7 ms each at 320x240."""
    min_inliers: int = within(15, 6, 10000)
    """Key-points that must agree on one motion between the views."""
    p_true: float = within(0.95, 0.5, 0.9999)
    """Chance that a verified answer is right; with 8 unique paintings of 71 about 97 % are."""
    kidnap_rate: float = within(0.0001, 1e-9, 0.5)
    """Chance per view that somebody carries the robot elsewhere."""
    match_every: int = within(3, 0, 10000)
    """The scan is laid onto the map every so many views, so that the walls hold the robot where no place is
    recognised (a corridor driven the other way round); 0: never."""
    drift_m_per_m: float = within(0.02, 0.0, 1.0)
    """Drift assumed beside the odometry's own covariance, metres per metre (visual odometry: 0.002 to 0.02)."""
    drift_rad_per_m: float = within(0.003, 0.0, 1.0)
    """Turn assumed to drift beside the odometry's own covariance, radians per metre."""
    tracking_above: float = within(0.9, 0.5, 0.9999)
    """Above this chance of being right the robot calls itself tracking."""
    lost_below: float = 0.5
    """Below this chance of being right the robot calls itself lost."""
    advanced: SiftDbAdvanced = field(default_factory=SiftDbAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("", "lost_below", self.lost_below, low=0.0, high=self.tracking_above)

    def build(self, context: Context) -> Localiser:
        from .sift_db import PlaceLocaliser

        return PlaceLocaliser(self, context)
