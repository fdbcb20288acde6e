"""Buildings without right angles: rings, stars and zigzags of corridors, rooms that are askew."""

from __future__ import annotations

import math

import numpy as np

from rhs.base.errors import ConfigError

from .furniture import furnish
from .shapes import edges_of, is_convex, shifted_sides, units
from .sketch import Door, Sketch


def draw_non_manhattan(sketch: Sketch) -> None:
    """One of five kinds."""
    (draw_ring, draw_polygon, draw_star, draw_zigzag, draw_skew_rooms)[int(sketch.rng.integers(5))](sketch)


def draw_ring(sketch: Sketch) -> None:
    """A curved corridor round an oval block, of 24 to 36 straight pieces."""
    pieces, wide = int(sketch.rng.integers(24, 37)), sketch.draw(1.3, 2.4)
    a, b = sketch.draw(1.6, 2.6) + wide, sketch.draw(1.4, 2.2) + wide
    angle = 2.0 * np.pi * np.arange(pieces) / pieces
    unit = units(angle)
    outer, inner = unit * (a, b), unit * (a - wide, b - wide)
    sketch.wall("outer", outer, closed=True)
    sketch.wall("block", inner[::-1], closed=True)
    _places_round(sketch, outer, inner, 4)


def draw_polygon(sketch: Sketch) -> None:
    """A corridor round a block with three, five, six or seven sides; each side has its own angle and width."""
    count = (3, 5, 6, 7)[int(sketch.rng.integers(4))]
    for _ in range(40):
        angle = 2.0 * np.pi * (np.arange(count) + sketch.rng.uniform(-0.16, 0.16, count)) / count
        radius = sketch.draw(5.2, 6.0) if count == 3 else sketch.draw(3.9, 4.8)
        outer = units(angle) * radius * sketch.rng.uniform(0.92, 1.08, count)[:, None]
        widths = sketch.rng.uniform(1.2, 1.7 if count == 3 else 2.1, count)
        inner = shifted_sides(outer, widths)
        if is_convex(outer, least_side_m=2.0) and is_convex(inner, least_side_m=1.0):
            sketch.wall("outer", outer, closed=True)
            sketch.wall("block", inner[::-1], closed=True)
            _places_round(sketch, outer, inner, count)
            return
    raise ConfigError("no polygon was drawn that leaves a block in its middle")


