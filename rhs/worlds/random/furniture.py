"""Furniture of drawn buildings: low (0.3 to 0.75 m), tall, and what hangs over nothing: table tops, shelves on a wall."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from .looks import furniture_surface
from .shapes import turned
from .sketch import Room, Sketch

# name -> width, depth, height: least and greatest, metres
SOLID: Mapping[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "sofa": ((1.4, 2.2), (0.75, 0.95), (0.6, 0.8)),
    "bed": ((1.9, 2.1), (0.9, 1.6), (0.4, 0.6)),
    "wardrobe": ((0.8, 1.6), (0.5, 0.65), (1.7, 2.1)),
    "shelf": ((0.6, 1.5), (0.28, 0.4), (1.4, 2.0)),
    "sideboard": ((0.8, 1.6), (0.35, 0.5), (0.45, 0.75)),
    "counter": ((1.2, 2.4), (0.55, 0.65), (0.85, 0.95)),
    "fridge": ((0.55, 0.7), (0.55, 0.7), (1.4, 1.9)),
    "bathtub": ((1.5, 1.8), (0.7, 0.8), (0.5, 0.6)),
    "cabinet": ((0.4, 0.9), (0.35, 0.5), (0.3, 1.3)),
    "bench": ((0.9, 1.8), (0.35, 0.5), (0.4, 0.5)),
    "chair": ((0.4, 0.5), (0.4, 0.5), (0.45, 0.9)),
    "coffee table": ((0.6, 1.1), (0.45, 0.6), (0.35, 0.5)),
    "crate": ((0.35, 0.7), (0.35, 0.7), (0.3, 0.75)),
    "plant": ((0.3, 0.4), (0.3, 0.4), (0.7, 1.5)),
    "bin": ((0.28, 0.35), (0.28, 0.35), (0.3, 0.6)),
}
FREE_STANDING = ("coffee table", "chair", "crate", "plant", "bin", "bench")

BY_KIND: Mapping[str, Sequence[str]] = {
    "corridor": ("cabinet", "bench", "plant", "bin", "shelf", "wall shelf", "crate"),
    "office": ("desk", "shelf", "cabinet", "chair", "desk", "bin", "table", "wall shelf", "sideboard"),
    "living": ("sofa", "coffee table", "sideboard", "shelf", "table", "plant", "chair", "wall shelf"),
    "kitchen": ("counter", "fridge", "table", "chair", "wall shelf"),
    "bed": ("bed", "wardrobe", "cabinet", "chair", "shelf"),
    "bath": ("bathtub", "cabinet", "bin", "wall shelf"),
    "hall": ("bench", "crate", "table", "plant", "sideboard", "bench", "shelf"),
}


def furnish(sketch: Sketch, room: Room, count: int) -> None:
    """Up to so many things that go with the kind of room; what finds no room is left out."""
    kinds = BY_KIND[room.kind]
    for _ in range(count):
        put(sketch, room, kinds[int(sketch.rng.integers(len(kinds)))])


def put(sketch: Sketch, room: Room, name: str) -> bool:
    """One thing in the room; False where it found no room."""
    lengths, made = OVER_FLOOR.get(name) or (SOLID[name], None)
    size = [sketch.draw(*limits) for limits in lengths]
    free = name == "table" or (name in FREE_STANDING and sketch.chance(0.6))
    where = (sketch.in_the_open if free else sketch.against_wall)(room, *size[:2])
    if where is not None and made is not None:
        made(sketch, *where, size)
    elif where is not None:
        sketch.box(name, where[0], (*size[:2], min(size[2], sketch.looks.wall_height_m - 0.05)), yaw_rad=where[1])
    return where is not None


def _table(sketch: Sketch, middle: np.ndarray, yaw: float, size: Sequence[float]) -> None:
    """A top on four legs, or on one column. Where the robot is so low that it would fit beneath, a chest."""
    (width, depth), under = size, sketch.draw(0.66, 0.72)
    look = furniture_surface(sketch.rng)
    if sketch.robot_height_m < under + 0.1:
        sketch.box("chest", middle, (width, depth, under), yaw_rad=yaw, surface=look)
        return
    sketch.box("table top", middle, (width, depth, 0.03), yaw_rad=yaw, bottom_m=under, surface=look)
    if sketch.chance(0.3):
        sketch.box("table column", middle, (0.12, 0.12, under), yaw_rad=yaw, surface=look)
        return
    for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        leg = turned(np.array([x * (0.5 * width - 0.04), y * (0.5 * depth - 0.04)]), yaw) + middle
        sketch.box("table leg", leg, (0.05, 0.05, under), yaw_rad=yaw, surface=look)


def _wall_shelf(sketch: Sketch, middle: np.ndarray, yaw: float, size: Sequence[float]) -> None:
    """A board or box on the wall, over nothing; always lower than the robot, so that it counts."""
    bottom = sketch.draw(0.3, 1.0) * (sketch.robot_height_m - 0.1)
    sketch.box("wall shelf", middle, size, yaw_rad=yaw, bottom_m=round(bottom, 4))


# name -> width, depth and what else is drawn of its size; what is put there
OVER_FLOOR: Mapping[str, tuple[Sequence[tuple[float, float]], Callable[..., None]]] = {
    "table": (((0.8, 1.4), (0.6, 0.85)), _table), "desk": (((1.0, 1.6), (0.6, 0.8)), _table),
    "wall shelf": (((0.5, 1.2), (0.2, 0.32), (0.03, 0.35)), _wall_shelf)}
