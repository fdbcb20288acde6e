"""Where the random generators stand that everything in a process shares."""

from __future__ import annotations

import random
from typing import Any

import numpy as np


def global_states() -> dict[str, Any]:
    """By whose they are: nobody may draw from them."""
    state: Any = np.random.get_state()  # noqa: NPY002 - looked at, never drawn from
    return {"numpy": (state[1].tobytes(), *state[2:]), "Python": random.getstate()}


def drawn_since(before: dict[str, Any]) -> list[str]:
    """Whose are no longer where they stood."""
    return [name for name, state in global_states().items() if state != before[name]]
