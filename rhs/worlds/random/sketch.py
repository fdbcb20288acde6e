"""A building being drawn: walls with doors in them, pillars, furniture that leaves the robot room, spots for places.

Furniture stands flush with what it touches or leaves a gap that the robot fits through (`Sketch.gap_m`), so that nothing
drawn in a room ever closes a part of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rhs.api.floorplan import Box, Surface, Wall

from .looks import Looks, furniture_surface
from .shapes import edges_of, polygon_gaps_m, turned, units, within

FLUSH_M = 0.06  # nearer than this is beside the wall
LEAF_M = 0.04  # thickness of a door leaf
BEFORE_DOOR_M = 1.0  # kept free round the middle of a door


@dataclass(frozen=True, eq=False)
class Room:
    """A space with a name: where a place may be, and its floor (N, 2), counter-clockwise, where furniture may stand."""

    name: str
    spot_m: tuple[float, float]
    floor_m: np.ndarray
    kind: str = "corridor"


@dataclass(frozen=True)
class Door:
    """An opening in a wall: metres from the wall's first point to its middle, width; and whether a leaf stands open."""

    at_m: float
    width_m: float
    leaf: bool = False


@dataclass(eq=False)
class Sketch:
    """What is drawn so far. Everything in metres, in the building's own axes."""

    rng: np.random.Generator
    looks: Looks
    robot_radius_m: float
    robot_height_m: float
    walls: list[Wall] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    rooms: list[Room] = field(default_factory=list)
    doors_m: list[tuple[float, float]] = field(default_factory=list)
    leaves: list[tuple[np.ndarray, np.ndarray, float]] = field(default_factory=list)  # hinge, direction of the wall, width

    @property
    def gap_m(self) -> float:
        """Between two things that the robot should pass between."""
        return 2.0 * (self.robot_radius_m + 0.1) + 0.12

    def draw(self, low: float, high: float) -> float:
        """A length, to the tenth of a millimetre."""
        return round(float(self.rng.uniform(low, high)), 4)

    def chance(self, share: float) -> bool:
        """True in that share of the draws."""
        return bool(self.rng.uniform() < share)

    def door_m(self) -> float:
        """Width of a door: 0.8 to 1 m, and never too narrow for the robot."""
        return self.draw(max(0.8, self.gap_m + 0.04), 1.0)

    # --- walls ------------------------------------------------------------------------------------------------------

    def wall(self, name: str, points: Sequence[Sequence[float]] | np.ndarray, *, closed: bool = False,
             paintings: bool = True) -> None:
        """A wall along points; its surface is one of the building's few."""
        corners = np.array(points, float)
        corners = np.vstack([corners, corners[:1]]) if closed else corners
        kind = self.looks.walls[int(self.rng.integers(3)) if self.chance(0.4) else 0]
        self.walls.append(Wall(self._own(name, self.walls), corners, self.looks.wall_height_m, kind, paintings))

    def wall_with_doors(self, name: str, ends: Sequence[Sequence[float]], doors: Sequence[Door]) -> None:
        """A straight wall with openings; a leaf opens to the left-hand side of the wall's direction (`hang_leaves`)."""
        a, b = np.array(ends, float)
        length = float(np.hypot(*(b - a)))
        way, at = (b - a) / length, 0.0
        for door in sorted(doors, key=lambda door: door.at_m):
            low, high = door.at_m - 0.5 * door.width_m, door.at_m + 0.5 * door.width_m
            if low - at > 0.02:
                self.wall(name, [a + way * at, a + way * low])
            middle = a + way * door.at_m
            self.doors_m.append((float(middle[0]), float(middle[1])))
            if door.leaf:
                self.leaves.append((a + way * low, way, door.width_m))
            at = high
        if length - at > 0.02:
            self.wall(name, [a + way * at, b])

    def hang_leaves(self) -> None:
        """Put in the leaves of the doors drawn so far, open by about a right angle: when all walls stand, before there is
        furniture. One that would swing into another wall is left out."""
        for hinge, way, width in self.leaves:
            swing = np.radians(self.draw(85.0, 120.0))
            c, s = math.cos(swing), math.sin(swing)
            along = np.array([c * way[0] - s * way[1], s * way[0] + c * way[1]])
            middle = hinge + along * (0.5 * width + 0.015) - way * 0.5 * LEAF_M
            yaw, look = math.atan2(along[1], along[0]), furniture_surface(self.rng)
            if polygon_gaps_m(rectangle(middle, (width, LEAF_M), yaw), self.segments_m()).min() > 0.0:
                size = (width, LEAF_M, min(2.0, self.looks.wall_height_m - 0.05))
                self.box("door", middle, size, yaw_rad=yaw, surface=look)
        self.leaves.clear()

    def _own(self, name: str, others: Sequence[Wall] | Sequence[Box]) -> str:
        """The name with the next free number: names are unique, and textures hang on them."""
        return f"{name} {sum(1 for other in others if other.name.rpartition(' ')[0] == name) + 1}"

    def room(self, name: str, floor: Sequence[Sequence[float]] | np.ndarray, *, kind: str = "corridor",
             spot: Sequence[float] | None = None) -> Room:
        """Remember a space; its place is the middle of its corners if no spot is said."""
        corners = np.array(floor, float)
        x, y = corners.mean(axis=0) if spot is None else spot
        self.rooms.append(Room(name, (float(x), float(y)), corners, kind))
        return self.rooms[-1]

    # --- things -----------------------------------------------------------------------------------------------------

    def segments_m(self) -> np.ndarray:
        """(S, 2, 2) of all walls and the sides of all boxes."""
        parts = [wall.segments_m for wall in self.walls] + [edges_of(box.corners_m) for box in self.boxes]
        return np.concatenate(parts) if parts else np.empty((0, 2, 2))

    def fits(self, footprint_m: np.ndarray) -> bool:
        """Whether a convex footprint (N, 2) stands beside what it touches or leaves the robot a way, and no door is
        blocked. What lies wholly within something else does not fit."""
        gaps = polygon_gaps_m(footprint_m, self.segments_m())
        if ((gaps == 0.0) | ((gaps > FLUSH_M) & (gaps < self.gap_m))).any():
            return False
        if any(within(footprint_m[:1], box.corners_m)[0] for box in self.boxes):
            return False
        doors = np.array(self.doors_m or [(1e6, 1e6)])
        return bool(polygon_gaps_m(footprint_m, np.stack([doors, doors], axis=1)).min() >= BEFORE_DOOR_M)

    def pillar(self, middle: Sequence[float] | np.ndarray, width_m: float, *, corners: int, yaw_rad: float = 0.0) -> None:
        """A free-standing pillar up to the ceiling, as a closed wall: round with many corners, square with four."""
        turn = yaw_rad - 2.0 * np.pi * (np.arange(corners) + 0.5) / corners  # clockwise: the pattern faces outwards
        radius = 0.5 * width_m / math.cos(math.pi / corners)
        ring = np.array(middle, float) + radius * units(turn)
        self.wall("pillar", ring, closed=True, paintings=False)

    def box(self, name: str, middle: Sequence[float] | np.ndarray, size: Sequence[float], *, yaw_rad: float = 0.0,
            bottom_m: float = 0.0, surface: Surface | None = None) -> Box:
        """A box that is not asked whether it fits."""
        made = Box(self._own(name, self.boxes), (float(middle[0]), float(middle[1])),
                   (float(size[0]), float(size[1]), float(size[2])), float(yaw_rad), float(bottom_m),
                   surface or furniture_surface(self.rng))
        self.boxes.append(made)
        return made

    def against_wall(self, room: Room, width_m: float, depth_m: float) -> tuple[np.ndarray, float] | None:
        """(middle, yaw) of a footprint standing with its back to a side of the room's floor, or None after eight draws."""
        sides = edges_of(room.floor_m)
        for _ in range(8):
            a, b = sides[int(self.rng.integers(len(sides)))]
            length, behind = float(np.hypot(*(b - a))), self.draw(0.015, 0.05)
            share = self.rng.uniform()
            if length < width_m + 0.1:
                continue
            way = (b - a) / length
            at = 0.5 * width_m + 0.04 + (length - width_m - 0.08) * (0.0 if share < 0.25 else min(1.0, share * 1.2 - 0.2))
            middle = a + way * at + np.array([-way[1], way[0]]) * (0.5 * depth_m + behind)
            yaw = math.atan2(way[1], way[0])
            if self.fits(rectangle(middle, (width_m, depth_m), yaw)):
                return middle, yaw
        return None

    def in_the_open(self, room: Room, width_m: float, depth_m: float) -> tuple[np.ndarray, float] | None:
        """(middle, yaw) of a footprint standing free in the room, or None after eight draws."""
        low, high = room.floor_m.min(axis=0), room.floor_m.max(axis=0)
        first = room.floor_m[1] - room.floor_m[0]
        for _ in range(8):
            middle = low + (high - low) * self.rng.uniform(0.0, 1.0, 2)
            yaw = math.atan2(first[1], first[0]) + (self.draw(-0.8, 0.8) if self.chance(0.3) else 0.0)
            if within(middle[None], room.floor_m)[0] and self.fits(rectangle(middle, (width_m, depth_m), yaw)):
                return middle, yaw
        return None


def rectangle(middle: Sequence[float] | np.ndarray, size: tuple[float, float], yaw_rad: float) -> np.ndarray:
    """(4, 2) corners, counter-clockwise."""
    half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(size)
    corners: np.ndarray = turned(half, yaw_rad) + np.array(middle, float)
    return corners
