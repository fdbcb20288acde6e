"""A made street for `street.py`: round a block of houses, parked cars and trees, drawn by a seed, and a car's way along it.

The middle of the street is a rectangle of 110 x 70 m with round corners; metres, x along the first side, counter-clockwise.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from rhs_sources.raster.renderer import Mesh, Quad

LENGTH_M, WIDTH_M, CORNER_M = 110.0, 70.0, 8.0
HALF_ROAD_M = 9.0  # from the middle of the street to the houses
ARC_M = 0.5 * np.pi * CORNER_M
SIDES = ((LENGTH_M - 2 * CORNER_M, ARC_M), (WIDTH_M - 2 * CORNER_M, ARC_M)) * 2
ROUND_M = float(np.sum(SIDES))
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
Painted = tuple[list[Quad], np.ndarray]


def along(way_m: float) -> tuple[float, float, float]:
    """x, y, yaw of the middle of the street after so many metres."""
    left, x, y, yaw = way_m % ROUND_M, CORNER_M, 0.0, 0.0
    for straight, arc in SIDES:
        step = min(left, straight)
        x, y, left = x + step * np.cos(yaw), y + step * np.sin(yaw), left - step
        turned = yaw + min(left, arc) / CORNER_M
        x, y = x + CORNER_M * (np.sin(turned) - np.sin(yaw)), y - CORNER_M * (np.cos(turned) - np.cos(yaw))
        left, yaw = left - min(left, arc), turned
    return x, y, yaw


def driven(views: int, rng: np.random.Generator) -> Iterator[tuple[float, float, float]]:
    """Stands of a car at 10 a second: up to 11 m/s, 4.2 m/s round corners, 2.2 m/s^2 and braking at 3.5."""
    ends = np.cumsum(SIDES)
    corners = 0.5 * (ends[::2] + ends[1::2])
    way, speed = 0.0, float(rng.uniform(0.0, 8.0))
    for _ in range(views):
        yield along(way)
        gap = np.abs((way - corners + 0.5 * ROUND_M) % ROUND_M - 0.5 * ROUND_M).min()
        wanted = 4.2 + np.sqrt(4.0 * max(gap - CORNER_M, 0.0)) if gap < 25.0 else 11.0
        speed = max(speed - 0.35, wanted) if wanted < speed else min(speed + 0.22, 11.0)
        way += 0.1 * speed


def street(rng: np.random.Generator) -> Mesh:
    """Houses, cars, trees and the road."""
    return Mesh.of_quads([*houses(rng), *things(rng), *road(rng)])


def houses(rng: np.random.Generator) -> Iterator[Painted]:
    """Rows of fronts on both sides, some set back, some apart."""
    for off, side in ((-HALF_ROAD_M, -1), (HALF_ROAD_M, 1)):
        box = np.array([[off, off], [LENGTH_M - off, off], [LENGTH_M - off, WIDTH_M - off], [off, WIDTH_M - off]])
        for here, there in zip(box, np.roll(box, -1, axis=0), strict=True):
            ahead = (there - here) / np.linalg.norm(there - here)
            way = 0.0
            while (front := min(rng.uniform(8.0, 16.0), np.linalg.norm(there - here) - way)) > 2.0:
                at = here + ahead * way + rng.uniform(0.0, 2.5) * side * np.array([-ahead[1], ahead[0]])
                yield house(at, at + ahead * front, rng)
                way += front + (rng.uniform(0.0, 3.0) if rng.random() < 0.4 else 0.0)


def house(left: np.ndarray, right: np.ndarray, rng: np.random.Generator) -> Painted:
    """A front with rows of windows, 20 pixels a metre."""
    high, wide = rng.uniform(5.0, 14.0), float(np.linalg.norm(right - left))
    image = stained((int(20 * high), int(20 * wide)), rng.uniform(90, 190, 3), 0.12, 32, rng)
    for x in np.arange(1.0, wide - 1.5, rng.uniform(2.2, 3.5)):
        for z in np.arange(1.0, high - 1.5, 3.0):
            top, beside = int(20 * (high - z - 1.5)), int(20 * x)
            image[top : top + 28, beside : beside + 20] = rng.uniform(30, 70)
            cv2.rectangle(image, (beside, top), (beside + 20, top + 28), [int(v) for v in rng.uniform(180, 240, 3)], 1)
    return [upright(left, right, high), upright(right, left, high)], image


def things(rng: np.random.Generator) -> Iterator[Painted]:
    """Parked cars and trees."""
    for way in np.arange(3.0, ROUND_M):
        for side in (-1.0, 1.0):
            drawn, (x, y, yaw) = rng.random(), along(way)
            if drawn < 0.12:
                yield block(x, y, yaw, side * rng.uniform(4.2, 5.0), (4.2, 1.8, 1.5), rng)
            elif drawn < 0.19:
                yield block(x, y, yaw, side * 6.3, (0.35, 0.35, 5.0), rng)


def block(x: float, y: float, yaw: float, aside: float, size: tuple[float, float, float], rng) -> Painted:
    """A box of this length, width and height beside the middle of the street."""
    ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    corners = [np.array([x, y]) + a * size[0] / 2 * ahead + (aside + b * size[1] / 2) * left
               for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    lid = np.array([[*corner, size[2]] for corner in corners])
    walls = [upright(corners[i], corners[(i + 1) % 4], size[2]) for i in range(4)]
    image = stained((int(40 * size[2]), max(int(40 * size[0]), 8)), rng.uniform(40, 200, 3), 0.2, 16, rng)
    return [*walls, (lid, SQUARE)], image


def road(rng: np.random.Generator) -> Iterator[Painted]:
    """Tarmac, in tiles of 10 m."""
    for x in np.arange(-20.0, LENGTH_M + 20.0, 10.0):
        for y in np.arange(-20.0, WIDTH_M + 20.0, 10.0):
            tile = np.column_stack([np.array([x, y]) + 10.0 * SQUARE, np.zeros(4)])
            yield [(tile, SQUARE)], stained((300, 300), np.full(3, 96.0), 0.1, 64, rng)


def upright(left: np.ndarray, right: np.ndarray, high: float) -> Quad:
    """A face from the ground up, seen from where `left` is to the left."""
    return np.array([[*left, 0.0], [*right, 0.0], [*right, high], [*left, high]]), SQUARE


def stained(shape: tuple[int, int], colour: np.ndarray, contrast: float, largest_px: int, rng) -> np.ndarray:
    """(H, W, 3) uint8 of this colour with stains of all sizes up to the largest."""
    high, wide = shape
    stains, size = np.zeros(shape), largest_px
    while size >= 1:
        coarse = rng.standard_normal((-(-high // size) + 1, -(-wide // size) + 1))
        stains += np.sqrt(size) * cv2.resize(coarse, (wide, high), interpolation=cv2.INTER_CUBIC)
        size //= 2
    stains = (stains - stains.mean()) / stains.std()
    return np.clip(colour * (1.0 + contrast * stains[..., None]), 0, 255).astype(np.uint8)
