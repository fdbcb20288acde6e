"""From the filter's planes to the walls of a map: where each wall begins and ends, and the scan they would give.

Features say where a wall is to the centimetre, but where it ends only to a metre or two. So ends are drawn by reason: a
wall cannot stand where the robot drove through, and it ends at the next wall across it (notes, section 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rhs.api.records import Wall

from .config import DrawingRules
from .scan import Drawn
from .state import BIN_M, Plane

USUAL = DrawingRules()


def walls_of(planes: Sequence[Plane], path_xy: np.ndarray, r: DrawingRules = USUAL) -> tuple[Drawn, ...]:
    """Segments of the upright planes with enough hits; path_xy (N, 2): where the robot has been."""
    upright = [p for p in planes if not p.is_floor and p.hits >= r.least_hits]
    above = [p.offset_m for p in planes if p.is_floor and p.offset_m > 1.0]
    ceiling = min(above, default=np.inf)
    walls = []
    upright = [p for p in upright if not _shadowed(p, upright, r)]
    for p in upright:
        for low, high in _pieces(p, upright, path_xy, r):
            walls.append(Drawn(Wall(_point(p, low), _point(p, high), 0.0, ceiling), *_seen_sides(p, r)))
    return tuple(walls)


def _seen_sides(p: Plane, r: DrawingRules) -> tuple[bool, bool]:
    """Whether the wall was seen from the left and from the right of the way along it."""
    below, above = (n >= r.side_share * sum(p.sides) for n in p.sides)
    return (below, above) if p.axis == 0 else (above, below)


def _point(p: Plane, along_m: float) -> np.ndarray:
    xy = np.zeros(2)
    xy[p.axis], xy[1 - p.axis] = p.at(along_m), along_m
    return xy


def _pieces(p: Plane, others: Sequence[Plane], path_xy: np.ndarray, r: DrawingRules) -> list[tuple[float, float]]:
    """Extents along the wall, metres: one piece wherever the robot has not driven through, if seen there."""
    marks = _marks(p, others, r)
    pieces = []
    for lower, upper in _gaps(p, path_xy, _hidden(p, others, path_xy, r), r):
        stretches = {k: n for k, n in p.support.items() if lower < (k + 0.5) * BIN_M < upper}
        firm = [k for k, n in stretches.items() if n >= 3]
        if sum(stretches.values()) < r.least_hits or not firm:
            continue
        low, high = max(p.low_m, BIN_M * min(firm)), min(p.high_m, BIN_M * (max(firm) + 1))
        beside = _beside(p, path_xy, r.beside_m)
        high = _snap(high, upper - r.clear_m, (marks, beside), r)
        low = -_snap(-low, -lower - r.clear_m, ([-m for m in marks], -beside), r)
        if high - low > 0.2:
            pieces.append((low, high))
    return pieces


def _marks(p: Plane, others: Sequence[Plane], r: DrawingRules) -> list[float]:
    """Coordinates along the wall at which walls across it, or their near continuations, meet its line."""
    middle = 0.5 * (p.low_m + p.high_m)
    across = [(o.at(p.at(middle)), o) for o in others if o.axis != p.axis]
    return [at for at, o in across if o.low_m - 2 * r.ahead_m < p.at(at) < o.high_m + 2 * r.ahead_m]


def _shadowed(p: Plane, others: Sequence[Plane], r: DrawingRules) -> bool:
    """Whether a much better seen wall runs along the same line: then this one is its echo, or somebody's picture frame."""
    middle = 0.5 * (p.low_m + p.high_m)
    return any(
        o is not p and o.axis == p.axis and o.hits >= 3 * p.hits and o.low_m - 1.0 < middle < o.high_m + 1.0
        and abs(o.at(middle) - p.at(middle)) < r.shadow_m
        for o in others
    )


