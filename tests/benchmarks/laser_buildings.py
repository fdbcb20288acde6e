"""Made buildings for `laser_made.py`: walls as line segments, and a way through them, both drawn by a seed.

alike: corridors in nested loops of 150 to 350 m, door after door the same; offices: a ring of furnished rooms, three laps;
halls: large rooms with pillars, gates between them; outdoor: streets between blocks, trees along them.
"""

from __future__ import annotations

from functools import partial

import numpy as np

CELL_M = 0.05
KINDS = ("alike", "offices", "halls", "outdoor")
Way = list[tuple[float, float]]


class Plan:
    """Free space painted onto solid ground, and loose things; `segments` are the outlines of both."""

    def __init__(self, width_m: float, height_m: float) -> None:
        self._free = np.zeros((int(height_m / CELL_M) + 2, int(width_m / CELL_M) + 2), bool)
        self._loose: list[np.ndarray] = []

    def paint(self, west: float, south: float, east: float, north: float, *, free: bool = True) -> None:
        """A rectangle, metres."""
        low_x, low_y, high_x, high_y = (max(int(round(v / CELL_M)), 1) for v in (west, south, east, north))
        self._free[low_y:min(high_y, len(self._free) - 1), low_x:min(high_x, self._free.shape[1] - 1)] = free

    def thing(self, x: float, y: float, radii: np.ndarray, turn: float = 0.0) -> None:
        """A loose polygon: one corner at each of these radii, evenly around."""
        angles = turn + np.arange(len(radii)) * 2.0 * np.pi / len(radii)
        corners = np.column_stack([x + radii * np.cos(angles), y + radii * np.sin(angles)])
        self._loose.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))

    def segments(self) -> np.ndarray:
        """(S, 2, 2) metres."""
        upright = _edges(self._free.T)[..., ::-1]
        return np.concatenate([_edges(self._free), upright, *self._loose])


def _edges(free: np.ndarray) -> np.ndarray:
    """(S, 2, 2) x y of the edges along the rows where free and solid cells meet, each as long as it is straight."""
    sides = np.diff(free.astype(np.int8), axis=0)
    padded = np.pad(sides, ((0, 0), (1, 1)))
    change = np.diff(padded, axis=1) != 0
    out = []
    for row in np.nonzero(sides.any(axis=1))[0]:
        ends = np.nonzero(change[row])[0]
        out += [((a * CELL_M, (row + 1) * CELL_M), (b * CELL_M, (row + 1) * CELL_M))
                for a, b in zip(ends[:-1], ends[1:], strict=True) if sides[row, a]]
    return np.array(out, float).reshape(-1, 2, 2)


def building(kind: str, way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way]:
    """Walls (S, 2, 2) and corners of the way, metres."""
    return {"alike": alike, "offices": offices, "halls": halls, "outdoor": outdoor}[kind](way_m, rng)


def alike(way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way]:
    """Corridors along all lines of a lattice, doors every few metres; a small share of them stands open or is missing."""
    xs = 6.0 + np.concatenate([[0.0], np.cumsum(rng.choice([40.0, 60.0, 80.0, 100.0], int(rng.integers(1, 4))))])
    ys = 6.0 + np.concatenate([[0.0], np.cumsum(rng.choice([30.0, 45.0, 60.0], int(rng.integers(1, 3))))])
    plan, half, depth = Plan(xs[-1] + 6.0, ys[-1] + 6.0), rng.uniform(1.0, 1.4), rng.uniform(0.1, 0.3)
    pitch, unlike = rng.choice([3.0, 4.0, 5.0]), rng.uniform(0.05, 0.25)
    for lines, ends, swap in ((ys, xs, False), (xs, ys, True)):
        for line in lines:
            corners = (ends[0] - half, line - half, ends[-1] + half, line + half)
            plan.paint(*(corners if not swap else (corners[1], corners[0], corners[3], corners[2])))
            for at in np.arange(ends[0] + 0.5 * pitch, ends[-1], pitch):
                for side in (-1.0, 1.0):
                    odd = rng.random()
                    reach = half + (0.0 if odd < 0.5 * unlike else rng.uniform(0.5, 4.0) if odd < unlike else depth)
                    low, high = sorted((line, line + side * reach))
                    plan.paint(*((at - 0.5, low, at + 0.5, high) if not swap else (low, at - 0.5, high, at + 0.5)))
    return plan.segments(), lattice_way(xs, ys, way_m, rng)


