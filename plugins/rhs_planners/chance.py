"""Random numbers inside compiled loops: splitmix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators",
2014). The first state is drawn from the planner's own generator, so that a plan depends on its seed only."""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import typed

_STEP, _MIX, _MIX2 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_SHARE = 2.0**-53


@typed(nb.types.Tuple((nb.uint64, nb.float64))(nb.uint64))
def uniform(state):
    """The next state, and a number in [0, 1) with 53 random bits."""
    state = state + _STEP
    mixed = (state ^ (state >> _30)) * _MIX
    mixed = (mixed ^ (mixed >> _27)) * _MIX2
    mixed = mixed ^ (mixed >> _31)
    return state, (mixed >> _11) * _SHARE
