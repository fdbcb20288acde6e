"""A replanning policy for rhs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api import Bounded, within
from rhs.api.contracts import Blockage, Blocked, Context


@dataclass
class Skeleton(Bounded):
    """Wait, then go round; where there is no way round, go on with another place first."""

    views: int = within(20, 0, 1000)
    """views to wait, half a second each"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Skeleton:
        return self

    def blocked(self, blockage: Blockage) -> Blocked:
        """Asked in each view in which something stands on the path."""
        if blockage.waited < self.views:
            return Blocked.WAIT
        if blockage.no_way:
            return Blocked.SKIP if blockage.others and not blockage.skipped else Blocked.GIVE_UP
        return Blocked.REPLAN
