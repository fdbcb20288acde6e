"""Faces of walls, boxes, floor and ceiling, and what is painted on them.

A face is a quad: (4, 3) corners, counter-clockwise as seen, with (4, 2) texture corners (u right, v up, both 0..1).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from rhs.api.floorplan import LAMP_SHARE, Box, Light, Person, Wall, World

from .simulator_textures import WallPainter, generator, surface

OVERLAP_M = 0.02  # walls reach a little below the floor and above the ceiling, so that no gap of a pixel shows
UNDER_M = 0.005  # by which our floor lies below that of somebody else's building
FLOOR_PX_PER_M = 80.0  # of floor and ceiling: the floor is never nearer to the camera than its height

SIDES = 10  # of a person, seen from above; even

Quad = tuple[np.ndarray, np.ndarray]
Painted = tuple[list[Quad], np.ndarray]  # quads that wear parts of one image (H, W, 3) uint8
WHOLE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def building(world: World, px_per_m: float) -> Iterator[Painted]:
    """Walls, boxes, floor and ceiling of a world, without its obstacles."""
    painter = WallPainter(world, px_per_m)
    for wall in world.walls:
        for number in range(len(wall.segments_m)):
            yield wall_faces(wall, number), painter.texture(wall, number)
    yield from furniture(world, world.boxes, px_per_m)
    x0, y0, x1, y1 = world.bounds_m
    below, above = floor_and_ceiling(world.bounds_m, max((wall.height_m for wall in world.walls), default=0.0))
    surfaces = [("floor", world.floor, below), ("ceiling", world.ceiling, above)]
    if world.mesh is not None:  # it has its own floor, and ours shows where it has none
        surfaces = [("floor", world.floor, (below[0] - [0.0, 0.0, UNDER_M], below[1]))]
    for name, look, quad in surfaces:
        image = surface(generator(world.seed, name), look, (x1 - x0, y1 - y0), FLOOR_PX_PER_M)
        yield [quad], image


def lit(painted: Iterable[Painted], light: Light) -> Iterator[Painted]:
    """The same faces in this light; those that a lamp lights differently each get an image of their own."""
    for quads, image in painted:
        if light.lamp_rad is None:
            yield quads, brighter(image, light.brightness)
            continue
        for corners, uv in quads:
            normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
            normal /= np.linalg.norm(normal)
            facing = float(normal[:2] @ (np.cos(light.lamp_rad), np.sin(light.lamp_rad)))
            yield [(corners, uv)], brighter(image, light.brightness * (1.0 + LAMP_SHARE * facing))


def brighter(image: np.ndarray, factor: float) -> np.ndarray:
    """The image with all colours times a factor; what is too bright is white."""
    return image if factor == 1.0 else np.clip(np.rint(image * np.float32(factor)), 0, 255).astype(np.uint8)


def furniture(world: World, boxes: Iterable[Box], px_per_m: float) -> Iterator[Painted]:
    """Boxes that stand in a world: sides, then lids."""
    for box in boxes:
        w, d, h = box.size_m
        rng = generator(world.seed, "box", box.name)
        yield box_sides(box), surface(rng, box.surface, (2 * (w + d), h), px_per_m)
        yield box_lids(box), surface(rng, box.surface, (w, d), px_per_m)


def shape_faces(world: World, shape: Person | Box, px_per_m: float) -> Iterator[Painted]:
    """A person or a box that stands in the origin."""
    if isinstance(shape, Box):
        yield from furniture(world, [shape], px_per_m)
        return
    sides, lids = prism(0.5 * shape.width_m, shape.height_m)
    around = np.pi * shape.width_m
    image = surface(generator(world.seed, "person", shape.name), shape.surface, (around, shape.height_m), px_per_m)
    if shape.height_m > 1.0:  # dressed: head, coat, trousers
        head, belt = round(0.13 * len(image)), round(0.5 * len(image))
        image[:head] = brighter(image[:head], 1.6)
        image[belt:] = brighter(image[belt:], 0.5)
    yield sides, image
    yield lids, image[: round(0.1 * len(image)) + 1]


def prism(radius_m: float, height_m: float) -> tuple[list[Quad], list[Quad]]:
    """Sides and lids of an upright prism of SIDES sides round the origin: nearly a cylinder."""
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    sides = []
    for i in range(SIDES):
        p, q = ring[i], ring[(i + 1) % SIDES]
        face = np.array([[*p, 0.0], [*q, 0.0], [*q, height_m], [*p, height_m]])
        uv = np.array([[i, 0.0], [i + 1, 0.0], [i + 1, SIDES], [i, SIDES]]) / SIDES
        sides.append((face, uv))
    lids = []
    for i in range(1, SIDES - 2, 2):
        corners = ring[[0, i, i + 1, i + 2]]
        lids.append((np.column_stack([corners, np.full(4, height_m)]), WHOLE))
        lids.append((np.column_stack([corners[::-1], np.zeros(4)]), WHOLE))
    return sides, lids


def wall_faces(wall: Wall, number: int) -> list[Quad]:
    """Both sides of one straight piece of a wall: the texture on the left-hand one, its mirror image on the other."""
    a, b = wall.segments_m[number]
    low, high = -OVERLAP_M, wall.height_m + OVERLAP_M
    uv = WHOLE.copy()
    uv[:, 1] = np.array([low, low, high, high]) / wall.height_m
    from_left = np.array([[*b, low], [*a, low], [*a, high], [*b, high]], float)
    from_right, mirrored = from_left[[1, 0, 3, 2]], uv[[1, 0, 3, 2]]
    return [(from_left, uv), (from_right, mirrored)]


def box_sides(box: Box) -> list[Quad]:
    """The four upright faces of a box, sharing one strip of texture in proportion to their widths."""
    low, high = box.bottom_m, box.bottom_m + box.size_m[2]
    widths = np.array([box.size_m[0], box.size_m[1]] * 2)
    edges = np.concatenate([[0.0], np.cumsum(widths)]) / widths.sum()
    corners = box.corners_m
    quads = []
    for i in range(4):
        p, q = corners[i], corners[(i + 1) % 4]
        face = np.array([[*p, low], [*q, low], [*q, high], [*p, high]])
        uv = np.array([[edges[i], 0.0], [edges[i + 1], 0.0], [edges[i + 1], 1.0], [edges[i], 1.0]])
        quads.append((face, uv))
    return quads


def box_lids(box: Box) -> list[Quad]:
    """Top and underside of a box."""
    top = np.column_stack([box.corners_m, np.full(4, box.bottom_m + box.size_m[2])])
    return [(top, WHOLE), (top[::-1] - [0.0, 0.0, box.size_m[2]], WHOLE[::-1])]


def floor_and_ceiling(bounds_m: tuple[float, float, float, float], height_m: float) -> tuple[Quad, Quad]:
    """The floor seen from above and the ceiling seen from below."""
    x0, y0, x1, y1 = bounds_m
    floor = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]], float)
    ceiling = floor[[1, 0, 3, 2]] + [0.0, 0.0, height_m]
    return (floor, WHOLE), (ceiling, WHOLE)
