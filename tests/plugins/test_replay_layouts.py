"""KITTI-360, ScanNet's .sens, ETH3D's second camera, Bonn's markers, librealsense: made samples of known numbers."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from bags import CAMERA, HEIGHT, WIDTH, BagFile, picture
from helpers.replayed import refused, views

from rhs.api.geometry import BODY_FROM_OPTICAL, inverse, se3
from rhs.api.stereo import RIGHT_IMAGE, camera_of
from rhs_sources.replay_cameras import BONN_AXES, BONN_MARKERS

OPTICAL = se3(BODY_FROM_OPTICAL, np.zeros(3))
NAME = "2013_05_28_drive_0003_sync"
P = "50 0 31.5 {} 0 50 23.5 0 0 0 1 0"
QUARTER = "0 -1 0 1 0 0 0 0 1"  # of camera 0 about its axis, by which its images were rectified


def numbers(matrix):
    return " ".join(map(repr, np.asarray(matrix, float).ravel().tolist()))


def saved(path, value, size=(WIDTH, HEIGHT)):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((size[1], size[0], 3), value, np.uint8))


def kitti_360(root):
    """Three views of a car that goes a metre each; camera 1 sits 0.6 m to the right; of the second view no pose is known."""
    images, clouds, poses = (root / f"{kind}/{NAME}" for kind in ("data_2d_raw", "data_3d_raw", "data_poses"))
    for k in range(3):
        for eye in (0, 1):
            saved(images / f"image_0{eye}/data_rect/{k:010d}.png", 10 + k + 90 * eye)
        saved(images / f"image_02/data_rgb/{k:010d}.png", 200, (70, 70))
        (clouds / "velodyne_points/data").mkdir(parents=True, exist_ok=True)
        np.array([[3, 2, 1, 0.5]], "<f4").tofile(clouds / f"velodyne_points/data/{k:010d}.bin")
    for folder in (images / "image_00", images / "image_01", clouds / "velodyne_points"):
        (folder / "timestamps.txt").write_text("".join(f"2013-05-28 08:46:0{k}.500000000\n" for k in range(3)))
    for folder in (poses, root / "calibration"):
        folder.mkdir(parents=True)
    (poses / "cam0_to_world.txt").write_text("".join(
        f"{k} {numbers(se3(np.eye(3), np.array([k, 0.0, 5.0])) @ OPTICAL)} \n" for k in (0, 2)))
    (root / "calibration/perspective.txt").write_text(
        f"calib_time: 28-Sep-2013\nS_rect_00: {WIDTH}.0 {HEIGHT}.0\nR_rect_00: {QUARTER}\nP_rect_00: {P.format(0)}\n"
        f"P_rect_01: {P.format(-30)}\n")
    (root / "calibration/calib_cam_to_velo.txt").write_text(numbers(OPTICAL[:3]) + "\n")
    return images


def test_kitti_360_gives_images_clouds_and_the_poses_of_camera_0_by_their_numbers(tmp_path):
    source, seen = views(kitti_360(tmp_path), stereo=True)
    assert source.provides == {"image", "gray", "cloud", "right_image", "right_camera"}
    assert [int(capture.image[0, 0, 0]) for capture, _ in seen] == [10, 11, 12] and seen[1][1] is None
    assert [int(capture.extras[RIGHT_IMAGE][0, 0, 0]) for capture, _ in seen] == [100, 101, 102]
    np.testing.assert_allclose(seen[2][1], se3(np.eye(3), np.array([2.0, 0, 5.0])), atol=1e-9)
    np.testing.assert_allclose(camera_of(seen[0][0].extras["right_camera"]).body_from_camera[:3, 3], [0, -0.6, 0], atol=1e-9)
    assert seen[2][0].stamp_s - seen[0][0].stamp_s == pytest.approx(2.0)
    # ahead 3, left 2, up 1 is (-2, -1, 3) for camera 0, and (1, -2, 3) once its x axis is turned to its y: 1 to the right
    np.testing.assert_allclose(seen[0][0].extras["cloud"], [[3.0, -1.0, 2.0]], atol=1e-6)
    _, alone = views(tmp_path / "data_3d_raw" / NAME)
    np.testing.assert_allclose(alone[2][1], seen[2][1])


def test_kitti_360_without_its_calibration_or_with_a_broken_one_is_refused_in_one_line(tmp_path):
    images = kitti_360(tmp_path)
    (tmp_path / "calibration/calib_cam_to_velo.txt").write_text("1 2 3\n")
    assert "found 3 numbers; expected a 3x4 or 4x4 pose" in refused(images)
    (tmp_path / "calibration/perspective.txt").unlink()
    assert "unpack KITTI-360's calibration beside data_2d_raw, or type source.path=" in refused(images)


def sens(path, *, packed=1, version=4, aside=0.0):
    """Three views: colour 128x96, depth of 2 m in 64x48; the pose of the second was lost."""
    def matrix(f, cx, cy):
        return np.array([[f, 0, cx, 0], [0, f, cy, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "<f4").tobytes()

    def place(x):
        return se3(np.eye(3), np.array([x, 0.0, 0.0])).astype("<f4").tobytes()

    data = struct.pack("<IQ", version, 6) + b"sensor" + matrix(100, 63.5, 47.5) + place(0) + matrix(50, 31.5, 23.5)
    data += place(aside)
    data += struct.pack("<iiIIIIfQ", 2, packed, 128, 96, WIDTH, HEIGHT, 1000.0, 3)
    for k in range(3):
        jpeg = cv2.imencode(".jpg", np.full((96, 128, 3), 50 + k, np.uint8))[1].tobytes()
        deep = zlib.compress(np.full((HEIGHT, WIDTH), 2000, "<u2").tobytes())
        pose = se3(np.eye(3), np.array([0.5 * k, 0, 1.0])) @ OPTICAL if k != 1 else np.full((4, 4), -np.inf)
        data += pose.astype("<f4").tobytes() + struct.pack("<4Q", 0, 0, len(jpeg), len(deep)) + jpeg + deep
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("inside", [False, True])
def test_scannets_sens_gives_colour_as_small_as_depth_and_poses(tmp_path, inside):
    path = sens(tmp_path / "scene0000_00.sens")
    source, seen = views(tmp_path if inside else path)
    camera = source.camera
    assert (camera.width, camera.fx, camera.cx, camera.cy) == (WIDTH, 50.0, 31.5, 23.5)
    assert [int(capture.image[0, 0, 0]) for capture, _ in seen] == [50, 51, 52] and not source.timed
    assert (seen[0][0].depth == 2.0).all() and seen[1][1] is None
    np.testing.assert_allclose(seen[2][1], se3(np.eye(3), np.array([1.0, 0, 1.0])), atol=1e-6)


def test_depth_of_a_sens_that_sits_beside_colour_is_carried_to_it(tmp_path):
    """Its camera sits 0.2 m to the right: a point at 2 m moves by 50 * 0.2 / 2 = 5 pixels to the right."""
    _, seen = views(sens(tmp_path / "a.sens", aside=0.2))
    known = np.flatnonzero(np.isfinite(seen[0][0].depth[HEIGHT // 2]))
    assert known[0] == 5 and known[-1] == WIDTH - 1


def test_a_sens_that_is_cut_is_read_as_far_as_it_goes_and_broken_ones_are_refused(tmp_path):
    path = sens(tmp_path / "a.sens")
    path.write_bytes(path.read_bytes()[:-20])
    source, seen = views(path)
    assert len(seen) == 2 and "it holds 2 of 3 views" in source.lost
    path.write_bytes(path.read_bytes()[:100])
    assert "cannot be read as ScanNet's .sens" in refused(path)
    assert "found version 3" in refused(sens(path, version=3))
    assert "found 3 whole views, depth of compression 2" in refused(sens(path, packed=2))


def test_eth3d_has_its_second_camera_beside_the_first(tmp_path):
    for k in range(3):
        for eye in ("rgb", "rgb2"):
            saved(tmp_path / f"{eye}/{k}.5.png", 10 + k + 90 * (eye == "rgb2"))
    (tmp_path / "rgb.txt").write_text("".join(f"{k}.5 rgb/{k}.5.png\n" for k in range(3)))
    (tmp_path / "calibration.txt").write_text("50 50 31.5 23.5\n")
    (tmp_path / "calibration2.txt").write_text("52 52 30 24\n")
    assert "holds no extrinsics_1_2.txt; a second camera is read from rgb2" in refused(tmp_path, stereo=True)
    (tmp_path / "extrinsics_1_2.txt").write_text("1 0 0 0.1\n0 1 0 0\n0 0 1 0\n")  # a point 1 m ahead of it: (0.1, 0, 1)
    _, seen = views(tmp_path, stereo=True)
    right = camera_of(seen[2][0].extras["right_camera"])
    assert int(seen[2][0].extras[RIGHT_IMAGE][0, 0, 0]) == 102 and (right.fx, right.cx) == (52.0, 30.0)
    np.testing.assert_allclose(right.body_from_camera[:3, 3], [0, -0.1, 0], atol=1e-12)
    (tmp_path / "extrinsics_1_2.txt").write_text("1 0 0\n")
    assert "found 3 numbers; expected a 3x4 or 4x4 pose" in refused(tmp_path, stereo=True)


def test_the_true_poses_of_bonn_are_those_of_markers_in_axes_of_their_own(tmp_path):
    """A camera that looks along x, z up, half a metre further each view."""
    from scipy.spatial.transform import Rotation

    folder, lines = tmp_path / "rgbd_bonn_static", ""
    for k in range(3):
        saved(folder / f"rgb/{k}.5.png", 10)
        pose = BONN_AXES @ se3(np.eye(3), np.array([0.5 * k, 0, 1.0])) @ OPTICAL @ inverse(BONN_AXES @ BONN_MARKERS)
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
        lines += f"{k}.5 {numbers(pose[:3, 3])} {numbers(turn)}\n"
    (folder / "rgb.txt").write_text("".join(f"{k}.5 rgb/{k}.5.png\n" for k in range(3)))
    (folder / "groundtruth.txt").write_text(lines)
    _, seen = views(folder, camera=[50.0, 50.0, 31.5, 23.5])
    for k, (_, pose) in enumerate(seen):
        np.testing.assert_allclose(pose, se3(np.eye(3), np.array([0.5 * k, 0, 1.0])), atol=1e-9)


@pytest.mark.parametrize("model", ["Brown Conrady", "Inverse Brown Conrady", "Modified Brown Conrady"])
def test_lenses_as_librealsense_calls_them_are_opencvs(tmp_path, model):
    lens = (0.1, -0.2, 0.001, -0.002, 0.05)
    with BagFile(tmp_path, "ros1") as bag:
        bag.camera_info("/device_0/sensor_1/Color_0/info/camera_info", 1e9, lens, model)
        bag.image("/device_0/sensor_1/Color_0/image/data", 1e9, picture(), "rgb8", frame="1")
    assert views(bag.path)[0].camera.distortion == lens


def test_the_two_infrared_cameras_of_a_realsense_are_a_pair(tmp_path):
    """The second sits 0.05 m to the right: points of the first are 0.05 m further left for it."""
    with BagFile(tmp_path, "ros1") as bag:
        for eye, x in (("Infrared_1", 0.0), ("Infrared_2", -0.05)):
            topic = f"/device_0/sensor_0/{eye}"
            bag.camera_info(f"{topic}/info/camera_info", 1e9, camera=replace(CAMERA, fx=60.0))
            bag.image(f"{topic}/image/data", 1e9, picture()[:, :, 0], "8UC1", frame="1")
            bag.put(f"{topic}/tf/0", 1e9, bag.make(
                "geometry_msgs/msg/Transform", translation=bag.make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=0.0),
                rotation=bag.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)))
    source, seen = views(bag.path, stereo=True)
    place = inverse(source.camera.body_from_camera) @ camera_of(seen[0][0].extras["right_camera"]).body_from_camera
    np.testing.assert_allclose(place, se3(np.eye(3), np.array([0.05, 0, 0])), atol=1e-9)
