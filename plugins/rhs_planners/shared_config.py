"""Settings that every planner has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.errors import check_range


@dataclass
class PlannerSettings:
    """What all planners of this package share; see problem.begin and shorten.shorten."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    start_radius_m: float = 0.3
    """a start in a blocked cell is set off to a free one this near; one robot radius"""
    shorten_rounds: int = 60
    """rounds of string pulling after planning, 0 for none; it stops by itself much earlier"""

    def check(self, owner: str) -> None:
        """Refuse shared settings out of range."""
        check_range(owner, "start_radius_m", self.start_radius_m, low=0.0, high=10.0, unit="m")
        check_range(owner, "shorten_rounds", self.shorten_rounds, low=0, high=10_000)
