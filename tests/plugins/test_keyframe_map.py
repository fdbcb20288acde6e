"""The map of the odometry keyframe: how a patch of a slanted wall looks from elsewhere; what a full map gives up."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera, exp_se3, inverse, se2
from rhs.estimation.filters.settings import Effort
from rhs_odometry.keyframe.config import Keyframe, KeyframeAdvanced
from rhs_odometry.keyframe.culling import Edge
from rhs_odometry.keyframe.keyframe_map import KeyframeMap, Pictures
from rhs_odometry.keyframe.surface import surfaces
from rhs_odometry.tracks import tracks

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


def drive_without_end(count, held):
    """A map of a camera that goes round and round a ring of 4 m, a key frame every 0.2 m, tied to the one before and, from
    the second round on, to one that it stands on again; and the true poses of all its key frames. Nothing is noisy."""
    keyframes = KeyframeMap(Keyframe(advanced=KeyframeAdvanced(held=held)))
    picture, truth, every = [np.zeros((12, 16), np.uint8)], [], 125
    for n in range(count):
        yaw = 2 * np.pi * n / every
        truth.append(se2(4 * np.sin(yaw), 4 - 4 * np.cos(yaw), yaw) @ CAMERA.body_from_camera)
        k = keyframes.add_keyframe(truth[-1], picture)
        points = np.array([[0.0, 0.0, 2.0], [0.1, 0.0, 2.0]])
        keyframes.add_points(k, np.full((2, 2), 100.0), points, np.zeros((2, 2)))
        if n:
            seen = [(k - 1, False)]
            near = int(np.linalg.norm(keyframes.poses[:-1, :3, 3] - truth[-1][:3, 3], axis=1).argmin())
            seen += [(near, True)] if n > every else []
            keyframes.edges += [Edge(a, k, inverse(keyframes.poses[a]) @ truth[-1], 1e-4 * np.eye(6), loop)
                                for a, loop in seen]
        keyframes.cull(np.zeros(0, int))
    return keyframes, np.array(truth)


def test_a_drive_of_hundreds_of_key_frames_fills_no_more_than_the_map_holds():
    keyframes, truth = drive_without_end(700, held=40)
    assert keyframes.made == 700 and len(keyframes.poses) == len(keyframes.pictures) == 40
    assert len(keyframes.anchor) == 80 and keyframes.anchor.max() == 39
    assert len(keyframes.edges) < 4 * 40
    np.testing.assert_allclose(keyframes.stand(np.arange(700)), truth, atol=1e-6)


def test_those_that_stay_are_spread_over_the_ring_and_their_edges_still_hold():
    keyframes, _ = drive_without_end(500, held=40)
    centres = keyframes.poses[:, :3, 3]
    gaps = np.linalg.norm(centres[:, None] - centres, axis=2) + 1e3 * np.eye(40)
    assert gaps.min(axis=1).max() < 1.5  # 25 m of ring over 40
    for edge in keyframes.edges:
        expected = inverse(keyframes.poses[edge.a]) @ keyframes.poses[edge.b]
        np.testing.assert_allclose(edge.a_from_b, expected, atol=1e-6)
    before = keyframes.poses.copy()
    keyframes.settle(Effort())
    np.testing.assert_allclose(keyframes.poses, before, atol=1e-6)


def test_pictures_come_back_as_they_were_however_little_may_lie_ready():
    rng = np.random.default_rng(0)
    kept, given = Pictures(budget_mb=0.0), [rng.integers(0, 256, (24, 32)).astype(np.uint8) for _ in range(5)]
    for number, picture in enumerate(given):
        kept.add(number, tracks.pyramid(picture))
    kept.drop(3)
    assert len(kept) == 4 and len(kept._ready) == 1
    for number in (0, 4, 1):
        np.testing.assert_array_equal(kept.get(number)[0], given[number])
        np.testing.assert_array_equal(kept.get(number)[1], tracks.pyramid(given[number])[1])
