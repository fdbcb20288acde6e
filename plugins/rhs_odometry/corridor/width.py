"""What fixes the scale beside the camera's height: the corridor's width, known or one unknown constant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rhs.estimation.filters.kalman import correct

from .config import WidthRules
from .state import WIDTH, CorridorState

USUAL = WidthRules()


@dataclass(frozen=True)
class Pair:
    """Two walls with the camera between them: indices, gap_m, and the rows (1, D) of gap - width."""

    first: int
    second: int
    gap_m: float
    jacobian: np.ndarray


def find_pair(state: CorridorState, rules: WidthRules = USUAL) -> Pair | None:
    """A not yet used pair of parallel walls, both beside the camera, the camera between them."""
    here = state.clones[-1, :2]
    for i, a in enumerate(state.planes):
        for j in range(i + 1, len(state.planes)):
            b = state.planes[j]
            if a.axis != b.axis or a.is_floor or (a.paired and b.paired) or min(a.hits, b.hits) < rules.hits:
                continue
            across, along = here[a.axis], here[1 - a.axis]
            beside = all(p.low_m - 1.0 < along < p.high_m + 1.0 for p in (a, b))
            if beside and (a.at(along) - across) * (b.at(along) - across) < 0.0:
                return _pair(state, i, j, along)
    return None


def _pair(state: CorridorState, i: int, j: int, along: float) -> Pair:
    if state.planes[i].at(along) < state.planes[j].at(along):
        i, j = j, i
    gap_m, row = state.apart(i, j, along)
    row[WIDTH] = -1.0
    return Pair(i, j, gap_m, row[None])


def fits(pair: Pair, width_m: float, rules: WidthRules) -> bool:
    return abs(pair.gap_m / width_m - 1.0) < rules.gap_share


def agrees(state: CorridorState, pair: Pair, rules: WidthRules) -> bool:
    spread = float((pair.jacobian @ state.covariance @ pair.jacobian.T)[0, 0]) + rules.sigma_m**2
    return (pair.gap_m - state.base[WIDTH]) ** 2 < rules.chi2 * spread


def use_pair(state: CorridorState, pair: Pair, rules: WidthRules = USUAL) -> None:
    """One measurement: the gap between the walls is the width."""
    residual = np.array([state.base[WIDTH] - pair.gap_m])
    change = correct(state.covariance, pair.jacobian, residual, np.array([[rules.sigma_m**2]]))
    state.add(change.delta, change.covariance)
    for k in (pair.first, pair.second):
        state.planes[k] = replace(state.planes[k], paired=True)
