"""Settings of the loop closer `error_distribution`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, LoopCloser, PartSettings
from rhs.api.errors import one_of, within

from .advanced import ClosingAdvanced


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
