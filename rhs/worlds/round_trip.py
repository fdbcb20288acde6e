"""A short round trip: farthest insertion, 2-opt (Croes 1958) and Or-opt (Or 1976), and how it is driven past its start. No
chance: equal costs, equal trips."""

from __future__ import annotations

import numpy as np

PAST_M = 1.0  # the tour goes on so far past its start, that the last views are like the first


def round_trip(costs: np.ndarray) -> np.ndarray:
    """(S,) order of a cheap round trip that begins with 0: farthest insertion, then 2-opt and moves of up to three stops
    until nothing gains."""
    order, left = [0], list(range(1, len(costs)))
    while left:
        stop = left.pop(int(np.argmax(costs[np.ix_(order, left)].min(axis=0))))
        order = _inserted(order, [stop], costs)
    while True:
        cost = _length(order, costs)
        order = _moved(_uncrossed(order, costs), costs)
        if _length(order, costs) >= cost - 1e-6:
            return np.array(order)


def _length(order: list[int], costs: np.ndarray) -> float:
    return float(costs[order, [*order[1:], order[0]]].sum())


def _inserted(order: list[int], piece: list[int], costs: np.ndarray) -> list[int]:
    """The trip with the piece put in where it costs least, either way round, never before the first stop."""
    ends = [*order[1:], order[0]]
    ways = [(costs[order, way[0]] + costs[ends, way[-1]] - costs[order, ends], way) for way in (piece, piece[::-1])]
    extra, way = ways[0] if ways[0][0].min() <= ways[1][0].min() else ways[1]
    at = int(np.argmin(extra)) + 1
    return order[:at] + way + order[at:]


def _uncrossed(order: list[int], costs: np.ndarray) -> list[int]:
    """2-opt: pieces turned round as long as that gains."""
    better = True
    while better:
        better = False
        for i in range(1, len(order) - 1):
            for j in range(i + 1, len(order)):
                a, b, c, d = order[i - 1], order[i], order[j], order[(j + 1) % len(order)]
                if costs[a, c] + costs[b, d] < costs[a, b] + costs[c, d] - 1e-6:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    better = True
    return order


def _moved(order: list[int], costs: np.ndarray) -> list[int]:
    """Or-opt: pieces of up to three stops taken out and put in elsewhere where that gains (Or 1976)."""
    for size in (3, 2, 1):
        for i in range(1, len(order) - size + 1):
            rest = order[:i] + order[i + size :]
            other = _inserted(rest, order[i : i + size], costs)
            if _length(other, costs) < _length(order, costs) - 1e-6:
                order = other
    return order


def past_start(route_m: np.ndarray) -> np.ndarray:
    """The closed route, and once more along its beginning for PAST_M."""
    left, points = PAST_M, list(route_m)
    for a, b in zip(route_m[:-1], route_m[1:], strict=True):
        length = float(np.hypot(*(b - a)))
        if length >= left:
            points.append((a + (b - a) * (left / length)).round(4))
            break
        points.append(b)
        left -= length
    return np.array(points)


def aside_m(points: np.ndarray) -> np.ndarray:
    """(N,) distance of points from the straight line between the first and the last."""
    a, b = points[0], points[-1]
    along = np.clip(((points - a) * (b - a)).sum(axis=1) / max(float(((b - a) ** 2).sum()), 1e-12), 0.0, 1.0)
    aside: np.ndarray = np.hypot(*(points - a - along[:, None] * (b - a)).T)
    return aside
