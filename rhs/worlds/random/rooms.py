"""Rooms with doors: an office along a corridor, and a home whose rooms open into one another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .furniture import furnish, put
from .sketch import Door, Sketch

KINDS = ("living", "kitchen", "bed", "bath", "bed", "office")
LEAST_ROOM_M = 2.1


class Rect(NamedTuple):
    """A room of a floor plan, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def corners(self) -> list[tuple[float, float]]:
        return [(self.x0, self.y0), (self.x1, self.y0), (self.x1, self.y1), (self.x0, self.y1)]

    @property
    def area_m2(self) -> float:
        return (self.x1 - self.x0) * (self.y1 - self.y0)


class Shared(NamedTuple):
    """The stretch of wall between two rooms, by number; `ends`: the two points, room `a` on its left-hand side."""

    a: int
    b: int
    ends: tuple[tuple[float, float], tuple[float, float]]

    @property
    def length_m(self) -> float:
        (x0, y0), (x1, y1) = self.ends
        return abs(x1 - x0) + abs(y1 - y0)


def draw_office(sketch: Sketch) -> None:
    """A corridor with rooms on one side or both; some rooms are joined by a second door."""
    length, wide = sketch.draw(6.5, 10.0), sketch.draw(1.3, 2.2)
    north = sketch.draw(2.6, 3.6)
    south = sketch.draw(2.4, 3.4) if sketch.chance(0.7) else 0.0
    rects = [Rect(0.0, south, length, south + wide)]
    for low, high in ((south + wide, south + wide + north), (0.0, south)):
        if high - low > 1.0:
            cuts = _cuts(sketch, length, int(sketch.rng.integers(2, 4 if length > 7.5 else 3)))
            rects += [Rect(a, low, b, high) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
    shared = [wall for wall in shared_walls(rects) if wall.length_m > 0.3]
    of_corridor = [wall for wall in shared if wall.a == 0]
    joined = {wall for wall in shared if wall.a != 0 and sketch.chance(0.25)}
    outline(sketch, length, south + wide + north)
    for wall in shared:
        inner_wall(sketch, wall, wall in of_corridor or wall in joined)
    sketch.hang_leaves()
    sketch.room("corridor", rects[0].corners, spot=(length * sketch.draw(0.2, 0.8), south + 0.5 * wide))
    for number, rect in enumerate(rects[1:], 1):
        sketch.room(f"room_{number}", rect.corners, kind="office")
    for room in sketch.rooms[1:]:
        furnish(sketch, room, int(sketch.rng.integers(2, 6)))
    furnish(sketch, sketch.rooms[0], int(sketch.rng.integers(0, 3)))


def draw_home(sketch: Sketch) -> None:
    """A rectangle cut into rooms; doors along a spanning tree, and some more that make loops."""
    length, top = sketch.draw(7.0, 9.6), sketch.draw(6.0, 8.0)
    rects = split(sketch, Rect(0.0, 0.0, length, top), int(sketch.rng.integers(4, 7)))
    rects.sort(key=lambda rect: -rect.area_m2)
    shared = [wall for wall in shared_walls(rects) if wall.length_m > 1.5]
    outline(sketch, length, top)
    opened = _tree(sketch, shared, len(rects))
    opened |= {wall for wall in shared if wall not in opened and sketch.chance(0.3)}
    for wall in shared_walls(rects):
        wide = wall in opened and sketch.chance(0.2) and wall.length_m > 2.4
        inner_wall(sketch, wall, wall in opened, sketch.draw(1.1, min(2.0, wall.length_m - 0.6)) if wide else None)
    sketch.hang_leaves()
    named: dict[str, int] = {}
    for rect, kind in zip(rects, KINDS, strict=False):
        named[kind] = named.get(kind, 0) + 1
        name = {"living": "living_room", "bed": "bedroom", "bath": "bathroom", "office": "study"}.get(kind, kind)
        sketch.room(name + (f"_{named[kind]}" if named[kind] > 1 else ""), rect.corners, kind=kind)
    for room in sketch.rooms:
        for name in {"bed": ("bed",), "living": ("sofa",), "kitchen": ("counter",)}.get(room.kind, ()):
            put(sketch, room, name)
        furnish(sketch, room, int(sketch.rng.integers(2, 7)))


def outline(sketch: Sketch, length_m: float, top_m: float) -> None:
    """The outer walls of a rectangle."""
    sketch.wall("outer", [(0.0, 0.0), (length_m, 0.0), (length_m, top_m), (0.0, top_m)], closed=True)


def inner_wall(sketch: Sketch, wall: Shared, opened: bool, width_m: float | None = None) -> None:
    """A wall between two rooms, with a door where it is opened; leaves stand on either side."""
    doors = []
    if opened:
        width = sketch.door_m() if width_m is None else width_m
        spare = max(0.05, 0.5 * (wall.length_m - width) - 0.12)
        at = 0.5 * wall.length_m + (sketch.draw(-spare, spare) if spare > 0.05 else 0.0)
        doors = [Door(at, width, width_m is None and sketch.chance(0.4))]
    ends = wall.ends if sketch.chance(0.5) else wall.ends[::-1]
    sketch.wall_with_doors("inner", ends, [Door(wall.length_m - d.at_m, d.width_m, d.leaf) for d in doors]
                           if ends != wall.ends else doors)


def split(sketch: Sketch, whole: Rect, count: int) -> list[Rect]:
    """The rectangle cut, largest room first, into so many rooms or as many as are not too small."""
    rooms = [whole]
    while len(rooms) < count:
        rooms.sort(key=lambda rect: rect.area_m2)
        rect = rooms[-1]
        upright = rect.x1 - rect.x0 >= rect.y1 - rect.y0
        low, high = (rect.x0, rect.x1) if upright else (rect.y0, rect.y1)
        if high - low < 2.0 * LEAST_ROOM_M:
            break
        least = max(LEAST_ROOM_M, 0.35 * (high - low))
        cut = sketch.draw(low + least, high - least)
        two = [rect._replace(x1=cut), rect._replace(x0=cut)] if upright else [rect._replace(y1=cut), rect._replace(y0=cut)]
        rooms = rooms[:-1] + two
    return rooms


def _cuts(sketch: Sketch, length_m: float, count: int) -> list[float]:
    """Where the walls between rooms in a row stand: 0, cuts, length; no room is narrower than LEAST_ROOM_M."""
    count = min(count, int(length_m / LEAST_ROOM_M))
    spare = length_m - count * LEAST_ROOM_M
    shares = sketch.rng.uniform(0.2, 1.0, count)
    widths = LEAST_ROOM_M + spare * shares / shares.sum()
    return [0.0, *(round(float(x), 4) for x in np.cumsum(widths)[:-1]), length_m]


def shared_walls(rects: list[Rect]) -> list[Shared]:
    """The stretches of wall between each two rooms that touch."""
    found = []
    for a, one in enumerate(rects):
        for b, other in enumerate(rects[a + 1 :], a + 1):
            y0, y1 = max(one.y0, other.y0), min(one.y1, other.y1)
            x0, x1 = max(one.x0, other.x0), min(one.x1, other.x1)
            if y1 - y0 > 1e-6 and one.x1 == other.x0:
                found.append(Shared(a, b, ((one.x1, y0), (one.x1, y1))))
            elif y1 - y0 > 1e-6 and one.x0 == other.x1:
                found.append(Shared(a, b, ((one.x0, y1), (one.x0, y0))))
            elif x1 - x0 > 1e-6 and one.y1 == other.y0:
                found.append(Shared(a, b, ((x1, one.y1), (x0, one.y1))))
            elif x1 - x0 > 1e-6 and one.y0 == other.y1:
                found.append(Shared(a, b, ((x0, one.y0), (x1, one.y0))))
    return found


def _tree(sketch: Sketch, walls: list[Shared], rooms: int) -> set[Shared]:
    """Walls whose doors join all rooms that can be joined, without a loop (Kruskal in drawn order)."""
    group = list(range(rooms))
    chosen = set()
    for index in sketch.rng.permutation(len(walls)):
        wall = walls[int(index)]
        if group[wall.a] != group[wall.b]:
            chosen.add(wall)
            old, new = group[wall.a], group[wall.b]
            group = [new if one == old else one for one in group]
    return chosen
