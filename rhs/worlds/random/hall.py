"""A hall: pillars, benches and screens in one large room; perhaps a lobby beside it."""

from __future__ import annotations

import math

import numpy as np

from .furniture import furnish
from .sketch import Door, Room, Sketch, rectangle


def draw_hall(sketch: Sketch) -> None:
    """A large room with pillars in rows or anywhere; in half the buildings a lobby behind two doors."""
    wide, deep = sketch.draw(6.5, 9.5), sketch.draw(5.5, 8.0)
    lobby = sketch.draw(1.6, 2.4) if sketch.chance(0.5) else 0.0
    sketch.wall("outer", [(-lobby, 0.0), (wide, 0.0), (wide, deep), (-lobby, deep)], closed=True)
    if lobby:
        first, second = deep * sketch.draw(0.18, 0.32), deep * sketch.draw(0.68, 0.82)
        doors = [Door(first, sketch.door_m(), sketch.chance(0.3)), Door(second, sketch.door_m() * 1.5)]
        sketch.wall_with_doors("screen", ((0.0, deep), (0.0, 0.0)), doors[: 1 if sketch.chance(0.4) else 2])
        sketch.hang_leaves()
        sketch.room("lobby", [(-lobby, 0.0), (0.0, 0.0), (0.0, deep), (-lobby, deep)])
    hall = sketch.room("hall", [(0.0, 0.0), (wide, 0.0), (wide, deep), (0.0, deep)], kind="hall")
    _pillars(sketch, wide, deep)
    _screens(sketch, hall)
    corners = (("south_west", 0.2, 0.2), ("south_east", 0.8, 0.2), ("north_east", 0.8, 0.8), ("north_west", 0.2, 0.8))
    for name, x, y in corners:
        sketch.room(name, hall.floor_m, kind="hall", spot=(wide * x, deep * y))
    furnish(sketch, hall, int(sketch.rng.integers(2, 6)))
    if lobby:
        furnish(sketch, sketch.rooms[0], int(sketch.rng.integers(0, 2)))


def _pillars(sketch: Sketch, wide_m: float, deep_m: float) -> None:
    """Rows of equal pillars, a little out of line or not; round or square; some are missing."""
    width, corners = sketch.draw(0.25, 0.6), (4, 4, 12)[int(sketch.rng.integers(3))]
    turn = sketch.draw(-0.7, 0.7) if sketch.chance(0.3) else 0.0
    stray = sketch.draw(0.0, 0.35)
    columns, rows = int(wide_m / sketch.draw(2.1, 3.2)), int(deep_m / sketch.draw(2.1, 3.2))
    for i in range(1, columns + 1):
        for j in range(1, rows + 1):
            x = wide_m * i / (columns + 1) + sketch.draw(-stray, stray)
            y = deep_m * j / (rows + 1) + sketch.draw(-stray, stray)
            if sketch.chance(0.85) and sketch.fits(rectangle((x, y), (width, width), turn)):
                sketch.pillar((x, y), width, corners=corners, yaw_rad=turn)


def _screens(sketch: Sketch, hall: Room) -> None:
    """Free-standing pieces of wall that hide what is behind them."""
    for _ in range(int(sketch.rng.integers(0, 3))):
        length = sketch.draw(1.0, 2.2)
        where = sketch.in_the_open(hall, length, 0.05)
        if where is not None:
            half = 0.5 * length * np.array([math.cos(where[1]), math.sin(where[1])])
            sketch.wall("screen", np.array([where[0] - half, where[0] + half]))