def draw_star(sketch: Sketch) -> None:
    """Three or four corridors that meet at odd angles and end blindly."""
    arms = int(sketch.rng.integers(3, 5))
    steps = sketch.rng.uniform(1.0, 1.9 if arms == 4 else 2.0, arms)
    angle = np.cumsum(2.0 * np.pi * steps / steps.sum())
    half = 0.5 * sketch.rng.uniform(1.2, 2.3, arms)
    length = sketch.rng.uniform(3.2, 5.0, arms)
    way = units(angle)
    left = np.stack([-way[:, 1], way[:, 0]], axis=1)
    outer: list[np.ndarray] = []
    for i in range(arms):
        j = (i + 1) % arms
        end = way[i] * length[i]
        # where the left side of arm i meets the right side of the next
        (a, b), (c, d), (x, y) = way[i], way[j], -left[j] * half[j] - left[i] * half[i]
        along = (c * y - d * x) / (b * c - a * d), (a * y - b * x) / (b * c - a * d)
        outer += [end - left[i] * half[i], end + left[i] * half[i], left[i] * half[i] + way[i] * along[0]]
        if not (-1.5 < along[0] < length[i] - 1.0 and along[1] < length[j] - 1.0):
            raise ConfigError("two arms of the star run into each other")
        floor = [way[i] - left[i] * half[i], end - left[i] * half[i], end + left[i] * half[i], way[i] + left[i] * half[i]]
        sketch.room(f"arm_{i + 1}", floor, spot=way[i] * (length[i] - sketch.draw(0.8, 1.4)))
    sketch.wall("outer", np.array(outer), closed=True)
    sketch.room("middle", [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    _furnish(sketch, arms)


def draw_zigzag(sketch: Sketch) -> None:
    """One corridor with two to four bends of 30 to 75 degrees, alternately left and right or as drawn."""
    bends, wide = int(sketch.rng.integers(2, 5)), sketch.draw(1.3, 2.3)
    heading, points = 0.0, [np.zeros(2)]
    for i in range(bends + 1):
        points.append(points[-1] + sketch.draw(2.6, 4.2) * np.array([math.cos(heading), math.sin(heading)]))
        sign = 1.0 if (i % 2 == 0 or sketch.chance(0.2)) else -1.0
        heading += sign * sketch.draw(np.radians(30.0), np.radians(75.0))
    middle = np.array(points)
    right, left = _beside(middle, -0.5 * wide), _beside(middle, 0.5 * wide)
    sketch.wall("outer", np.vstack([right, left[::-1]]), closed=True)
    for i in range(bends + 1):
        share = sketch.draw(0.35, 0.65)
        sketch.room(f"stretch_{i + 1}", [right[i], right[i + 1], left[i + 1], left[i]],
                    spot=middle[i] * (1.0 - share) + middle[i + 1] * share)
    _furnish(sketch, bends + 1)


def draw_skew_rooms(sketch: Sketch) -> None:
    """A quadrilateral without right angles, cut twice by walls that are not parallel to anything; two doors each way."""
    for _ in range(40):
        outer = np.array([(0.0, 0.0), (8.4, 0.0), (8.4, 7.0), (0.0, 7.0)]) + sketch.rng.uniform(-1.3, 1.3, (4, 2))
        if is_convex(outer, least_side_m=4.5):
            break
    else:
        raise ConfigError("no convex outline was drawn")
    a, b, c, d = outer
    t, u, v = sketch.draw(0.4, 0.6), sketch.draw(0.4, 0.6), sketch.draw(0.4, 0.6)
    south, north = a + t * (b - a), d + u * (c - d)
    west, cross = a + v * (d - a), south + sketch.draw(0.4, 0.6) * (north - south)
    sketch.wall("outer", outer, closed=True)
    for name, p, q in (("divide", south, cross), ("divide", cross, north), ("across", west, cross)):
        length = float(np.hypot(*(q - p)))
        sketch.wall_with_doors(name, (p, q), [Door(length * sketch.draw(0.35, 0.65), sketch.door_m(), sketch.chance(0.3))])
    sketch.hang_leaves()
    for name, floor in (("south_west", [a, south, cross, west]), ("east", [south, b, c, north]),
                        ("north_west", [west, cross, north, d])):
        room = sketch.room(name, floor, kind="office")
        furnish(sketch, room, int(sketch.rng.integers(1, 5)))


def _beside(middle: np.ndarray, by_m: float) -> np.ndarray:
    """(N, 2) the polyline moved to its left by so much, mitred at its bends."""
    way = np.diff(middle, axis=0)
    way /= np.hypot(way[:, 0], way[:, 1])[:, None]
    left = np.stack([-way[:, 1], way[:, 0]], axis=1)
    first, last = np.vstack([left[:1], left]), np.vstack([left, left[-1:]])
    mitre = (first + last) / (1.0 + (first * last).sum(axis=1))[:, None]
    moved: np.ndarray = middle + by_m * mitre
    return moved


def _places_round(sketch: Sketch, outer: np.ndarray, inner: np.ndarray, count: int) -> None:
    """Stretches of a ring between an outer and an inner outline with as many corners."""
    parts = np.array_split(np.arange(len(outer)), count)
    for number, part in enumerate(parts, 1):
        ends = [*part, (part[-1] + 1) % len(outer)]
        at = len(part) // 2
        spot = 0.25 * (outer[ends[at]] + inner[ends[at]] + outer[ends[at] - 1] + inner[ends[at] - 1]) if len(part) > 1 else \
            0.25 * (outer[ends] + inner[ends]).sum(axis=0)
        sketch.room(f"stretch_{number}", np.vstack([outer[ends], inner[ends][::-1]]), spot=spot)
    _furnish(sketch, count)


def _furnish(sketch: Sketch, count: int) -> None:
    for room in sketch.rooms[:count]:
        if edges_of(room.floor_m).shape[0] == 4:
            furnish(sketch, room, int(sketch.rng.integers(0, 2)))
