"""Made buildings for `laser_made.py --kinds lab wing`, like those of two well known logs, drawn by a seed.

lab: like the Intel Research Lab, a ring of corridor with furnished offices on both sides, two laps in the corridor and then
one into most offices, seen by 180 beams over 180 degrees. wing: like Freiburg building 079, one straight corridor with
offices on both sides, driven forth and back, in and out, seen by 361 beams over 180 degrees. Doors that nobody drives
through stand open or shut, another way on each lap, and some things were moved in between.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from laser_buildings import Plan, Way, _beside, rectangle

LIKE = ("lab", "wing")
BEAMS = {"lab": (180, 180.0), "wing": (361, 180.0)}
Changes = list[tuple[int, np.ndarray]]
"""from this corner of the way on these segments (S, 2, 2) stand there too, in place of those before"""
Door = tuple[float, tuple[float, float], tuple[float, float], np.ndarray]
"""place along the way, before and in the room, the shut door (1, 2, 2)"""


def like(kind: str, way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way, Changes]:
    """Walls (S, 2, 2), corners of the way, and what changes on it."""
    return {"lab": lab, "wing": wing}[kind](way_m, rng)


def lab(way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way, Changes]:
    """A ring of corridor, offices within and without."""
    wide, high, half = rng.uniform(20.0, 32.0), rng.uniform(15.0, 22.0), rng.uniform(0.75, 1.1)
    west = south = 8.0
    plan = Plan(wide + 16.0, high + 16.0)
    plan.paint(west - half, south - half, west + wide + half, south + high + half)
    plan.paint(west + half, south + half, west + wide - half, south + high - half, free=False)
    edges = ((west, south, 1, 0, wide), (west + wide, south, 0, 1, high), (west + wide, south + high, -1, 0, wide),
             (west, south + high, 0, -1, high))
    doors: list[Door] = []
    for number, (*edge, length) in enumerate(edges):
        begun = (0.0, wide, wide + high, 2.0 * wide + high)[number]
        for side in (1.0, -1.0)[: 1 if number % 2 else 2]:
            most = 5.5 if side > 0 else 0.5 * high - half - 0.4
            doors += _rooms(plan, (tuple(edge), side, begun), (half, length, most), rng)
    corners = [(0.0, (west, south)), (wide, (west + wide, south)), (wide + high, (west + wide, south + high)),
               (2.0 * wide + high, (west, south + high))]
    lap_m, laps = 2.0 * (wide + high), []
    done_m = 0.0
    while done_m < way_m:
        into = 0.0 if len(laps) % 3 < 2 else rng.uniform(0.5, 0.9)
        visited = [door for door in doors if rng.random() < into]
        laps.append((corners, visited))
        done_m += lap_m + 5.0 * len(visited)
    return plan.segments(), *_driven(laps, doors, rng)


def wing(way_m: float, rng: np.random.Generator) -> tuple[np.ndarray, Way, Changes]:
    """One corridor, offices on both sides."""
    length, half = rng.uniform(30.0, 50.0), rng.uniform(0.8, 1.3)
    plan = Plan(length + 10.0, 20.0)
    plan.paint(4.0, 10.0 - half, 6.0 + length, 10.0 + half)
    doors = [door for side in (1.0, -1.0)
             for door in _rooms(plan, ((5.0, 10.0, 1, 0), side, 0.0), (half, length, 6.0), rng)]
    laps, done_m, forth = [], 0.0, True
    ends = [(0.0, (5.0, 10.0)), (length, (5.0 + length, 10.0))]
    while done_m < way_m:
        visited = [door for door in doors if rng.random() < rng.choice([0.0, 0.4, 0.8])]
        stops = [(place if forth else length - place, *rest) for place, *rest in visited]
        laps.append((ends if forth else [(length - place, corner) for place, corner in ends], stops))
        done_m, forth = done_m + length + 5.0 * len(visited), not forth
    return plan.segments(), *_driven(laps, doors, rng)


def _rooms(plan: Plan, at_edge: tuple, sizes: tuple[float, float, float], rng: np.random.Generator) -> list[Door]:
    """Furnished rooms along an edge (x, y, direction), a side of it and where the way reaches it; sizes: half the width of
    the corridor, length of the edge, depth of the rooms at most."""
    (edge, side, begun), (half, length, most), wall, at, doors = at_edge, sizes, 0.15, sizes[0] + 0.15, []
    while at + 2.5 < length - half:
        room_m, deep = min(rng.uniform(2.8, 4.5), length - half - at), min(rng.uniform(3.5, 6.0), most)
        here = partial(_beside, edge, side)
        rectangle(plan, here(at, half + wall), here(at + room_m - wall, half + wall + deep))
        door = at + rng.uniform(0.7, room_m - wall - 0.7)
        rectangle(plan, here(door - 0.45, half - 0.1), here(door + 0.45, half + wall + 0.1))
        for _ in range(int(rng.integers(3, 9))):
            a, b = at + rng.uniform(0.2, room_m - 0.4), half + wall + rng.uniform(0.9, deep)
            if abs(a - door) > 0.8 or b > half + wall + 2.8:
                plan.thing(*here(a, b), radii=np.full(int(rng.choice([4, 4, 6])), rng.uniform(0.05, 0.6)),
                           turn=rng.uniform(0.0, 1.6))
        shut = np.array([[here(door - 0.45, half + 0.05), here(door + 0.45, half + 0.05)]])
        doors.append((begun + door, here(door, 0.0), here(door, half + wall + 1.7), shut))
        at += room_m
    return doors


def _driven(laps: list, doors: list[Door], rng: np.random.Generator) -> tuple[Way, Changes]:
    """Lap after lap past the corners and into the rooms; before each some doors are shut and some things moved."""
    way: Way = []
    changes: Changes = []
    for corners, visited in laps:
        inside = {id(door[3]) for door in visited}
        shut = [door[3] for door in doors if id(door[3]) not in inside and rng.random() < 0.25]
        moved = []
        for door in doors:
            if rng.random() < 0.3:
                x, y = np.array(door[2]) + rng.uniform(-1.0, 1.0, 2)
                thing = Plan(1.0, 1.0)
                thing.thing(x, y, np.full(4, rng.uniform(0.15, 0.3)), rng.uniform(0.0, 1.6))
                moved += thing._loose if id(door[3]) not in inside else []
        changes.append((len(way), np.concatenate([np.empty((0, 2, 2)), *shut, *moved])))
        for _, *stops in sorted([*corners, *(door[:3] for door in visited)], key=lambda one: one[0]):
            way += [stops[0], stops[1], stops[0]] if len(stops) == 2 else stops
    return way, changes
