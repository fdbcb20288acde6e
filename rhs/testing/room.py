"""A box-shaped room with painted walls, seen by exact ray casting: what plugins are checked in (rhs.testing)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rhs.api.contracts import Context, FeatureSettings
from rhs.api.geometry import Camera, camera_from_fov, planar
from rhs.api.grid import OccupancyGrid, frame_of
from rhs.api.records import Capture, Observation, Scan, WorldFacts

LOW, HIGH = np.array([-4.0, -3.0, 0.0]), np.array([4.0, 3.0, 2.6])
TEXELS_PER_M = 40.0


def paintings(seed: int = 0) -> np.ndarray:
    """Six smooth random textures (6, 512, 512) of grey levels."""
    rng = np.random.default_rng(seed)
    fine = rng.uniform(0, 255, (6, 512, 512))
    coarse = np.kron(rng.uniform(0, 255, (6, 64, 64)), np.ones((1, 8, 8)))
    for axis in (1, 2):
        fine = (np.roll(fine, 1, axis) + fine + np.roll(fine, -1, axis)) / 3
        coarse = np.mean([np.roll(coarse, n, axis) for n in range(-2, 3)], axis=0)
    return 0.4 * fine + 0.6 * coarse


def see(camera: Camera, world_from_body: np.ndarray, textures: np.ndarray, index: int = 0) -> Capture:
    """The ideal view of the room from a pose: RGB image (grey) and depth along the optical axis."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    pose = world_from_body @ camera.body_from_camera
    directions = rays @ pose[:3, :3].T
    with np.errstate(divide="ignore"):
        to_walls = np.where(directions > 0, HIGH - pose[:3, 3], LOW - pose[:3, 3]) / directions
    axis = to_walls.argmin(axis=1)
    depth = to_walls[np.arange(len(axis)), axis]
    hit = pose[:3, 3] + directions * depth[:, None]
    others = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    face = 2 * axis + (directions[np.arange(len(axis)), axis] > 0)
    texel = np.take_along_axis(hit, others, axis=1) * TEXELS_PER_M
    low = np.floor(texel).astype(int)
    part = texel - low
    value = np.zeros(len(axis))
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            value += share * textures[face, (low[:, 0] + dx) % 512, (low[:, 1] + dy) % 512]
    grey = np.rint(value).astype(np.uint8).reshape(camera.height, camera.width)
    image = np.repeat(grey[:, :, None], 3, axis=2)
    return Capture(index, 0.1 * index, image, depth.reshape(grey.shape).astype(np.float32))


def observe(camera: Camera, world_from_body: np.ndarray, textures: np.ndarray, index: int = 0) -> Observation:
    """The same view as a perfect sensor reports it."""
    capture = see(camera, world_from_body, textures, index)
    return Observation(index, capture.stamp_s, camera, capture.image, capture.depth)


CAMERA = camera_from_fov(160, 120, 70.0, height_m=1.0)
BEARINGS = np.linspace(-0.6, 0.6, 81)


def scan_of(world_from_body: np.ndarray) -> Scan:
    """Exact ranges to the walls of the room, from the body."""
    x, y, yaw = planar(world_from_body)
    direction = np.stack([np.cos(yaw + BEARINGS), np.sin(yaw + BEARINGS)], axis=1)
    with np.errstate(divide="ignore"):
        reach = np.where(direction > 0, HIGH[:2] - (x, y), LOW[:2] - (x, y)) / direction
    return Scan(BEARINGS.copy(), reach.min(axis=1), 12.0)


def context(folder: Path, seed: int = 0) -> Context:
    """What a part is built from, in this room."""
    bounds = (float(LOW[0]), float(LOW[1]), float(HIGH[0]), float(HIGH[1]))
    facts = WorldFacts("testing room", (-1.5, -0.5, 0.2), (("corner", 2.0, 2.0),), bounds, 0.2)
    return Context(np.random.default_rng(seed), CAMERA, facts, folder, FeatureSettings())


def empty_grid() -> OccupancyGrid:
    """The room's true map: walls on its border, free inside."""
    (rows, columns), origin = frame_of(context(Path()).world.bounds_m, 0.1)
    probability = np.full((rows, columns), 0.02, np.float32)
    probability[[0, 1, 2, -3, -2, -1]] = 0.98
    probability[:, [0, 1, 2, -3, -2, -1]] = 0.98
    return OccupancyGrid(probability, 0.1, origin)
