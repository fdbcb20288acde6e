"""A box-shaped room with painted walls seen by a camera, by exact ray casting: images and depth with known truth."""

from __future__ import annotations

import numpy as np

from rhs.geometry import Camera
from rhs.records import Capture, Observation

LOW, HIGH = np.array([-4.0, -3.0, 0.0]), np.array([4.0, 3.0, 2.6])
TEXELS_PER_M = 40.0


def paintings(seed: int = 0) -> np.ndarray:
    """Six smooth random textures (6, 512, 512) of grey levels."""
    rng = np.random.default_rng(seed)
    fine = rng.uniform(0, 255, (6, 512, 512))
    coarse = np.kron(rng.uniform(0, 255, (6, 64, 64)), np.ones((1, 8, 8)))
    for axis in (1, 2):
        fine = (np.roll(fine, 1, axis) + fine + np.roll(fine, -1, axis)) / 3
        coarse = sum(np.roll(coarse, n, axis) for n in range(-2, 3)) / 5
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
