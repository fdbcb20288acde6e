"""One camera anywhere: the way up to its scale, metres where wheels tell them, no word where nothing can be told."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import rhs
from rhs.api.geometry import BODY_FROM_OPTICAL, align, camera_from_fov, exp_se3, exp_so3, quaternion_xyzw, se3
from rhs.api.records import Observation, Tracking
from rhs.testing.room import CAMERA, FURNISHED, drive, paintings, see
from rhs_odometry.monocular_vo.bundle import Sightings, adjust, residuals
from rhs_odometry.monocular_vo.config import MonocularVo

HELD = camera_from_fov(200, 150, 60.0, height_m=0.0)


def built(camera, **settings):
    return MonocularVo(**settings).build(SimpleNamespace(camera=camera, rng=np.random.default_rng(0)))


@cache
def by_hand(count=26):
    """True poses and views of a camera carried by hand through the furnished room: it moves and turns on all axes."""
    rng, out = np.random.default_rng(5), []
    for k in range(count):
        t = k / 10
        turn = exp_so3(np.array([0.08 * np.sin(1.7 * t), 0.08 * np.sin(1.1 * t), 0.25 * np.sin(0.7 * t)]))
        pose = se3(turn, np.array([-1.5 + 0.25 * t, -0.6 + 0.35 * np.sin(1.3 * t), 1.2 + 0.15 * np.sin(1.1 * t)]))
        image = see(HELD, pose, paintings(), k, FURNISHED).image
        noise = 2.0 * rng.standard_normal(image.shape[:2])[:, :, None]
        out.append((pose, Observation(k, t, HELD, image=np.clip(image + noise, 0, 255).astype(np.uint8))))
    return out


def test_bundle_adjustment_finds_the_poses_and_points_that_were_disturbed():
    """Exact sightings of 60 points by 4 cameras, two of them fixed: the rest must come back."""
    rng = np.random.default_rng(1)
    points = rng.uniform([-2, -2, 4], [2, 2, 8], (60, 3))
    poses = np.array([exp_se3(np.array([0.3 * k, 0.05 * k, 0, 0, 0.03 * k, 0.01 * k])) for k in range(4)])
    of, row = (grid.ravel() for grid in np.meshgrid(np.arange(4), np.arange(60), indexing="ij"))
    rays = np.concatenate([residuals(pose, points, np.zeros((60, 2)), 1.0) for pose in poses])
    wrong = np.array([exp_se3(0.02 * rng.standard_normal(6)) @ p if k > 1 else p for k, p in enumerate(poses)])
    seen = Sightings(of, row, rays, 300.0, 1.0)
    found, places = adjust(wrong, points + 0.1 * rng.standard_normal(points.shape), seen, fixed=2, rounds=30)
    np.testing.assert_allclose(found, poses, atol=1e-4)
    np.testing.assert_allclose(places, points, atol=1e-2)


def test_a_way_by_hand_is_found_up_to_its_scale():
    """Way of about a metre; nobody tells the scale, and the part says so."""
    odometry = built(HELD)
    motions = [odometry.update(view) for _, view in by_hand()]
    there = np.array([pose[:3, 3] for pose, _ in by_hand()])
    found = odometry.revise().poses[:, :3, 3]
    move, scale = align(found, there, with_scale=True)
    off = np.linalg.norm(scale * found @ move[:3, :3].T + move[:3, 3] - there, axis=1)
    way = np.linalg.norm(np.diff(there, axis=0), axis=1).sum()
    assert way > 0.8 and np.sqrt(np.mean(off**2)) < 0.02 * way
    assert odometry.scale_from == "unknown" and motions[-1].details["scale_known"] == 0.0
    assert np.mean([m.status is Tracking.OK for m in motions]) > 0.7


def test_a_known_first_distance_gives_metres():
    depth = float(np.median(see(HELD, by_hand()[0][0], paintings(), 0, FURNISHED).depth))
    odometry = built(HELD, first_depth_m=depth)
    for _, view in by_hand():
        odometry.update(view)
    found = odometry.revise().poses[:, :3, 3]
    _, scale = align(found, np.array([pose[:3, 3] for pose, _ in by_hand()]), with_scale=True)
    assert scale == pytest.approx(1.0, abs=0.15) and odometry.scale_from == "first depth"


def test_wheels_give_metres():
    views = drive(FURNISHED)
    odometry = built(CAMERA)
    for _, view in views:
        odometry.update(replace(view, depth=None, command=None))
    found = odometry.revise().poses[:, :3, 3]
    _, scale = align(found, np.array([pose[:3, 3] for pose, _ in views]), with_scale=True)
    assert scale == pytest.approx(1.0, abs=0.05) and odometry.scale_from == "wheel"


def test_a_camera_that_only_turns_tells_no_way():
    """Ten views, 2 degrees apart, from one place: the turn is right, the way is not known, and no view is ok."""
    odometry, yaw = built(HELD), np.eye(4)
    for k in range(10):
        pose = se3(exp_so3(np.array([0, 0, np.radians(2.0 * k)])), np.array([-1.5, -0.6, 1.2]))
        motion = odometry.update(Observation(k, 0.1 * k, HELD, image=see(HELD, pose, paintings(), k, FURNISHED).image))
        yaw = yaw @ motion.previous_from_body
        if k:
            assert motion.status is Tracking.DEGENERATE and "no parallax" in motion.reason
    assert np.degrees(np.arctan2(yaw[1, 0], yaw[0, 0])) == pytest.approx(18.0, abs=0.5)
    assert np.allclose(yaw[:3, 3], 0.0)


def test_a_folder_of_pictures_runs_and_its_row_says_that_the_scale_is_unknown(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    lines = []
    for k, (pose, view) in enumerate(by_hand()):
        cv2.imwrite(str(folder / f"{k:04d}.png"), view.image)
        numbers = [*pose[:3, 3], *quaternion_xyzw(pose[:3, :3] @ BODY_FROM_OPTICAL)]
        lines.append(f"{k / 10} " + " ".join(f"{n:.9f}" for n in numbers) + "\n")
    (tmp_path / "truth.txt").write_text("".join(lines))
    row = rhs.run(["task=survey", "source=replay", f"source.path={folder}", "sensor=mono", "source.rate_hz=10",
                   f"source.camera=[{HELD.fx},{HELD.fy},{HELD.cx},{HELD.cy}]", f"source.truth={tmp_path / 'truth.txt'}",
                   f"output={tmp_path / 'run'}", "pictures=off"], quiet=True)
    assert row["status"] == "ok" and row["odometry"] == "monocular_vo" and row["scale_from"] == "unknown"
    assert row["scale_known"] == 0 and row["ate_alignment"] == "sim3" and row["ate_rmse_m"] < 0.03