def _gaps(
    p: Plane, path_xy: np.ndarray, hidden: Sequence[float], r: DrawingRules
) -> list[tuple[float, float]]:
    """Stretches along the wall in which the robot's body never touched its line, and that are not `hidden` (coordinates of
    the middles of stretches): there the wall may stand."""
    edges = [-np.inf, *sorted([*_beside(p, path_xy, r.body_m).tolist(), *hidden]), np.inf]
    return [(low, high) for low, high in pairwise(edges) if high - low > 2 * r.body_m]


def _hidden(p: Plane, others: Sequence[Plane], path_xy: np.ndarray, r: DrawingRules) -> list[float]:
    """Middles of the stretches along which the wall was not seen, but another was before or behind it: what was seen
    behind shows that the wall is not there, what stands before it hides it and makes it a guess."""
    own, out = p.firm, []
    for o in others:
        apart = abs(o.offset_m - p.offset_m)
        if o is p or o.axis != p.axis or not r.shadow_m < apart < r.niche_m or not own or _outlook(o) != _outlook(p):
            continue
        theirs = [k for k in o.firm if k not in own and _same_side(p, o, path_xy, ((k + 0.5) * BIN_M, r.passed_m))]
        for first, last in _runs(theirs, own):
            if last - first + 1 >= r.behind_bins:
                out += [BIN_M * first, *((k + 0.5) * BIN_M for k in range(first, last + 1)), BIN_M * (last + 1)]
    return out


def _outlook(p: Plane) -> bool:
    """Whether the wall was mostly seen from where the coordinate across it is higher."""
    return p.sides[1] > p.sides[0]


def _runs(bins: Sequence[int], own: set[int]) -> list[tuple[int, int]]:
    """First and last of the runs of stretches, across holes in which nothing of the wall itself was seen."""
    runs: list[tuple[int, int]] = []
    for k in sorted(bins):
        if runs and not any(runs[-1][1] < own_bin < k for own_bin in own):
            runs[-1] = (runs[-1][0], k)
        else:
            runs.append((k, k))
    return runs


def _same_side(p: Plane, o: Plane, path_xy: np.ndarray, where: tuple[float, float]) -> bool:
    """Whether the robot passed there (within a metre along the walls), always with both walls on the same hand. where: the
    coordinate along the walls, and how near to them passing is."""
    along_m, passed_m = where
    here = path_xy[np.abs(path_xy[:, 1 - p.axis] - along_m) < 1.0, p.axis]
    here = here[np.minimum(np.abs(here - p.at(along_m)), np.abs(here - o.at(along_m))) < passed_m]
    return len(here) > 0 and bool(((here - p.at(along_m)) * (here - o.at(along_m)) > 0.0).all())


def _beside(p: Plane, path_xy: np.ndarray, near_m: float) -> np.ndarray:
    """Coordinates along the wall of the points of the path that are so near to its line."""
    across = path_xy[:, p.axis] - p.at(path_xy[:, 1 - p.axis])
    return path_xy[np.abs(across) < near_m, 1 - p.axis]


def _snap(end: float, limit: float, hints: tuple[Sequence[float], np.ndarray], r: DrawingRules) -> float:
    """Upper end of a wall seen up to `end` that must not pass `limit`: the first wall across it ahead, else one just
    behind, else where the path beside it ends. hints: coordinates of walls across, and of the path beside."""
    marks, beside = hints
    driven = beside[(beside > end - r.round_m) & (beside < min(end + r.ahead_m, limit))]
    onward = max(end, float(driven.max())) if len(driven) else end
    early = r.behind_m if np.isfinite(limit) else 0.3  # a path that turns across the wall's line may pass its end
    ahead = [m for m in marks if max(end - 0.3, onward - early) <= m <= min(onward + r.ahead_m, limit + r.clear_m)]
    if ahead:
        return min(ahead)
    reach = min(end, limit)
    behind = [m for m in marks if reach - r.behind_m <= m <= min(end, limit + r.clear_m)]
    if behind:
        return max(behind)
    return max(reach, min(onward + r.round_m, limit)) if len(driven) else reach
