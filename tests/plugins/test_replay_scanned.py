"""Recordings of ARKitScenes, ScanNet++, 3D Scanner App, Polycam, Record3D, SceneNet RGB-D, KITTI-360, Monado, AirSim, Livox
and thermal cameras as people have them."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from bags import BagFile, F, picture
from helpers.replayed import refused, views
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from rhs.api.geometry import exp_so3, inverse, quaternion_xyzw, se3

DEEP = np.full((48, 64), 2000, np.uint16)
CAMERA = [F, F, 31.5, 23.5]
MATRIX = np.array([[F, 0, 31.5], [0, F, 23.5], [0, 0, 1]])
WAY = [se3(exp_so3(np.array([0.1 * k, 0.2, 0.3 * k])), np.array([0.1 * k, 0.5, -0.2 * k])) for k in range(3)]
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def put(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def is_way(seen, source):
    """Whether the true poses are WAY's, of the camera."""
    return np.allclose([truth @ source.camera.body_from_camera for _, truth in seen], WAY, atol=1e-6)


def test_arkitscenes_has_its_poses_beside_its_images(tmp_path):
    lines = ""
    for k, pose in enumerate(WAY):
        put(tmp_path / f"lowres_wide/40753679_{6791.1 + 0.1 * k:.3f}.png", picture(k))
        put(tmp_path / f"lowres_depth/40753679_{6791.1 + 0.1 * k:.3f}.png", DEEP)
        tcw = inverse(pose)
        numbers = [6791.1 + 0.1 * k, *Rotation.from_matrix(tcw[:3, :3]).as_rotvec(), *tcw[:3, 3]]
        lines += " ".join(f"{v:.9f}" for v in numbers) + "\n"
    (tmp_path / "lowres_wide.traj").write_text(lines)
    source, seen = views(tmp_path, camera=CAMERA)
    assert is_way(seen, source) and seen[0][0].depth[0, 0] == pytest.approx(2.0)


