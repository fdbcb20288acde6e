"""The map of the odometry keyframe: how a patch of a slanted wall looks from elsewhere."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera, exp_se3, inverse
from rhs_odometry.keyframe.keyframe_map import KeyframeMap
from rhs_odometry.keyframe.surface import surfaces

CAMERA = Camera(320, 240, 290.0, 290.0, 159.5, 119.5)


def warps_of(pixels, points, slopes, camera_from_map):
    keyframes = KeyframeMap()
    keyframes.add_keyframe(np.eye(4), [])
    return keyframes.warps(keyframes.add_points(0, pixels, points, slopes), camera_from_map, CAMERA)


def test_the_warp_of_a_slanted_wall_is_that_of_its_homography():
    """A wall 1 m to the right along the line of sight: near pixels move on faster than far ones."""
    v, u = np.mgrid[0:240, 0:320].astype(float)
    with np.errstate(divide="ignore"):
        depth = np.where(u > 170, 290.0 / (u - 159.5), np.nan).astype(np.float32)  # x = 1 m
    pixels = np.array([[230.0, 100.0], [260.0, 160.0]])
    rho, slopes = surfaces(depth, pixels)
    points = CAMERA.rays(pixels) / rho[:, None]
    then_from_now = exp_se3(np.array([0.1, 0.0, 0.3, 0.0, 0.15, 0.0]))
    warps, facing = (warps_of(pixels, points, each, inverse(then_from_now)) for each in (slopes, np.zeros((2, 2))))
    k = np.array([[290.0, 0, 159.5], [0, 290.0, 119.5], [0, 0, 1.0]])
    normal, distance = np.array([1.0, 0.0, 0.0]), 1.0  # of the wall in the camera of then
    t = inverse(then_from_now)
    now_from_then = k @ (t[:3, :3] + np.outer(t[:3, 3], normal) / distance) @ np.linalg.inv(k)
    for pixel, warp in zip(pixels, warps, strict=True):
        around = []
        for step in ([0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]):
            x = now_from_then @ np.append(pixel + step, 1.0)
            around.append(x[:2] / x[2])
        forward = np.stack([around[0] - around[1], around[2] - around[3]], axis=1)
        np.testing.assert_allclose(warp, np.linalg.inv(forward), rtol=0.005, atol=0.002)
    assert np.abs(facing - warps).max() > 0.05  # taking the wall for one that faces the camera is another warp
