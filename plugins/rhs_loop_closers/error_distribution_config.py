"""Settings of the loop closer `error_distribution`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, LoopCloser
from rhs.api.errors import check_choice, check_ranges

from .advanced import ErrorDistributionAdvanced


@dataclass
class ErrorDistribution:
    """Spreads the error of the end pose over the survey in proportion to the way travelled (thesis eq. 3.14)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset()

    positions: str = "turned"
    """printed: the equation alone, axis by axis; turned: angles first, then the steps are walked again with them."""
    trust: str = "sighting"
    """Whom to believe at the end. sighting: the recognised place alone (the thesis). both: place and odometry, each
    by its covariance; for an odometry whose covariance is that of its pose, as corridor_ekf's: it knows headings
    better."""
    sighting_sigma_m: float = 0.05
    """trust=both: what the covariance of a sighting lacks in position, because points lifted on walls are themselves
    estimates, metres (1 sigma)."""
    sighting_sigma_deg: float = 1.0
    """trust=both: what the covariance of a sighting lacks in each angle, degrees (1 sigma)."""
    reach_views: int = 6
    """The last and the first so many stored views are compared."""
    checks: int = 8
    """So many of their pairs, those with most matches, are checked by geometry."""
    min_inliers: int = 20
    """Key-points that must agree on one rigid motion."""
    max_drift_share: float = 0.15
    """A closure that moves the end by more than this share of the distance travelled (plus half a metre) is refused:
    visual odometry drifts by 1-4 %, in bad light by 10 %."""
    advanced: ErrorDistributionAdvanced = field(default_factory=ErrorDistributionAdvanced)

    def __post_init__(self) -> None:
        owner = "loop_closer.error_distribution"
        check_choice(owner, "positions", self.positions, ("printed", "turned"))
        check_choice(owner, "trust", self.trust, ("sighting", "both"))
        check_ranges(owner, self, sighting_sigma_m=(0.0, 10.0), sighting_sigma_deg=(0.0, 90.0), reach_views=(1, 1000),
                     checks=(1, 1000), min_inliers=(6, 10000), max_drift_share=(0.0, 10.0))

    def build(self, context: Context) -> LoopCloser:
        from .error_distribution import ErrorSpreader

        return ErrorSpreader(self, context)
