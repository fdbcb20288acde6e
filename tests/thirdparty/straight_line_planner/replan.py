"""What to do when the way is blocked, by somebody else."""

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import Blockage, Blocked, Context
from rhs.api.errors import check_range


@dataclass
class Polite:
    """Waits a little, then goes elsewhere first, then round it."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    views: int = 6
    """views to wait"""

    def __post_init__(self) -> None:
        check_range("replan.polite", "views", self.views, low=0, high=1000)

    def build(self, context: Context) -> "Polite":
        return self

    def blocked(self, blockage: Blockage) -> Blocked:
        if blockage.waited < self.views:
            return Blocked.WAIT
        return Blocked.SKIP if blockage.others and not blockage.skipped else Blocked.REPLAN
