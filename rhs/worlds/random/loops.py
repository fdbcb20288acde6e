"""Corridors round blocks: one loop, or loops that share a side."""

from __future__ import annotations

import numpy as np

from .furniture import furnish
from .sketch import Sketch

Corners = list[tuple[float, float]]


def draw_loop(sketch: Sketch) -> None:
    """One block with a corridor round it; each side has its own width."""
    south, east, north, west = (sketch.draw(1.1, 1.9) if sketch.chance(0.6) else sketch.draw(1.7, 3.0) for _ in range(4))
    if sketch.chance(0.2):
        south = sketch.draw(2.6, 3.5)
    wide, deep = sketch.draw(2.4, 4.6), sketch.draw(2.0, 3.8)
    right, top = west + wide + east, south + deep + north
    outer: Corners = [(0.0, 0.0), (right, 0.0), (right, top), (0.0, top)]
    if sketch.chance(0.35):
        outer = _recess(sketch, outer, depth_m=sketch.draw(0.6, 1.2), width_m=sketch.draw(1.0, 2.0))
    elif sketch.chance(0.45):
        outer = _recess(sketch, outer, depth_m=sketch.draw(2.0, 3.2), width_m=sketch.draw(1.1, 1.8))
    sketch.wall("outer", outer, closed=True)
    block: Corners = [(west, south), (west, south + deep), (west + wide, south + deep), (west + wide, south)]
    if sketch.chance(0.3):
        x, y = west + wide * sketch.draw(0.45, 0.7), south + deep * sketch.draw(0.45, 0.7)
        block = [*block[:2], (x, south + deep), (x, y), (west + wide, y), block[3]]
    sketch.wall("block", block, closed=True)
    _corridor(sketch, "south_corridor", (0.0, 0.0), (right, south))
    _corridor(sketch, "east_corridor", (right - east, 0.0), (right, top))
    _corridor(sketch, "north_corridor", (0.0, top - north), (right, top))
    _corridor(sketch, "west_corridor", (0.0, 0.0), (west, top))
    for room in sketch.rooms[:4]:
        furnish(sketch, room, int(sketch.rng.integers(0, 3)))


def draw_ladder(sketch: Sketch) -> None:
    """Blocks in a row, or two rows of two, between corridors 1.1 to 2 m wide."""
    columns, rows = ((2, 1), (3, 1), (2, 2))[int(sketch.rng.integers(3))]
    wide = [sketch.draw(1.3, 2.8) for _ in range(columns)]
    deep = [sketch.draw(1.5, 3.2 if rows == 1 else 2.2) for _ in range(rows)]
    upright = [sketch.draw(1.1, 2.0) for _ in range(columns + 1)]
    level = [sketch.draw(1.1, 2.0) for _ in range(rows + 1)]
    right, top = sum(wide) + sum(upright), sum(deep) + sum(level)
    sketch.wall("outer", [(0.0, 0.0), (right, 0.0), (right, top), (0.0, top)], closed=True)
    lefts = np.cumsum([0.0, *(a + b for a, b in zip(upright, wide, strict=False))])
    lows = np.cumsum([0.0, *(a + b for a, b in zip(level, deep, strict=False))])
    for i in range(columns):
        for j in range(rows):
            x, y = float(lefts[i]) + upright[i], float(lows[j]) + level[j]
            sketch.wall("block", [(x, y), (x, y + deep[j]), (x + wide[i], y + deep[j]), (x + wide[i], y)], closed=True)
    for i in range(columns + 1):
        _corridor(sketch, f"rung_{i + 1}", (float(lefts[i]), 0.0), (float(lefts[i]) + upright[i], top))
    for j in range(rows + 1):
        _corridor(sketch, f"rail_{j + 1}", (0.0, float(lows[j])), (right, float(lows[j]) + level[j]))
    for room in sketch.rooms:
        furnish(sketch, room, int(sketch.rng.integers(0, 2)))


def _corridor(sketch: Sketch, name: str, low: tuple[float, float], high: tuple[float, float]) -> None:
    """A stretch of corridor; its place lies somewhere in its middle half."""
    share = sketch.draw(0.3, 0.7)
    (x0, y0), (x1, y1) = low, high
    spot = (x0 + share * (x1 - x0), 0.5 * (y0 + y1)) if x1 - x0 > y1 - y0 else (0.5 * (x0 + x1), y0 + share * (y1 - y0))
    sketch.room(name, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)], spot=spot)


def _recess(sketch: Sketch, outer: Corners, *, depth_m: float, width_m: float) -> Corners:
    """The outline with a niche or a dead end let into one of its sides."""
    side = int(sketch.rng.integers(len(outer)))
    a, b = np.array(outer[side]), np.array(outer[(side + 1) % len(outer)])
    length = float(np.hypot(*(b - a)))
    at = sketch.draw(0.15, 0.85) * (length - width_m)
    way = (b - a) / length
    out = np.array([way[1], -way[0]]) * depth_m
    near, far = a + way * at, a + way * (at + width_m)
    points = [near, near + out, far + out, far]
    if depth_m > 1.5:
        sketch.room("dead_end", [near, near + out, far + out, far], spot=(0.5 * (near + far) + 0.75 * out).tolist())
    return [*outer[: side + 1], *((float(x), float(y)) for x, y in points), *outer[side + 1 :]]
