"""Scans cast on walls and key-points lifted onto them, against distances a person can compute."""

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, inverse, se2, transform
from rhs.api.records import Features, Wall
from rhs.estimation.scans.wall_rays import cast_on_walls, lift_on_walls

LEFT = Wall(np.array([-2.0, 1.0]), np.array([10.0, 1.0]), 0.0, 2.5)
RIGHT = Wall(np.array([10.0, -1.0]), np.array([-2.0, -1.0]), 0.0, 2.5)
END = Wall(np.array([6.0, -1.0]), np.array([6.0, 1.0]), 0.0, 2.5)


def test_beams_end_on_the_nearest_wall():
    bearings = np.array([0.0, np.pi / 2, -np.pi / 2, np.pi / 4, np.pi])
    scan = cast_on_walls([LEFT, RIGHT, END], se2(1.0, 0.5, 0.0), bearings, 20.0)
    assert scan.ranges_m[:4] == pytest.approx([5.0, 0.5, 1.5, 0.5 * 2**0.5])
    assert np.isnan(scan.ranges_m[4])  # no wall is known there: unknown, not free


def test_a_wall_beyond_the_range_leaves_free_space():
    scan = cast_on_walls([END], se2(0.0, 0.0, 0.0), np.zeros(1), 4.0)
    assert np.isposinf(scan.ranges_m[0])


def test_beams_turn_with_the_body():
    scan = cast_on_walls([LEFT], se2(0.0, 0.0, np.pi / 2), np.zeros(1), 4.0)
    assert scan.ranges_m[0] == pytest.approx(1.0)


def test_no_walls_know_nothing():
    assert np.isnan(cast_on_walls([], np.eye(4), np.zeros(3), 4.0).ranges_m).all()


def test_key_points_are_lifted_to_where_they_were():
    camera = camera_from_fov(320, 240, 57.0, height_m=1.2, forward_m=0.1)
    pose = se2(0.5, 0.2, 0.1)
    truth = np.array([[4.0, 1.0, 1.5], [3.0, -1.0, 1.0], [6.0, 0.3, 1.4], [4.0, 0.0, 0.0], [5.0, 0.5, 2.5]])
    local = transform(inverse(pose @ camera.body_from_camera), truth)
    seen = Features(camera.project(local).astype(np.float32), np.zeros((5, 128)), np.full((5, 3), np.nan))
    lifted = lift_on_walls(seen, camera, pose, [LEFT, RIGHT, END])
    assert lifted.points == pytest.approx(local, abs=1e-3)
    far = lift_on_walls(seen, camera, pose, [LEFT, RIGHT, END], max_range_m=3.0)
    assert np.isnan(far.points).any(axis=1).tolist() == [True, False, True, True, True]
    assert lift_on_walls(seen, camera, pose, []) is seen