def offices(way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way]:
    """A ring of corridor with rooms on both sides, each with things in it; lap after lap, into some of the rooms."""
    wide, high, half, wall = rng.uniform(25.0, 45.0), rng.uniform(14.0, 22.0), rng.uniform(0.8, 1.2), 0.15
    west, south = 9.0, 9.0
    plan = Plan(wide + 18.0, high + 18.0)
    plan.paint(west - half, south - half, west + wide + half, south + high + half)
    plan.paint(west + half, south + half, west + wide - half, south + high - half, free=False)
    doors: list[tuple[float, tuple[float, float], tuple[float, float]]] = []  # place on the ring, before and in the room
    for number, (x, y, dx, dy, length) in enumerate(((west, south, 1, 0, wide), (west + wide, south, 0, 1, high),
                                                     (west + wide, south + high, -1, 0, wide),
                                                     (west, south + high, 0, -1, high))):
        at, begun = half + wall, (0.0, wide, wide + high, 2.0 * wide + high)[number]
        while at + 2.5 < length - half:
            room_m = min(rng.uniform(2.8, 5.0), length - half - at)
            for side in (1.0, -1.0):  # right of the ring is outside
                deep = rng.uniform(3.5, 6.0) if side > 0 else min(rng.uniform(3.0, 5.0), 0.5 * high - half - 0.4)
                if side < 0 and number % 2:
                    continue  # rooms inside along the long sides only: they would meet at the corners
                here = partial(_beside, (x, y, dx, dy), side)
                rectangle(plan, here(at, half + wall), here(at + room_m - wall, half + wall + deep))
                door = at + rng.uniform(0.7, room_m - wall - 0.7)
                rectangle(plan, here(door - 0.45, half - 0.1), here(door + 0.45, half + wall + 0.1))
                for _ in range(int(rng.integers(3, 9))):
                    a, b = at + rng.uniform(0.2, room_m - 0.4), half + wall + rng.uniform(0.9, deep)
                    if abs(a - door) > 0.8 or b > half + wall + 2.8:
                        plan.thing(*here(a, b), radii=np.full(int(rng.choice([4, 4, 6])), rng.uniform(0.05, 0.6)),
                                   turn=rng.uniform(0.0, 1.6))
                doors.append((begun + door, here(door, 0.0), here(door, half + wall + 1.7)))
            at += room_m
    ring = [(0.0, (west, south)), (wide, (west + wide, south)), (wide + high, (west + wide, south + high)),
            (2.0 * wide + high, (west, south + high))]
    way: Way = []
    lap_m, done_m, into = 2.0 * (wide + high), 0.0, rng.uniform(0.2, 0.8)
    while done_m < way_m:
        visited = [door for door in doors if rng.random() < into]
        for _, *stops in sorted([*ring, *visited], key=lambda one: one[0]):
            way += [stops[0], stops[1], stops[0]] if len(stops) == 2 else stops
        done_m += lap_m + 5.0 * len(visited)
    return plan.segments(), way


def _beside(edge: tuple[float, ...], side: float, along: float, away: float) -> tuple[float, float]:
    """The place so far along an edge (x, y, direction) of the ring and so far to its side."""
    x, y, dx, dy = edge
    return x + dx * along + side * dy * away, y + dy * along - side * dx * away


def rectangle(plan: Plan, a: tuple[float, float], b: tuple[float, float]) -> None:
    """Free space between two corners, in any order."""
    plan.paint(min(a[0], b[0]), min(a[1], b[1]), max(a[0], b[0]), max(a[1], b[1]))


