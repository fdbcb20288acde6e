"""Odometry keyframe on a robot among plain surfaces: depth carries the motion, wheels tell what no surface does."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from painted_room import observe, paintings

from rhs.api.geometry import camera_from_fov, log_se3, planar, se2
from rhs.api.records import FeatureSettings, Tracking
from rhs.testing.room import CORRIDOR, FURNISHED
from rhs_odometry.keyframe.config import Keyframe

ROBOT, PLAIN = camera_from_fov(320, 240, 57.0, height_m=1.0), np.full_like(paintings(), 128.0)
SHORT = 0.85  # of each way and each turn is what these wheels count


def driven(room, poses, seed=0):
    """The motions said of plain views from poses, with 2.5 grey levels and 0.002 1/m of noise."""
    rng = np.random.default_rng(seed)
    odometry = Keyframe().build(SimpleNamespace(rng=rng, camera=ROBOT, features=FeatureSettings()))
    said = []
    for k, pose in enumerate(poses):
        view = observe(ROBOT, pose, PLAIN, k, room)
        grey = view.image[..., :1].astype(float) + 2.5 * rng.standard_normal(view.image.shape[:2])[..., None]
        depth = 1.0 / (1.0 / view.depth + 0.002 * rng.standard_normal(view.depth.shape))
        wheel = SHORT * planar(np.linalg.inv(poses[k - 1]) @ pose) if k else None
        image = np.clip(np.repeat(grey, 3, axis=2), 0, 255).astype(np.uint8)
        said.append(odometry.update(replace(view, image=image, depth=depth.astype(np.float32), wheel=wheel)))
    return said


def chained(start, motions):
    """Poses that start with `start` and go on by the motions."""
    poses = [start]
    for motion in motions:
        poses.append(poses[-1] @ motion)
    return poses


@pytest.mark.parametrize("motion", [se2(0.08, 0.0, 0.04), se2(0.0, 0.0, 0.08)], ids=["arc", "turn"])
def test_in_a_furnished_plain_room_depth_puts_right_what_wheels_count_short(motion):
    poses = chained(se2(-1.5, -0.5, 0.2), [motion] * 20)
    said = driven(FURNISHED, poses)
    assert all(one.status is not Tracking.LOST for one in said)
    end = chained(poses[0], [one.previous_from_body for one in said[1:]])[-1]
    off = log_se3(np.linalg.inv(end) @ poses[-1])
    wheels = (1.0 - SHORT) * 20 * planar(motion)
    assert np.hypot(*off[:2]) < max(0.3 * np.hypot(*wheels[:2]), 0.03) and abs(off[5]) < 0.2 * abs(wheels[2])


def test_along_a_plain_corridor_wheels_tell_the_way_and_walls_the_side_and_the_heading():
    poses = chained(se2(-3.0, 0.1, 0.0), [se2(0.1, 0.0, 0.0)] * 10)
    said = driven(CORRIDOR, poses)[1:]
    way = sum(one.previous_from_body[0, 3] for one in said)
    assert way == pytest.approx(SHORT * 1.0, abs=0.05)
    for one in said:
        along, aside, turn = np.sqrt(np.diag(one.covariance))[[0, 1, 5]]
        assert along > 0.015 and aside < 0.005 and turn < 0.005
