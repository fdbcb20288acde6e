"""Replaying KITTI raw and TartanAir: made samples whose poses can be computed by hand, and broken ones."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.replayed import refused, views

from rhs.api.geometry import BODY_FROM_OPTICAL
from rhs.api.stereo import camera_of

P = "50 0 31.5 {} 0 50 23.5 0 0 0 1 0"
ONE = "1 0 0 0 1 0 0 0 1"
SOUTH_M = 111319.49  # of one degree of latitude at the equator: 6378137 m * pi / 180


def pictures(folder, name, value, count=3, size=(64, 48)):
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        cv2.imwrite(str(folder / name.format(k)), np.full((size[1], size[0], 3), value + k, np.uint8))


def kitti_raw(day):
    """A car that looks and drives east, a metre a view, on the equator. Its IMU, x ahead and z up, sits 0.8 m ahead of the
    Velodyne, and that 0.25 m behind camera 0."""
    drive = day / "2011_09_26_drive_0005_sync"
    for k, camera in enumerate(("image_02", "image_03")):
        pictures(drive / camera / "data", "{:010d}.png", 10 + 90 * k)
        (drive / camera / "timestamps.txt").write_text("".join(f"2011-09-26 13:02:25.{k}00000000\n" for k in (5, 6, 7)))
    (drive / "velodyne_points" / "data").mkdir(parents=True)
    (drive / "oxts" / "data").mkdir(parents=True)
    for k in range(3):
        np.array([[10 + k, 2, 1, 0.5]], "<f4").tofile(drive / "velodyne_points" / "data" / f"{k:010d}.bin")
        (drive / "oxts" / "data" / f"{k:010d}.txt").write_text(f"0 {8 + k / SOUTH_M:.12f} 100 0 0 0" + " 0" * 24 + "\n")
    (day / "calib_cam_to_cam.txt").write_text(
        f"calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 64 48\nR_rect_00: {ONE}\nP_rect_00: {P.format(0)}\n"
        f"P_rect_02: {P.format(-25)}\nP_rect_03: {P.format(-50)}\n")
    (day / "calib_velo_to_cam.txt").write_text("R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 -0.25\n")
    (day / "calib_imu_to_velo.txt").write_text(f"R: {ONE}\nT: 0.8 0 0\n")
    return drive


def test_a_drive_of_kitti_raw_gives_images_clouds_stamps_and_the_poses_of_camera_0(tmp_path):
    """The body sits at camera 0, whose axis is the car's: 0.25 - 0.8 m from the IMU, the origin of east, north and up."""
    source, seen = views(kitti_raw(tmp_path), stereo=True)
    assert source.provides == {"image", "gray", "cloud", "right_image", "right_camera"}
    np.testing.assert_allclose(source.camera.body_from_camera[:3, 3], [0, -0.5, 0], atol=1e-12)
    capture, truth = seen[2]
    np.testing.assert_allclose(capture.extras["cloud"], [[11.75, 2.0, 1.0]], atol=1e-6)
    np.testing.assert_allclose(camera_of(capture.extras["right_camera"]).body_from_camera[:3, 3], [0, -1.0, 0], atol=1e-12)
    assert capture.image[0, 0, 0] == 12 and capture.extras["right_image"][0, 0, 0] == 102
    assert capture.stamp_s - seen[0][0].stamp_s == pytest.approx(0.2, abs=1e-6)
    np.testing.assert_allclose(truth[:3, :3], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(truth[:3, 3], [2.0 - 0.55, 0, 0], atol=1e-5)


def test_a_car_that_looks_north_has_its_left_in_the_west(tmp_path):
    drive = kitti_raw(tmp_path)
    (drive / "oxts" / "data" / f"{0:010d}.txt").write_text(f"0 8 100 0 0 {np.pi / 2}" + " 0" * 24)
    np.testing.assert_allclose(views(drive)[1][0][1][:3, :2].T, [[0, 1, 0], [-1, 0, 0]], atol=1e-9)


def test_broken_drives_of_kitti_raw_are_refused_in_one_line(tmp_path):
    drive = kitti_raw(tmp_path)
    (drive / "oxts" / "data" / f"{1:010d}.txt").write_text("0 8 100")
    assert "0000000001.txt: found 3 numbers; expected the 30" in refused(drive)
    (drive / "image_02" / "timestamps.txt").write_text("2011-09-26 13:02:25.5\nyesterday\n")
    assert "image_02/timestamps.txt:2: found 'yesterday'" in refused(drive)
    (drive / "image_02" / "timestamps.txt").write_text("2011-09-26 13:02:25.5\n")
    assert "1 lines but the last view is number 2" in refused(drive)
    (tmp_path / "calib_velo_to_cam.txt").write_text("R: 1 0 0\nT: 0 0 0\n")
    assert "calib_velo_to_cam.txt: found 3 numbers of R; expected 9" in refused(drive)
    pictures(drive / "image_02" / "data", "{:010d}.png", 10, size=(80, 48))
    assert "images are 80x48 but rectified ones 64x48" in refused(drive)
    (tmp_path / "calib_cam_to_cam.txt").unlink()
    assert "no calib_cam_to_cam.txt in it or beside it" in refused(drive)
    assert f"type source.path={drive}" in refused(tmp_path)


def tartan(folder, side="left", other="right"):
    """Three views with depth 3 m, and sky at 10 km in one corner; the camera begins at (1, 2, -3) of a world whose z points
    down, looks along x and goes ahead by a metre a view."""
    pictures(folder / f"image_{side}", "{:06d}_" + side + ".png", 10)
    pictures(folder / f"image_{other}", "{:06d}_" + other + ".png", 100)
    (folder / f"depth_{side}").mkdir()
    for k in range(3):
        depth = np.full((48, 64), 3.0, np.float32)
        depth[0, 0] = 1e4
        name = str(folder / f"depth_{side}" / f"{k:06d}_{side}_depth")
        if side == "left":
            np.save(name + ".npy", depth)
        else:
            cv2.imwrite(name + ".png", depth.view(np.uint8).reshape(48, 64, 4))
    (folder / f"pose_{side}.txt").write_text("".join(f"{1 + k} 2 -3 0 0 0 1\n" for k in range(3)))
    return folder


@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("lcam_front", "rcam_front")])
def test_tartan_air_gives_depth_in_metres_and_poses_in_a_world_whose_z_points_up(tmp_path, side, other):
    """A field of view of 90 degrees: f is half the width. Up is z: 3 m above; right, which was y, is now -y."""
    source, seen = views(tartan(tmp_path, side, other), stereo=True)
    camera = source.camera
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (64, 48, 32, 32, 32, 24)
    capture, truth = seen[1]
    assert np.isnan(capture.depth[0, 0]) and capture.depth[1, 1] == 3.0 and capture.stamp_s == pytest.approx(0.1)
    assert capture.image[0, 0, 0] == 11 and capture.extras["right_image"][0, 0, 0] == 101
    np.testing.assert_allclose(truth[:3, 3], [2.0, -2.0, 3.0], atol=1e-12)
    np.testing.assert_allclose((truth @ camera.body_from_camera)[:3, :3], BODY_FROM_OPTICAL, atol=1e-12)
    aside = camera_of(capture.extras["right_camera"]).body_from_camera - camera.body_from_camera
    np.testing.assert_allclose(camera.body_from_camera[:3, :3].T @ aside[:3, 3], [0.25, 0, 0], atol=1e-12)


