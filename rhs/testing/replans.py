"""Checks of what a robot does when its way is blocked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import Blockage, Blocked, complete

from .room import context

PATIENCE = 10_000  # views after which even a patient robot does something
MOST_SKIPPED = 1000  # times that a place was put off already: the most of mission.tries


def answers_with_a_blocked(settings: Any, folder: Path) -> None:
    """Every answer is a member of Blocked."""
    part = complete("replan", settings.build(context(folder)))
    for blockage in _blockages(0, 1, 100):
        answer = part.blocked(blockage)
        assert isinstance(answer, Blocked), f"blocked() returned {answer!r}, expected a Blocked: {', '.join(Blocked)}"


def does_not_wait_for_ever(settings: Any, folder: Path) -> None:
    """After PATIENCE views something else is answered."""
    part = complete("replan", settings.build(context(folder)))
    for blockage in _blockages(PATIENCE):
        answer = part.blocked(blockage)
        assert answer not in (Blocked.WAIT, Blocked.ASK), (
            f"still waiting after {PATIENCE} views: the patrol would never end ({blockage})")


def _blockages(*waited: int) -> list[Blockage]:
    """New and known ones, with and without another place or a way round, waited for so many views."""
    return [Blockage(np.array([1.0, 2.0]), known, views, skipped=skipped, others=others, no_way=no_way)
            for known in (False, True) for no_way in (False, True) for others, skipped in ((0, 0), (2, 0), (2, MOST_SKIPPED))
            for views in waited]


REPLAN = (answers_with_a_blocked, does_not_wait_for_ever)
