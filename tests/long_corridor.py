"""A corridor longer than any depth camera sees, flat or with pilasters: ideal and noisy depth by exact ray casting."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera, camera_from_fov
from rhs.api.records import Observation

CAMERA = camera_from_fov(160, 120, 57.0, height_m=1.0)
WIDTH_M, HEIGHT_M = 2.0, 2.5
PILASTER_M, EVERY_M = 0.15, 3.0  # depth and length of a pilaster, and how far apart they stand, on both sides in turn


def depth_from(x_m: float, *, relief: bool, y_m: float = 0.0, yaw_rad: float = 0.0, camera: Camera = CAMERA) -> np.ndarray:
    """(H, W) float32 metres seen from (x, y, yaw) in a corridor along x, centred on y = 0."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float)) @ camera.body_from_camera[:3, :3].T
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    direction = np.stack([c * rays[:, 0] - s * rays[:, 1], s * rays[:, 0] + c * rays[:, 1], rays[:, 2]], axis=1)
    origin = np.array([x_m, y_m, camera.height_m])
    low, high = np.array([-1e3, -WIDTH_M / 2, 0.0]), np.array([1e3, WIDTH_M / 2, HEIGHT_M])
    with np.errstate(divide="ignore"):
        depth = (np.where(direction > 0, high - origin, low - origin) / direction).min(axis=1)
        for k in range(int(x_m // EVERY_M) - 1, int(x_m // EVERY_M) + 6) if relief else ():
            for side, start in ((-1.0, EVERY_M * k), (1.0, EVERY_M * (k + 0.5))):
                wall = side * WIDTH_M / 2
                box = np.array([[start, min(wall, wall - side * PILASTER_M), 0.0],
                                [start + PILASTER_M, max(wall, wall - side * PILASTER_M), HEIGHT_M]])
                ends = (box - origin)[:, None, :] / direction[None]
                near, far = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
                depth = np.where((near < far) & (near > 0.05) & (near < depth), near, depth)
    return depth.reshape(camera.height, camera.width).astype(np.float32)


def sensed(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The depth with a Kinect's noise and range (0.4 to 8 m)."""
    noisy = depth + (0.0012 + 0.0019 * (depth - 0.4) ** 2) * rng.standard_normal(depth.shape)
    return np.where((noisy > 0.4) & (noisy < 8.0), noisy, np.nan).astype(np.float32)


def walk(count: int, *, relief: bool, step_m: float = 0.2, seed: int = 0, wheel: bool = False) -> list[Observation]:
    """Observations without images while walking along the corridor, now and then a little askew."""
    rng = np.random.default_rng(seed)
    image = np.full((CAMERA.height, CAMERA.width, 3), 128, np.uint8)
    travel = np.array([step_m, 0.0, 0.0]) if wheel else None
    views = []
    for k in range(count):
        depth = sensed(depth_from(1.0 + k * step_m, relief=relief, y_m=0.1 * np.sin(0.3 * k)), rng)
        views.append(Observation(k, 0.4 * k, CAMERA, image, depth, wheel=travel))
    return views
