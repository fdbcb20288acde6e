"""The smooth error of a depth camera: learnt from points seen twice, taken off, and left alone where nothing tells."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera, exp_se3
from rhs_odometry.advanced import BendSettings
from rhs_odometry.keyframe.bend import DepthBend

CAMERA = Camera(320, 240, 262.5, 262.5, 159.5, 119.5)
NOISE = {"pixel_sigma": 0.6, "inverse_depth_sigma": 0.002, "student_dof": 5.0}


def bowl(pixels):
    """(N,) 1/m that inverse depths are too small by: a tenth of a pixel of disparity at the rim."""
    return 0.002 * (((pixels - [159.5, 119.5]) / 160.0) ** 2).sum(axis=1)


def taught(error, views=40, seed=0):
    """Points of a scene 2 to 3.5 m off, seen from places a decimetre and eight degrees apart, read with an error and noise;
    the pose of each view is off by 3 mm and 3 mrad."""
    rng, bend = np.random.default_rng(seed), DepthBend(BendSettings(), CAMERA)
    for _ in range(views):
        before = rng.uniform((10, 10), (310, 230), (150, 2))
        rho = 0.4 + rng.uniform(-0.1, 0.1, 150)
        move = exp_se3(np.concatenate([rng.normal(0, 0.1, 3), rng.normal(0, 0.15, 3)]))
        points = CAMERA.rays(before) / rho[:, None] @ move[:3, :3].T + move[:3, 3]
        after = CAMERA.project(points) + rng.normal(0, 0.3, (150, 2))
        seen = ((after > 5) & (after < [315, 235])).all(axis=1)
        read, now = (x - error(p) + rng.normal(0, 0.001, 150) for x, p in ((rho, before), (1 / points[:, 2], after)))
        poses = np.repeat((exp_se3(rng.normal(0, 0.003, 6)) @ move)[None], int(seen.sum()), axis=0)
        bend.learn((before[seen], read[seen]), (after[seen], now[seen]), poses, **NOISE)
    return bend


def test_a_bowl_is_learnt_whatever_the_poses_and_most_of_it_taken_off():
    bend = taught(bowl)
    pixels = np.array(np.meshgrid(np.arange(20, 300, 20), np.arange(20, 220, 20)), float).reshape(2, -1).T
    left = bowl(pixels) - bend.at(pixels, bend.nodes)
    assert np.std(left) < 0.45 * np.std(bowl(pixels))  # a constant is hardly seen, and stays
    flat = np.full((240, 320), 2.0, np.float32)
    rows, columns = pixels.astype(int).T[::-1]
    mended = 1.0 / bend.straightened(flat)[rows, columns] - 0.5
    np.testing.assert_allclose(mended, bend.at(pixels, bend.nodes), atol=2e-6)


def test_a_camera_without_an_error_is_left_as_it_is():
    assert np.abs(taught(lambda pixels: np.zeros(len(pixels))).nodes).max() < 4e-4


def test_few_points_teach_nothing_and_unknown_depth_stays_unknown():
    bend = DepthBend(BendSettings(), CAMERA)
    depth = np.array([[1.0, np.nan]], np.float32)
    assert bend.straightened(depth) is depth
    pixels = np.full((29, 2), 100.0)
    bend.learn((pixels, np.full(29, 0.5)), (pixels, np.full(29, 0.6)), np.tile(np.eye(4), (29, 1, 1)), **NOISE)
    assert not bend.nodes.any()
    bend.nodes = bend.nodes + 1e-3
    assert np.isnan(bend.straightened(np.full((240, 320), np.nan, np.float32))).all()