def halls(way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way]:
    """Large rooms in rows with gates between them; pillars and stands."""
    xs = 3.0 + np.concatenate([[0.0], np.cumsum(rng.uniform(9.0, 26.0, int(rng.integers(2, 5))))])
    ys = 3.0 + np.concatenate([[0.0], np.cumsum(rng.uniform(9.0, 26.0, int(rng.integers(2, 4))))])
    plan, wall = Plan(xs[-1] + 3.0, ys[-1] + 3.0), rng.uniform(0.1, 0.4)
    middle_x, middle_y = 0.5 * (xs[1:] + xs[:-1]), 0.5 * (ys[1:] + ys[:-1])
    for i, x in enumerate(middle_x):
        for j, y in enumerate(middle_y):
            plan.paint(xs[i] + wall, ys[j] + wall, xs[i + 1] - wall, ys[j + 1] - wall)
            gate = rng.uniform(0.7, 2.5)
            if i:
                plan.paint(xs[i] - wall, y - gate, xs[i] + wall, y + gate)
            if j:
                plan.paint(x - gate, ys[j] - wall, x + gate, ys[j] + wall)
            for _ in range(int(rng.integers(2, 14))):
                px, py = rng.uniform(xs[i] + 1.0, xs[i + 1] - 1.0), rng.uniform(ys[j] + 1.0, ys[j + 1] - 1.0)
                if min(abs(px - x), abs(py - y)) > 1.6:  # the way leads along the middles
                    plan.thing(px, py, np.full(int(rng.choice([4, 8])), rng.uniform(0.15, 0.8)), rng.uniform(0.0, 1.6))
    return plan.segments(), lattice_way(middle_x, middle_y, way_m, rng)


def outdoor(way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way]:
    """Blocks of houses with steps in their fronts and gaps between them, lawns, trees along the streets."""
    xs = np.concatenate([[0.0], np.cumsum(rng.uniform(60.0, 120.0, int(rng.integers(2, 4))))])
    ys = np.concatenate([[0.0], np.cumsum(rng.uniform(50.0, 100.0, int(rng.integers(1, 3))))])
    plan, lawn = Plan(1.0, 1.0), rng.uniform(0.1, 0.4)
    for line, ends, swap in [*((y, xs, False) for y in ys), *((x, ys, True) for x in xs)]:
        for side in (-1.0, 1.0):
            back, at = rng.uniform(5.0, 12.0), ends[0] + 8.0
            while at < ends[-1] - 8.0:
                front, deep = rng.uniform(6.0, 25.0), side * (back + rng.uniform(0.0, 3.0))
                if rng.random() > lawn and all(abs(at + f * front - e) > 9.0 for f in (0.0, 0.5, 1.0) for e in ends):
                    box = np.array([(at, deep), (at + 0.4 * front, deep), (at + 0.4 * front, deep + side),
                                    (at + front, deep + side),
                                    (at + front, deep + 9.0 * side), (at, deep + 9.0 * side)]) + (0.0, line)
                    box = box[:, ::-1] if swap else box
                    plan._loose.append(np.stack([box, np.roll(box, -1, axis=0)], axis=1))
                at += front + rng.uniform(0.5, 8.0)
            for at in np.arange(ends[0] + 5.0, ends[-1] - 4.0, rng.uniform(6.0, 15.0)):
                if rng.random() < 0.7:
                    x, y = at + rng.normal(0.0, 0.5), line + side * rng.uniform(3.0, 4.5)
                    plan.thing(*((x, y) if not swap else (y, x)), radii=rng.uniform(0.5, 1.5, 8) * rng.uniform(0.15, 0.5))
    return plan.segments(), lattice_way(xs, ys, way_m, rng)


def lattice_way(xs: np.ndarray, ys: np.ndarray, way_m: float, rng: np.random.Generator) -> Way:
    """From crossing to crossing, where it has been least often, never straight back if there is another way."""
    at, before, driven_m = (0, 0), None, 0.0
    seen: dict[frozenset, int] = {}
    way: Way = [(float(xs[0]), float(ys[0]))]
    while driven_m < way_m:
        near = [(at[0] + i, at[1] + j) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))
                if 0 <= at[0] + i < len(xs) and 0 <= at[1] + j < len(ys)]
        near = [one for one in near if one != before] or near
        to = min(near, key=lambda one: seen.get(frozenset((at, one)), 0) + 0.9 * rng.random())
        seen[frozenset((at, to))] = seen.get(frozenset((at, to)), 0) + 1
        driven_m += abs(xs[to[0]] - xs[at[0]]) + abs(ys[to[1]] - ys[at[1]])
        at, before = to, at
        way.append((float(xs[at[0]]), float(ys[at[1]])))
    return way
