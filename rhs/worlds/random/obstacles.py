"""What stands otherwise after the survey: boxes of 0.3 to 0.6 m put beside the way and behind corners, now and then a
barrier that closes it; chairs, crates, bins and the like, moved or taken away."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np

from rhs.api.floorplan import Box, World, after, truth_grid
from rhs.api.grid import configuration_space

from .furniture import FREE_STANDING
from .looks import furniture_surface
from .shapes import edges_of, nearest_gap_m, polygon_gaps_m
from .sketch import rectangle

BARRIERS = 0.15  # share of the buildings with obstacles in which one of them closes the way from wall to wall
MOST_BARRIERS = 3  # put in to cut a place off: in a loop it takes two
TRIES = 60
TAKEN = 0.3  # share of the things moved that are taken away
MOVED_M = (0.4, 2.5)  # how far the others


def with_drawn_obstacles(world: World, rng: np.random.Generator) -> World:
    """The world with one to three obstacles that the survey does not see. None stands where the robot waits or on a place,
    and none cuts a place off, but a barrier may: the true plan knows which places can still be reached."""
    barrier = rng.uniform() < BARRIERS
    if barrier:
        world = _barred(world, rng)
    for _ in range(int(rng.integers(0 if world.obstacles else 1, 3 if barrier else 4))):
        world = with_box(world, rng)
    return world


def with_drawn_barriers(world: World, rng: np.random.Generator) -> World:
    """The world with as many barriers as it takes until some places can no longer be reached from where the survey ended,
    though others can; without any if all draws fail."""
    before = len(reached(world, radius_m=world.robot_radius_m))
    for _ in range(TRIES // MOST_BARRIERS):
        barred = world
        for _ in range(MOST_BARRIERS):
            barred = _barred(barred, rng)
            if 1 < len(reached(after(barred), radius_m=0.5 * world.robot_radius_m)) < before:
                return barred
    return world


def reached(world: World, *, radius_m: float) -> list[str]:
    """Names of the places that a round robot can get to from the end of the survey, on a grid of 5 cm."""
    standing = replace(world, start=(float(world.route_m[-1, 0]), float(world.route_m[-1, 1]), 0.0))
    grid = truth_grid(standing, 0.05)
    from scipy.ndimage import label

    regions, _ = label(~configuration_space(~grid.free(), radius_m / grid.resolution_m), structure=np.ones((3, 3)))
    row, column = grid.cells(world.route_m[-1:])[0]
    here = regions[row, column]
    cells = grid.cells(np.array([place[1:] for place in world.places]))
    return [place[0] for place, (r, c) in zip(world.places, cells, strict=True) if here > 0 and regions[r, c] == here]


def with_box(world: World, rng: np.random.Generator) -> World:
    """One more box beside the survey's way that leaves a way past; none if all draws fail."""
    radius = world.robot_radius_m
    before = reached(after(world), radius_m=radius + 0.05)
    for _ in range(TRIES):
        middle = _beside_way(world.route_m, rng, out_m=0.75)
        size = (float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.3, 0.6)))
        yaw = float(rng.uniform(-1.57, 1.57))
        if not stands(world, middle, size, yaw):
            continue
        other = _put(world, "obstacle", middle, (*size, float(rng.uniform(0.3, 1.6))), yaw, rng)
        if reached(after(other), radius_m=radius + 0.05) == before:
            return other
    return world


def _barred(world: World, rng: np.random.Generator) -> World:
    """A barrier across the way, from the nearest wall on one side to that on the other; none if all draws fail."""
    for _ in range(TRIES):
        middle, heading = _on_way(world.route_m, rng)
        across = heading + 0.5 * np.pi
        way = np.array([math.cos(across), math.sin(across)])
        walls = np.concatenate([wall.segments_m for wall in world.walls])
        reach = np.arange(0.0, 2.0, 0.02)
        left, right = (_open_m(middle + sign * reach[:, None] * way, walls, reach) for sign in (1.0, -1.0))
        if not 0.6 < left + right < 2.6:
            continue
        centre = middle + 0.5 * (left - right) * way
        size = (left + right - 0.06, float(rng.uniform(0.1, 0.4)))
        if stands(world, centre, size, across):
            return _put(world, "barrier", centre, (*size, float(rng.uniform(0.8, 1.8))), across, rng)
    return world


def _open_m(points: np.ndarray, walls: np.ndarray, reach: np.ndarray) -> float:
    """How far along a ray nothing is nearer than 2 cm."""
    near = nearest_gap_m(points, walls) < 0.02
    return float(reach[int(np.argmax(near))]) if near.any() else np.inf


