"""Checks of what a robot does when its way is blocked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import Blockage, Blocked

from .room import context

PATIENCE = 10_000  # views after which even a patient robot does something


def answers_with_a_blocked(settings: Any, folder: Path) -> None:
    """Every answer is a member of Blocked."""
    part = settings.build(context(folder))
    for known in (False, True):
        for waited in (0, 1, 100):
            answer = part.blocked(Blockage(np.array([1.0, 2.0]), known, waited))
            assert isinstance(answer, Blocked), f"blocked() returned {answer!r}, expected a Blocked: {', '.join(Blocked)}"


def does_not_wait_for_ever(settings: Any, folder: Path) -> None:
    """After PATIENCE views something else is answered."""
    part = settings.build(context(folder))
    for known in (False, True):
        answer = part.blocked(Blockage(np.array([1.0, 2.0]), known, PATIENCE))
        assert answer is not Blocked.WAIT, f"still waiting after {PATIENCE} views: the patrol would never end"


REPLAN = (answers_with_a_blocked, does_not_wait_for_ever)
