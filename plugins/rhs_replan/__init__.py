"""What a robot does whose way is blocked by something that its map does not know."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rhs.api.contracts import Blockage, Blocked, Context, PartSettings
from rhs.api.errors import within

MOST = 100_000


class OwnPart(PartSettings):
    """Settings that decide themselves: what is built of them is what was typed."""

    def build(self, context: Context) -> Any:
        return self


@dataclass
class NewMission(OwnPart):
    """The mission is broken off and another begun from where the robot stands (thesis 5.6); around what was seen before in
    this attempt it only plans again."""

    def blocked(self, blockage: Blockage) -> Blocked:
        return Blocked.REPLAN if blockage.known else Blocked.NEW_MISSION


@dataclass
class Wait(OwnPart):
    """Stand still for a while, in case it goes away; then as `new_mission`."""

    views: int = within(40, 0, MOST)
    """views to wait for something new on the path, or where there is no way round, half a second each"""

    def blocked(self, blockage: Blockage) -> Blocked:
        if (blockage.no_way or not blockage.known) and blockage.waited < self.views:
            return Blocked.WAIT
        return NewMission().blocked(blockage)


@dataclass
class GoRound(OwnPart):
    """Plan again round it, in the same mission; only where there is no way round, stand still for a while."""

    views: int = within(40, 0, MOST)
    """views to wait where there is no way round, half a second each; then the place is left out"""

    def blocked(self, blockage: Blockage) -> Blocked:
        return Blocked.WAIT if blockage.no_way and blockage.waited < self.views else Blocked.REPLAN


@dataclass
class SkipAndReturn(OwnPart):
    """Go on with the next place and come back to this one when the others are done; where no other is left, and after
    so many tries of one place, as `go_round`."""

    tries: int = within(2, 0, 1000)
    """times that a place is put off"""
    views: int = within(40, 0, MOST)
    """views to wait where there is neither another place nor a way round, half a second each"""

    def blocked(self, blockage: Blockage) -> Blocked:
        if blockage.others and blockage.skipped < self.tries:
            return Blocked.SKIP
        return GoRound(self.views).blocked(blockage)


@dataclass
class Ask(OwnPart):
    """Stand still and ask: the event `ask` says so, the answer is a word in a file. Without one it is `skip_and_return`."""

    file: str = "answer.txt"
    """where the answer is read: new_mission, replan, wait, skip or give_up. A path; what is not there is no answer, and the
    word counts until the file is taken away"""
    views: int = within(40, 0, MOST)
    """views to wait for an answer, half a second each"""
    tries: int = within(2, 0, 1000)
    """times that a place is put off where nobody answers"""

    def blocked(self, blockage: Blockage) -> Blocked:
        try:
            word = Path(self.file).expanduser().read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            word = ""
        if word in ANSWERS and not (word == Blocked.WAIT and blockage.waited >= MOST_WAIT):
            return Blocked(word)
        return Blocked.ASK if blockage.waited < self.views else SkipAndReturn(self.tries, 0).blocked(blockage)


ANSWERS = tuple(str(answer) for answer in Blocked if answer is not Blocked.ASK)
MOST_WAIT = 1000  # views that an answer can make it wait