def test_scannetpp_has_camera_and_poses_by_the_number_of_each_frame(tmp_path):
    """Of every frame of the video; people unpack some of them."""
    told = {f"frame_{k:06d}": {"timestamp": k / 60, "pose": np.eye(4).tolist(), "intrinsic": MATRIX.tolist(),
                               "aligned_pose": WAY[k // 10].tolist()} for k in range(30)}
    (tmp_path / "pose_intrinsic_imu.json").write_text(json.dumps(told))
    for k in range(3):
        put(tmp_path / f"rgb/frame_{10 * k:06d}.jpg", picture(k))
        put(tmp_path / f"depth/frame_{10 * k:06d}.png", DEEP)
    source, seen = views(tmp_path)
    assert is_way(seen, source) and (source.camera.fx, source.camera.cx) == (F, 31.5)


def test_the_scanner_app_keeps_all_in_one_folder(tmp_path):
    """Images of confidence beside; a pose looks along -z, with y up."""
    for k, pose in enumerate(WAY):
        put(tmp_path / f"frame_{k:05d}.jpg", picture(k))
        put(tmp_path / f"depth_{k:05d}.png", DEEP)
        put(tmp_path / f"conf_{k:05d}.png", np.full((48, 64), 2, np.uint8))
        told = {"cameraPoseARFrame": (pose @ FLIP).ravel().tolist(), "intrinsics": MATRIX.ravel().tolist()}
        (tmp_path / f"frame_{k:05d}.json").write_text(json.dumps(told))
    source, seen = views(tmp_path)
    assert len(seen) == 3 and is_way(seen, source) and (source.camera.fx, source.camera.cx) == (F, 31.5)
    assert seen[0][0].depth[0, 0] == pytest.approx(2.0)


def test_polycam_has_a_pose_in_each_camera(tmp_path):
    (tmp_path / "cameras").mkdir()
    for k, pose in enumerate(WAY):
        put(tmp_path / f"images/{1700000000000 + 100 * k}.jpg", picture(k))
        told = {f"t_{row}{column}": (pose @ FLIP)[row, column] for row in range(3) for column in range(4)}
        told |= {"fx": F, "fy": F, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
        (tmp_path / f"cameras/{1700000000000 + 100 * k}.json").write_text(json.dumps(told))
    source, seen = views(tmp_path)
    assert is_way(seen, source)


def test_record3d_names_its_camera_and_its_depth_is_said_to_be_left_out(tmp_path, caplog):
    poses = [[*quaternion_xyzw((pose @ FLIP)[:3, :3]), *pose[:3, 3]] for pose in WAY]
    (tmp_path / "metadata.json").write_text(json.dumps({"w": 64, "h": 48, "K": MATRIX.T.ravel().tolist(), "poses": poses}))
    (tmp_path / "depth").mkdir()
    for k in range(3):
        put(tmp_path / f"rgb/{k}.jpg", picture(k))
        (tmp_path / f"depth/{k}.exr").write_bytes(b"\x76\x2f\x31\x01")
    source, seen = views(tmp_path, truth=str(tmp_path / "metadata.json"))
    assert is_way(seen, source) and (source.camera.fx, source.camera.cx) == (F, 31.5)
    assert "no depth is read from depth; expected numbered .png" in caplog.text and "others as .npy (metres)" in caplog.text


@pytest.mark.parametrize("names", [
    ["2020-09-13_12-26-59.500", "2020-09-13_12-27-00.500", "2020-09-13_12-27-01.500"],
    ["IMG_20200913_122659500", "IMG_20200913_122700500", "IMG_20200913_122701500"],
])
def test_dates_in_names_are_the_times_of_the_views_over_the_end_of_a_minute(tmp_path, names):
    """They were led by their seconds alone: the first last. `date -u -d @1600000019` prints 12:26:59."""
    for k, name in enumerate(names):
        put(tmp_path / f"rgb/{name}.png", np.full((48, 64), 10 + 20 * k, np.uint8))
        put(tmp_path / f"depth/{name}.png", np.full((48, 64), 1000 + k, np.uint16))
    seen = [capture for capture, _ in views(tmp_path, camera=CAMERA)[1]]
    assert [capture.stamp_s for capture in seen] == [1600000019.5, 1600000020.5, 1600000021.5]
    assert [int(capture.image[0, 0, 0]) for capture in seen] == [10, 30, 50]
    assert [round(float(capture.depth[0, 0]), 3) for capture in seen] == [1.0, 1.001, 1.002]


def test_numbers_that_are_no_dates_stay_numbers(tmp_path):
    for k in (1, 2):
        put(tmp_path / f"rgb/2020023012265{k}.png", picture(k))  # the 30th of February
    assert [capture.stamp_s for capture, _ in views(tmp_path, camera=CAMERA)[1]] == [0.0, pytest.approx(1 / 30)]


def test_lists_with_times_of_iso_8601_are_read(tmp_path):
    for k in range(2):
        put(tmp_path / f"rgb/{k}.png", picture(k))
    lines = "".join(f"2020-09-13T12:26:4{k}.500Z rgb/{k}.png\n" for k in range(2))
    (tmp_path / "rgb.txt").write_text(lines)
    assert [capture.stamp_s for capture, _ in views(tmp_path, camera=CAMERA)[1]] == [1600000000.5, 1600000001.5]


def test_openloris_says_its_camera_with_cx_before_fy(tmp_path):
    """The numbers of its own sensors.yaml, halved: 848 x 480, the middle near 433 and 249."""
    for k in range(2):
        put(tmp_path / f"color/{k}.png", np.full((240, 424), 9, np.uint8))
    (tmp_path / "color.txt").write_text("1.0 color/0.png\n2.0 color/1.png\n")
    (tmp_path / "sensors.yaml").write_text(
        "%YAML:1.0\n---\nd400_color_optical_frame:\n   width: 424\n   height: 240\n   model: pinhole\n   intrinsics: "
        "!!opencv-matrix\n      rows: 1\n      cols: 4\n      dt: d\n      data: [ 305.7, 216.6, 305.8, 124.7 ]\n")
    camera = views(tmp_path)[0].camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (305.7, 305.8, 216.6, 124.7)


@pytest.mark.parametrize("order", ["<f4", ">f4"])
def test_depth_in_pfm_is_metres_from_the_lowest_row_up_and_infinite_is_unknown(tmp_path, order):
    """Debevec's format: a scale below zero says that the low byte comes first."""
    depth = np.linspace(1.0, 3.0, 48 * 64, dtype=np.float32).reshape(48, 64)
    depth[5, 7] = np.inf
    (tmp_path / "depth").mkdir()
    for k in range(2):
        put(tmp_path / f"rgb/{k}.png", picture(k))
        head = f"Pf\n64 48\n{-1.0 if order == '<f4' else 1.0}\n".encode()
        (tmp_path / f"depth/{k}.pfm").write_bytes(head + depth[::-1].astype(order).tobytes())
    seen = [capture.depth for capture, _ in views(tmp_path, camera=CAMERA)[1]]
    np.testing.assert_array_equal(seen, [np.where(np.isfinite(depth), depth, np.nan)] * 2)
    (tmp_path / "depth/0.pfm").write_bytes(b"Pf\n64 48\n-1.0\n")
    (tmp_path / "depth/1.pfm").write_bytes(b"Pf\n64000 48000\n-1.0\n")
    assert "0.pfm: found 14 bytes that are no image" in refused(tmp_path, camera=CAMERA)
    (tmp_path / "depth/0.pfm").write_bytes(b"Pf\n64000 48000\n-1.0\n")
    assert "64000 x 48000 pixels" in refused(tmp_path, camera=CAMERA)


def test_other_metadata_is_no_camera(tmp_path):
    (tmp_path / "metadata.json").write_text('{"author": "me"}')
    put(tmp_path / "rgb/1.png", picture())
    assert "holds no camera intrinsics" in refused(tmp_path)


def test_depth_of_scenenet_lies_along_the_rays(tmp_path):
    for k in range(3):
        put(tmp_path / f"photo/{25 * k}.jpg", picture(k))
        put(tmp_path / f"depth/{25 * k}.png", DEEP)
    _, seen = views(tmp_path, camera=CAMERA)
    assert seen[0][0].depth[24, 32] == pytest.approx(2.0, abs=1e-3)
    assert seen[0][0].depth[0, 0] == pytest.approx(2.0 / np.sqrt(1 + (31.5 / F) ** 2 + (23.5 / F) ** 2), abs=1e-5)


@pytest.mark.parametrize("inside", ["", "data_rect"])
def test_kitti_360_has_the_times_a_folder_up(tmp_path, inside):
    for k in range(3):
        put(tmp_path / f"data_rect/{k:010d}.png", picture(k))
    (tmp_path / "timestamps.txt").write_text("".join(f"2013-05-28 08:46:02.{k}00000000\n" for k in range(4)))
    source, seen = views(tmp_path / inside, camera=CAMERA)
    assert source.timed and seen[2][0].stamp_s - seen[0][0].stamp_s == pytest.approx(0.2)
    assert not views(tmp_path, camera=CAMERA, rate_hz=10.0)[1][0][0].stamp_s


def test_monado_keeps_its_truth_in_gt_and_depth_beside_is_said_to_be_left_out(tmp_path, caplog):
    stamps = [1_600_000_000_000_000_000 + k * 50_000_000 for k in range(3)]
    for stamp in stamps:
        put(tmp_path / f"mav0/cam0/data/{stamp}.png", picture())
    (tmp_path / "mav0/cam0/data.csv").write_text("".join(f"{stamp},{stamp}.png\n" for stamp in stamps))
    (tmp_path / "mav0/cam0/sensor.yaml").write_text(
        "T_BS:\n  data: [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]\ncamera_model: pinhole\nresolution: [64, 48]\n"
        f"intrinsics: {CAMERA}\ndistortion_model: radial-tangential\ndistortion_coefficients: [0,0,0,0]\n")
    for name in ("gt", "depth0"):
        (tmp_path / "mav0" / name).mkdir()
    (tmp_path / "mav0/gt/data.csv").write_text("".join(
        f"{stamp}," + ",".join(f"{v:.9f}" for v in (*pose[:3, 3], *np.roll(quaternion_xyzw(pose[:3, :3]), 1))) + "\n"
        for stamp, pose in zip(stamps, WAY, strict=True)))
    source, seen = views(tmp_path)
    assert is_way(seen, source) and "depth0 is not read" in caplog.text


def test_thermal_images_that_hardly_use_their_bits_are_said(tmp_path, caplog):
    rng = np.random.default_rng(0)
    for k in range(2):
        put(tmp_path / f"rgb/{k}.png", rng.integers(21000, 25000, (48, 64)).astype(np.uint16))
    views(tmp_path, camera=CAMERA)
    assert "of 16 bits use a small part of them" in caplog.text
    caplog.clear()
    put(tmp_path / "rgb/0.png", rng.integers(0, 65535, (48, 64)).astype(np.uint16))
    views(tmp_path, camera=CAMERA)
    assert "of 16 bits" not in caplog.text


def test_depth_of_airsim_that_is_not_read_is_said(tmp_path, caplog):
    for k in range(2):
        put(tmp_path / f"images/img_Drone_0_0_160000010{k}000000000.png", picture(k))
        (tmp_path / f"images/img_Drone_0_1_160000010{k}000000000.pfm").write_bytes(b"Pf\n")
    assert len(views(tmp_path, camera=CAMERA)[1]) == 2
    assert "no depth is read from its 2 files such as img_Drone_0_1" in caplog.text


@pytest.mark.parametrize("kind", ["ros1", "ros2_mcap", "ros2_sqlite"])
@pytest.mark.parametrize("driver", ["livox_ros_driver", "livox_ros_driver2"])
def test_livoxs_own_message_is_a_cloud_with_times(tmp_path, kind, driver):
    """A .db3 does not say what such a message holds. The first point, at the scanner, met nothing."""
    points = np.random.default_rng(0).uniform(-5.0, 5.0, (200, 3)).astype(np.float32)
    points[0] = 0.0
    with BagFile(tmp_path, kind) as bag:
        bag.store.register(get_types_from_msg("uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\n"
                                              "uint8 tag\nuint8 line\n", f"{driver}/msg/CustomPoint"))
        bag.store.register(get_types_from_msg("std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\n"
                                              f"uint8[3] rsvd\n{driver}/CustomPoint[] points\n", f"{driver}/msg/CustomMsg"))
        for k in range(2):
            seen = [bag.make(f"{driver}/msg/CustomPoint", offset_time=500_000 * n, x=x, y=y, z=z, reflectivity=1, tag=0,
                             line=0) for n, (x, y, z) in enumerate(points.tolist())]
            bag.put("/livox/lidar", 100.0 + 0.1 * k, bag.make(
                f"{driver}/msg/CustomMsg", header=bag.header(100.0 + 0.1 * k, "livox_frame"), timebase=0,
                point_num=len(seen), lidar_id=0, rsvd=np.zeros(3, np.uint8), points=seen))
    source, found = views(bag.path)
    assert source.provides == {"cloud"} and len(found) == 2
    assert np.array_equal(found[0][0].extras["cloud"], points[1:])
    assert found[0][0].extras["cloud_time_s"] == pytest.approx(5e-4 * np.arange(1, 200), abs=1e-7)
