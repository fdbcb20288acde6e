"""A replanning policy for rhs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api import check_range
from rhs.api.contracts import Blockage, Blocked, Context


@dataclass
class Skeleton:
    """Wait, then go round; where there is no way round, go on with another place first."""

    views: int = 20
    """views to wait, half a second each"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        check_range("replan", "views", self.views, low=0, high=1000)

    def build(self, context: Context) -> Skeleton:
        return self

    def blocked(self, blockage: Blockage) -> Blocked:
        """Asked in each view in which something stands on the path."""
        if blockage.waited < self.views:
            return Blocked.WAIT
        if blockage.no_way:
            return Blocked.SKIP if blockage.others and not blockage.skipped else Blocked.GIVE_UP
        return Blocked.REPLAN
