"""What a robot does whose way is blocked by something that its map does not know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import Blockage, Blocked, Context
from rhs.api.errors import check_range


@dataclass
class NewMission:
    """The mission is broken off and another begun from where the robot stands (thesis 5.6); around what was seen before in
    this attempt it only plans again."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> NewMission:
        return self

    def blocked(self, blockage: Blockage) -> Blocked:
        return Blocked.REPLAN if blockage.known else Blocked.NEW_MISSION


@dataclass
class Wait:
    """Stand still for a while, in case it goes away; then as `new_mission`."""

    views: int = 20
    """views to wait for something new on the path, half a second each"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        check_range("replan", "views", self.views, low=0, high=100_000)

    def build(self, context: Context) -> Wait:
        return self

    def blocked(self, blockage: Blockage) -> Blocked:
        if not blockage.known and blockage.waited < self.views:
            return Blocked.WAIT
        return NewMission().blocked(blockage)
