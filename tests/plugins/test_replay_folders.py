"""Replaying 7-Scenes folders and CARMEN laser logs."""

from __future__ import annotations

import bz2

import cv2
import numpy as np
import pytest
from helpers.replayed import views

from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL, se2

INTRINSICS = [50.0, 50.0, 31.5, 23.5]


def seven_scenes(folder, poses):
    for k, pose in enumerate(poses):
        name = folder / f"frame-{k:06d}"
        cv2.imwrite(f"{name}.color.png", np.full((48, 64, 3), 10 + k, np.uint8))
        depth = np.full((48, 64), 1500, np.uint16)
        depth[0, :2] = 0, 65535
        cv2.imwrite(f"{name}.depth.png", depth)
        np.savetxt(f"{name}.pose.txt", pose)
    return folder


def test_a_seven_scenes_folder_gives_views_with_poses(tmp_path):
    lost = np.full((4, 4), np.nan)
    _, seen = views(seven_scenes(tmp_path, [se2(0.0, 0, 0), se2(0.5, 0, 0), lost]), camera=INTRINSICS)
    capture, truth = seen[1]
    assert capture.image[0, 0, 0] == 11 and capture.depth[5, 5] == np.float32(1.5)
    assert np.isnan(capture.depth[0, :2]).all()
    np.testing.assert_allclose(truth[:3, 3], [0.5, 0, 0], atol=1e-12)
    np.testing.assert_allclose(truth[:3, :3], BODY_FROM_OPTICAL.T, atol=1e-12)
    assert seen[2][1] is None


def test_nobody_knows_how_far_a_recording_leads_unless_it_is_told(tmp_path):
    seven_scenes(tmp_path, [np.eye(4)] * 2)
    free, told = (views(tmp_path, camera=INTRINSICS, extent_m=extent_m)[0].facts for extent_m in (0.0, 25.0))
    assert not free.bounds_known and told.bounds_known and told.bounds_m == (-25.0, -25.0, 25.0, 25.0)


def test_a_pose_that_mirrors_is_refused(tmp_path):
    mirror = np.diag([1.0, 1.0, -1.0, 1.0])
    with pytest.raises(ConfigError, match=r"frame-000001.pose.txt: the rotation is not in SO\(3\) \(determinant -1.000"):
        views(seven_scenes(tmp_path, [np.eye(4), mirror]), camera=INTRINSICS)


def test_a_missing_depth_image_is_named(tmp_path):
    seven_scenes(tmp_path, [np.eye(4)] * 2)
    (tmp_path / "frame-000001.depth.png").unlink()
    with pytest.raises(ConfigError, match=r"frame-000001.color.png is there but frame-000001.depth.png is not"):
        views(tmp_path, camera=INTRINSICS)


def flaser(k, ranges, pose, stamp):
    numbers = " ".join(str(r) for r in ranges)
    x, y, turn = pose
    return f"FLASER {len(ranges)} {numbers} 9 9 9 {x} {y} {turn} {stamp} host {k}"


def test_a_carmen_log_gives_scans_and_wheel_travel(tmp_path):
    lines = ["# a comment", "PARAM robot 1", "ODOM 0 0 0 0 0 0 1.0 host 1",
             flaser(0, [1.0, 2.0, 50.0], (1.0, 1.0, np.pi / 2), 10.0),
             flaser(1, [1.5, 0.0, 2.5], (1.0, 1.3, np.pi / 2), 10.5)]
    path = tmp_path / "walk.clf.bz2"
    path.write_bytes(bz2.compress("\n".join(lines).encode()))
    source, seen = views(path)
    assert source.views_expected == 2 and [c.stamp_s for c, _ in seen] == [10.0, 10.5]
    assert seen[0][0].travel is None
    np.testing.assert_allclose(seen[1][0].travel, [0.3, 0.0, 0.0], atol=1e-12)  # north is ahead when looking north
    np.testing.assert_allclose(seen[0][0].scan.bearings_rad, [-np.pi / 2, 0.0, np.pi / 2])
    np.testing.assert_array_equal(seen[0][0].scan.ranges_m, [1.0, 2.0, np.inf])
    np.testing.assert_array_equal(seen[1][0].scan.ranges_m, [1.5, np.nan, 2.5])


def test_a_log_whose_stamps_step_back_keeps_all_scans_in_the_order_of_the_file(tmp_path):
    """Stamps 10, 11, 10.4, 10.4, 14: the third and fourth are put between their neighbours, and counted."""
    path = tmp_path / "walk.log"
    path.write_text("\n".join(flaser(k, [1.0 + k, 2.0, 3.0], (float(k), 0, 0), stamp)
                              for k, stamp in enumerate([10.0, 11.0, 10.4, 10.4, 14.0])))
    source, seen = views(path)
    assert [float(c.scan.ranges_m[0]) for c, _ in seen] == [1.0, 2.0, 3.0, 4.0, 5.0]
    np.testing.assert_allclose([c.stamp_s for c, _ in seen], [10.0, 11.0, 12.0, 13.0, 14.0])
    assert [float(c.extras["log_stamp_s"][0]) for c, _ in seen] == [10.0, 11.0, 10.4, 10.4, 14.0]
    assert source.stamps_repaired == 2
    np.testing.assert_allclose([c.travel for c, _ in seen[1:]], [[1.0, 0, 0]] * 4, atol=1e-12)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("FLASER 3 1 2", "walk.log:1: found 4 words for 3 beams"),
        ("FLASER 999999999 1 2", "999999999 beams"),
        ("FLASER one 1 2", "'one' where a number"),
        (flaser(0, [1.0], (np.nan, 0, 0), 1.0), "odometry holds NaN"),
        ("ODOM 0 0 0 0 0 0 1.0 host 1", "no FLASER, ROBOTLASER1 or RAWLASER1 line"),
    ],
)
def test_damaged_laser_logs_are_refused_with_their_line(tmp_path, line, words):
    path = tmp_path / "walk.log"
    path.write_text(line + "\n")
    with pytest.raises(ConfigError, match=words):
        views(path)


def test_the_real_log_of_the_aces_building(real_data):
    """README of the data: 7,374 scans of 180 beams; its wheels say about 325 m in the end."""
    source, seen = views(real_data("laser/aces.clf.bz2"))
    kept = len(seen)
    assert source.views_expected == kept == 7374
    assert all(len(c.scan.ranges_m) == 180 for c, _ in seen)
    path_m = sum(np.hypot(*c.travel[:2]) for c, _ in seen[1:])
    assert 250 < path_m < 400