def _on_way(route_m: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """A point of the survey and its heading there, every metre equally likely."""
    lengths = np.hypot(*np.diff(route_m, axis=0).T)
    ends = np.cumsum(lengths)
    at = float(rng.uniform(0.0, ends[-1]))
    leg = min(int(np.searchsorted(ends, at)), len(lengths) - 1)
    a, b = route_m[leg], route_m[leg + 1]
    share = 1.0 - (ends[leg] - at) / lengths[leg]
    return a + share * (b - a), math.atan2(*(b - a)[::-1])


def _beside_way(route_m: np.ndarray, rng: np.random.Generator, *, out_m: float) -> np.ndarray:
    """A point up to so far beside the survey; half of them just past a corner of the way, where nobody looks ahead."""
    middle, heading = _on_way(route_m, rng)
    if rng.uniform() < 0.5 and len(route_m) > 3:
        corner = int(rng.integers(1, len(route_m) - 1))
        a, b = route_m[corner], route_m[corner + 1]
        heading = math.atan2(*(b - a)[::-1])
        middle = a + float(rng.uniform(0.5, 1.4)) * np.array([math.cos(heading), math.sin(heading)])
    aside = float(rng.uniform(-out_m, out_m))
    return middle + aside * np.array([-math.sin(heading), math.cos(heading)])


def stands(world: World, middle: np.ndarray, size: tuple[float, float], yaw: float) -> bool:
    """In the building, through no wall and no box, and off the robot's start, its waiting place and every place."""
    footprint = rectangle(middle, size, yaw)
    solid = [wall.segments_m for wall in world.walls] + [edges_of(box.corners_m) for box in world.boxes + world.obstacles]
    solid += [] if world.mesh is None else [edges_of(outline) for outline in world.mesh.solid_m]
    if polygon_gaps_m(footprint, np.concatenate(solid)).min() <= 0.01:
        return False
    keep = np.array([world.start[:2], world.route_m[-1], *(place[1:] for place in world.places)])
    if polygon_gaps_m(footprint, np.stack([keep, keep], axis=1)).min() < world.robot_radius_m + 0.15:
        return False
    grid = truth_grid(world)
    row, column = grid.cells(middle[None])[0]
    return bool(0 <= row < grid.shape[0] and 0 <= column < grid.shape[1] and grid.probability[row, column] == 0.0)


def _put(world: World, name: str, middle: np.ndarray, size: tuple[float, float, float], yaw: float,
         rng: np.random.Generator) -> World:
    """The world with one box more."""
    x, y = middle.round(4)
    width, depth, height = (round(length, 4) for length in size)
    box = Box(f"{name} {len(world.obstacles) + 1}", (float(x), float(y)), (width, depth, height), round(yaw, 6), 0.0,
              furniture_surface(rng))
    return replace(world, obstacles=(*world.obstacles, box))


def movable(world: World) -> list[Box]:
    """The things that somebody moves without a second pair of hands."""
    named = re.compile(rf"\b({'|'.join(FREE_STANDING)})\b")
    return [box for box in world.boxes if named.search(re.sub(r"[_\d]+", " ", box.name))]


def with_drawn_moves(world: World, rng: np.random.Generator) -> World:
    """The world in which one to three things are moved or taken away between survey and patrol. None comes to stand where
    the robot waits or on a place, and none cuts a place off."""
    things = movable(world)
    for index in rng.permutation(len(things))[: int(rng.integers(1, 4))]:
        world = rearranged(world, things[int(index)], rng)
    return world


def rearranged(world: World, box: Box, rng: np.random.Generator) -> World:
    """The world in which that thing is moved or taken away."""
    return _taken(world, box) if rng.uniform() < TAKEN else _moved(world, box, rng)


def _taken(world: World, box: Box) -> World:
    return replace(world, changes=replace(world.changes, removed=(*world.changes.removed, box.name)))


def _moved(world: World, box: Box, rng: np.random.Generator) -> World:
    """The thing stands elsewhere, turned as it came; it is taken away if all draws fail."""
    radius_m = world.robot_radius_m + 0.05
    before, without = set(reached(after(world), radius_m=radius_m)), after(_taken(world, box))
    for _ in range(TRIES):
        way, distance_m, yaw = rng.uniform(-math.pi, math.pi), rng.uniform(*MOVED_M), rng.uniform(-math.pi, math.pi)
        middle = np.array(box.centre_m) + distance_m * np.array([math.cos(way), math.sin(way)])
        if not stands(without, middle, box.size_m[:2], yaw):
            continue
        move = (box.name, round(float(middle[0]), 4), round(float(middle[1]), 4), round(float(yaw), 6))
        other = replace(world, changes=replace(world.changes, moved=(*world.changes.moved, move)))
        if before <= set(reached(after(other), radius_m=radius_m)):
            return other
    return _taken(world, box)