def test_a_camera_of_tartan_air_that_turns_right_turns_right(tmp_path):
    """90 degrees about the axis that points down: from x ahead to y, the right, which is -y of a world whose z points up."""
    folder = tartan(tmp_path)
    (folder / "pose_left.txt").write_text(f"0 0 0 0 0 {0.5**0.5} {0.5**0.5}\n" * 3)
    source, seen = views(folder)
    optical = (seen[0][1] @ source.camera.body_from_camera)[:3, :3]
    np.testing.assert_allclose(optical[:, 2], [0, -1, 0], atol=1e-9)
    np.testing.assert_allclose(optical[:, 1], [0, 0, -1], atol=1e-9)


def test_broken_folders_of_tartan_air_are_refused_in_one_line(tmp_path):
    folder = tartan(tmp_path)
    (folder / "pose_left.txt").write_text("1 2 3\n")
    assert "pose_left.txt:1: found 3 columns; expected tx ty tz qx qy qz qw" in refused(folder)
    (folder / "pose_left.txt").write_text("1 2 3 0 0 0 0\n")
    assert "pose_left.txt:1" in refused(folder)
    (folder / "pose_left.txt").unlink()
    assert views(folder)[1][0][1] is None
    for file in (folder / "depth_left").glob("*"):
        file.rename(file.with_name("9" + file.name))
    assert "no two with one number" in refused(folder)
    assert "depth" not in views(folder, depth_topic="none")[0].provides
    (folder / "image_right").rename(folder / "elsewhere")
    assert "holds no image_right" in refused(folder, stereo=True)


@pytest.mark.parametrize(("settings", "words"), [
    ({"format": "kitti"}, "calib.txt: no such file"),
    ({"truth_frame": "world"}, "source.truth_frame: a recording of the kind tartan has no use for it"),
    ({"format": "run"}, "is no recording that rhs wrote")])
def test_what_does_not_belong_to_a_form_is_refused_in_one_line(tmp_path, settings, words):
    assert words in refused(tartan(tmp_path), **settings)
