"""Replaying numbered images, videos, KITTI and EuRoC: made samples small enough to compute by hand, and broken ones."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from helpers.replayed import refused, views

import rhs
from rhs.api.geometry import BODY_FROM_OPTICAL, inverse
from rhs.api.stereo import camera_of
from rhs.api.trajectory import read_tum

K = [50.0, 50.0, 31.5, 23.5]
P = "50 0 31.5 {} 0 50 23.5 0 0 0 1 0"


def images(folder, names, value=10, shape=(48, 64, 3)):
    """Grey images, each one level brighter than the one before."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full(shape, value + k, np.uint8))
    return folder


def depths(folder, names, value=1500, shape=(48, 64), step=1):
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full(shape, value + step * k, np.uint16))


def test_numbered_images_come_in_the_order_of_their_numbers_and_pair_by_them(tmp_path):
    images(tmp_path / "rgb", ["2.png", "10.png", "11.png"])
    depths(tmp_path / "depth", ["2.png", "10.png", "12.png"])
    source, seen = views(tmp_path, camera=K, rate_hz=20.0)
    assert [int(c.image[0, 0, 0]) for c, _ in seen] == [10, 11] and [c.stamp_s for c, _ in seen] == [0.0, 0.05]
    assert seen[1][0].depth[3, 3] == np.float32(1.501)
    assert source.provides == {"image", "gray", "depth"}


def test_a_folder_of_colour_alone_is_read_and_says_that_it_has_no_depth(tmp_path):
    images(tmp_path, ["img_0001.png", "img_0002.png", "img_0003.png"])
    source, seen = views(tmp_path, camera=K, start=1)
    assert source.provides == {"image", "gray"} and seen[0][0].depth is None
    assert [c.stamp_s for c, _ in seen] == pytest.approx([1 / 30, 2 / 30])


@pytest.mark.parametrize(("names", "stamps"), [
    (["100.25.png", "100.75.png"], [100.25, 100.75]),
    (["1403636579763555584.png", "1403636579813555456.png"], [1403636579.763555584, 1403636579.813555456]),
    (["1403636579763.png", "1403636579813.png"], [1403636579.763, 1403636579.813]),
])
def test_names_that_are_times_are_the_stamps(tmp_path, names, stamps):
    images(tmp_path / "color", names)
    _, seen = views(tmp_path, camera=K)
    assert [c.stamp_s for c, _ in seen] == pytest.approx(stamps, abs=1e-6)


def test_a_camera_carried_fast_past_numbered_images_is_not_taken_for_one_that_leaps(tmp_path):
    """A textured wall 1.5 m ahead slides by 0.06, then 0.3, then 0.06 m a view: at 30 views a second, which nobody said,
    that would be 2, 9 and 2 m/s. Typed as the rate, it is a leap."""
    texture = np.random.default_rng(0).integers(0, 255, (60, 80, 3)).astype(np.uint8)
    wall = cv2.resize(texture, (640, 480), interpolation=cv2.INTER_CUBIC)
    for folder in ("rgb", "depth"):
        (tmp_path / "way" / folder).mkdir(parents=True)
    for k, at in enumerate((0, 8, 16, 56, 64)):  # pixels, of 0.0075 m each
        cv2.imwrite(str(tmp_path / "way" / "rgb" / f"{k}.png"), wall[100:340, at:at + 320])
    depths(tmp_path / "way" / "depth", [f"{k}.png" for k in range(5)], shape=(240, 320), step=0)
    words = ["task=survey", "source=replay", f"source.path={tmp_path / 'way'}", "source.camera=[200,200,159.5,119.5]",
             "odometry=procrustes", "loop_closer=none", "pictures=off"]
    free = rhs.run([*words, f"output={tmp_path / 'free'}"], quiet=True)
    held = rhs.run([*words, "source.rate_hz=30", f"output={tmp_path / 'held'}"], quiet=True)
    assert (free["gated_share"], held["gated_share"]) == (0.0, 0.2)
    way = read_tum(tmp_path / "free" / "estimate.tum").positions_m
    assert np.linalg.norm(np.diff(way, axis=0), axis=1) == pytest.approx([0.06, 0.06, 0.3, 0.06], abs=0.004)


def test_a_source_knows_whether_somebody_says_when_its_views_were_taken(tmp_path):
    images(tmp_path / "numbered", ["1.png", "2.png"])
    images(tmp_path / "stamped", ["100.25.png", "100.75.png"])
    assert not views(tmp_path / "numbered", camera=K)[0].timed
    assert views(tmp_path / "numbered", camera=K, rate_hz=5.0)[0].timed and views(tmp_path / "stamped", camera=K)[0].timed


def test_poses_of_kitti_form_belong_to_the_images_by_line(tmp_path):
    images(tmp_path / "rgb", ["0.png", "1.png"])
    (tmp_path / "way.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 3\n")
    _, seen = views(tmp_path, camera=K, truth=str(tmp_path / "way.txt"), start=1)
    np.testing.assert_allclose(seen[0][1][:3, 3], [0, 0, 3])
    np.testing.assert_allclose(seen[0][1][:3, :3], BODY_FROM_OPTICAL.T, atol=1e-12)


def test_as_many_poses_as_images_without_times_are_one_each(tmp_path):
    """Their stamps are of a clock that the images do not tell; at a rate that is typed they are minded."""
    images(tmp_path / "rgb", ["0.webp", "1.webp", "2.webp"])
    (tmp_path / "groundtruth.txt").write_text("".join(f"{0.4 * k:.1f} {k} 0 0 0 0 0 1\n" for k in range(3)), "utf-8")
    assert [truth[0, 3] for _, truth in views(tmp_path, camera=K)[1]] == [0, 1, 2]
    assert [truth is None for _, truth in views(tmp_path, camera=K, rate_hz=30.0)[1]] == [False, True, True]


def test_numbered_images_that_do_not_fit_are_refused_in_one_line(tmp_path):
    images(tmp_path / "rgb", ["1.png", "2.png"])
    depths(tmp_path / "depth", ["7.png"])
    assert "2 colour and 1 depth images, no two with one number" in refused(tmp_path, camera=K)
    depths(tmp_path / "depth", ["1.png"], value=1)
    assert "typical depth is 0.001 m" in refused(tmp_path, camera=K)
    (tmp_path / "rgb" / "1.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    assert "found 8 bytes that are no image" in refused(tmp_path, camera=K)


def test_depth_in_a_form_that_is_not_read_is_told_what_to_write(tmp_path):
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
    images(tmp_path / "rgb", ["1.png"])
    (tmp_path / "depth/1.exr").write_bytes(bytes.fromhex("762f3101") + bytes(100))
    for name, file in (("rgb", "1.png"), ("depth", "1.exr")):
        (tmp_path / f"{name}.txt").write_text(f"1.0 {name}/{file}\n", "utf-8")
    assert refused(tmp_path, camera=K).endswith("write it as .npy (metres) or as 16-bit .png")


def test_a_later_image_of_another_size_is_left_out_and_said_to_be_lost(tmp_path):
    images(tmp_path / "rgb", ["1.png", "2.png", "3.png"])
    images(tmp_path / "rgb", ["2.png"], shape=(24, 32, 3))
    source, seen = views(tmp_path, camera=K)
    assert len(seen) == 2 and "1 of 3 views cannot be read" in source.lost and "32x24" in source.lost


ROS_INFO = """image_width: 64
image_height: 48
camera_matrix: {rows: 3, cols: 3, data: [50.0, 0, 31.5, 0, 51.0, 23.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0.02, 0]}
"""
OPEN3D = json.dumps({"width": 64, "height": 48, "intrinsic_matrix": [50.0, 0, 0, 0, 51.0, 0, 31.5, 23.5, 1]})


@pytest.mark.parametrize(("name", "text", "lens"), [
    ("camera_info.yaml", ROS_INFO, (0.1, 0.0, 0.0, 0.02, 0.0)),
    ("camera_intrinsic.json", OPEN3D, ()),
    ("camera.json", json.dumps({"fx": 50, "fy": 51, "cx": 31.5, "cy": 23.5, "k1": 0.1}), (0.1, 0.0, 0.0, 0.0, 0.0)),
    ("camera.json", json.dumps({"fx": 50, "fy": 51, "ppx": 31.5, "ppy": 23.5, "width": 64, "height": 48}), ()),
    ("intrinsics.txt", "50 0 31.5\n0 51 23.5\n0 0 1\n", ()),
    ("intrinsics.txt", "50 51 31.5 23.5 0.1 0 0 0.02 0\n", (0.1, 0.0, 0.0, 0.02, 0.0)),
    ("intrinsics.txt", "50 0 31.5 0\n0 51 23.5 0\n0 0 1 0\n0 0 0 1\n", ()),
    ("cameras.txt", "# COLMAP\n1 OPENCV 64 48 50 51 32 24 0.1 0 0 0.02\n", (0.1, 0.0, 0.0, 0.02, 0.0)),
    ("sparse/0/cameras.txt", "1 PINHOLE 64 48 50 51 32 24\n", ()),
    ("lowres_wide_intrinsics/41_6855.104.pincam", "64 48 50 51 31.5 23.5\n", ()),
])
def test_intrinsics_beside_the_images_are_the_camera(tmp_path, name, text, lens):
    images(tmp_path / "rgb", ["1.png", "2.png"])
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_text(text)
    source, _ = views(tmp_path)
    assert (source.camera.fx, source.camera.fy, source.camera.cx, source.camera.cy) == (50.0, 51.0, 31.5, 23.5)
    assert source.camera.distortion == lens
    (tmp_path / name).rename(tmp_path / f"mine{(tmp_path / name).suffix}")
    again, _ = views(tmp_path, camera=str(tmp_path / f"mine{(tmp_path / name).suffix}"))
    assert again.camera.matrix.tolist() == source.camera.matrix.tolist()


@pytest.mark.parametrize(("name", "text", "words"), [
    ("camera.json", "{", "cannot be read as a camera's intrinsics (JSONDecodeError"),
    ("camera.json", '{"focal": 50}', "found focal; expected fx, fy, cx, cy"),
    ("camera.json", '{"fx": -50, "fy": 51, "cx": 1, "cy": 1}', "expected fx, fy above 0"),
    ("intrinsics.txt", "50 51\n", "expected a 3x3 matrix or fx fy cx cy"),
    ("camera_info.yaml", ROS_INFO.replace("plumb_bob", "mei"), "distortion_model is mei"),
    ("camera_info.yaml", ROS_INFO.replace("image_width: 64", "image_width: 640"), "images in"),
    ("camera_info.yaml", "a: [", "cannot be read as a camera's intrinsics"),
    ("cameras.txt", "1 THIN_PRISM_FISHEYE 64 48 50 51 32 24 0 0 0 0 0 0 0 0\n", "the first THIN_PRISM_FISHEYE"),
    ("cameras.txt", "1 PINHOLE 64 48 50 51 32 24\n2 PINHOLE 64 48 50 51 32 24\n", "found 2 cameras"),
])
def test_broken_intrinsics_are_refused_in_one_line(tmp_path, name, text, words):
    images(tmp_path / "rgb", ["1.png", "2.png"])
    (tmp_path / name).write_text(text)
    said = refused(tmp_path)
    assert words in said and "source.camera=" in said


def test_two_files_of_intrinsics_are_a_question(tmp_path):
    images(tmp_path / "rgb", ["1.png", "2.png"])
    for name in ("camera.json", "intrinsics.txt"):
        (tmp_path / name).write_text("50 51 31 23")
    assert "several intrinsics: camera.json, intrinsics.txt; type source.camera=FILE" in refused(tmp_path)


def video(path, count=6, rate_hz=10.0):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate_hz, (64, 48))
    for k in range(count):
        writer.write(np.full((48, 64, 3), 20 * k, np.uint8))
    writer.release()
    return path


def test_a_video_gives_its_views_with_the_stamps_of_the_file(tmp_path):
    source, seen = views(video(tmp_path / "clip.avi"), camera=K, start=1, stride=2)
    assert source.provides == {"image", "gray"} and source.views_expected == len(seen) == 3
    np.testing.assert_allclose([c.stamp_s for c, _ in seen], [0.1, 0.3, 0.5], atol=1e-6)
    np.testing.assert_allclose([c.image.mean() for c, _ in seen], [20, 60, 100], atol=3)
    _, faster = views(tmp_path / "clip.avi", camera=K, rate_hz=100.0)
    np.testing.assert_allclose([c.stamp_s for c, _ in faster], np.arange(6) / 100.0)


def test_what_is_no_video_is_refused_in_one_line(tmp_path):
    (tmp_path / "clip.mp4").write_bytes(b"no video at all" * 100)
    assert "found 1500 bytes that are no video" in refused(tmp_path / "clip.mp4", camera=K)
    assert "holds no camera intrinsics" in refused(video(tmp_path / "good.avi"))


def kitti(folder, count=3, *, tr="0 -1 0 0 0 0 -1 0 1 0 0 -0.25"):
    """sequences/00 with two cameras half a metre apart, a cloud of two points and poses a metre apart."""
    sequence = folder / "sequences" / "00"
    names = [f"{k:06d}.png" for k in range(count)]
    images(sequence / "image_2", names)
    images(sequence / "image_3", names, value=100)
    (sequence / "velodyne").mkdir()
    for k in range(count):
        np.array([[10 + k, 2, 1, 0.5], [np.nan, 0, 0, 0]], "<f4").tofile(sequence / "velodyne" / f"{k:06d}.bin")
    (sequence / "times.txt").write_text("".join(f"{0.1 * k:e}\n" for k in range(count)))
    (sequence / "calib.txt").write_text(f"P0: {P.format(0)}\nP2: {P.format(-25)}\nP3: {P.format(-50)}\nTr: {tr}\n")
    (folder / "poses").mkdir()
    (folder / "poses" / "00.txt").write_text("".join(f"1 0 0 0 0 1 0 0 0 0 1 {k}\n" for k in range(count)))
    return sequence


def test_a_kitti_sequence_gives_images_clouds_and_poses_in_one_body(tmp_path):
    """Camera 2 sits at x = 0.5 of camera 0 (P2 = K [I | t], t_x = -25 / 50): 0.5 m to the right of the body. The Velodyne
    sits 0.25 m behind it: a point 10 m before it is 9.75 m before the body."""
    source, seen = views(kitti(tmp_path), stereo=True)
    np.testing.assert_allclose(source.camera.body_from_camera[:3, 3], [0, -0.5, 0], atol=1e-12)
    assert source.provides == {"image", "gray", "cloud", "right_image", "right_camera"}
    capture, truth = seen[2]
    np.testing.assert_allclose(capture.extras["cloud"], [[11.75, 2.0, 1.0]], atol=1e-6)
    np.testing.assert_allclose(camera_of(capture.extras["right_camera"]).body_from_camera[:3, 3], [0, -1.0, 0], atol=1e-12)
    assert capture.extras["right_image"][0, 0, 0] == 102 and capture.stamp_s == pytest.approx(0.2)
    np.testing.assert_allclose(truth[:3, 3], [0, 0, 2.0], atol=1e-12)  # the world is camera 0's first frame: z ahead


def test_broken_kitti_sequences_are_refused_in_one_line(tmp_path):
    sequence = kitti(tmp_path)
    assert "calib.txt says which camera it is" in refused(sequence, camera=K)
    (sequence / "times.txt").write_text("0.0\n")
    assert "times.txt has 1 lines but the last view is number 2" in refused(sequence)
    (sequence / "times.txt").unlink()
    (sequence / "calib.txt").write_text("P0: 1 2 3\n")
    assert "calib.txt:1: found 4 words" in refused(sequence)
    (sequence / "calib.txt").write_text(f"P2: {P.format(0)}\n")
    assert "velodyne is there but no Tr" in refused(sequence)
    (sequence / "calib.txt").write_text(f"P0: {P.format(0)}\n")
    assert "no P2; found P0" in refused(sequence)
    (tmp_path / "poses" / "00.txt").write_text("1 0 0\n")
    (sequence / "calib.txt").write_text(f"P2: {P.format(0)}\nTr: {P.format(0)}\n")
    assert "not in SO(3)" in refused(sequence)


SENSOR = """# General sensor definitions.
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
resolution: [64, 48]
camera_model: pinhole
intrinsics: [50.0, 51.0, 31.5, 23.5]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""
T0 = 1403636579_000_000_000


def euroc(folder):
    """Three views 50 ms apart, seven IMU readings 20 ms apart, the IMU at (1, 2, 3) unturned."""
    mav0 = folder / "MH_01" / "mav0"
    stamps = [T0 + 50_000_000 * k for k in range(3)]
    for camera, value in (("cam0", 10), ("cam1", 100)):
        images(mav0 / camera / "data", [f"{s}.png" for s in stamps], value=value)
        (mav0 / camera / "data.csv").write_text("#timestamp [ns],filename\n" + "".join(f"{s},{s}.png\n" for s in stamps))
        (mav0 / camera / "sensor.yaml").write_text(SENSOR.replace("0.0, 0.5,", "0.0, 0.6,") if camera == "cam1" else SENSOR)
    (mav0 / "imu0").mkdir()
    lines = [f"{T0 + 20_000_000 * k},{k},0,0,0,0,9.81\n" for k in range(7)]
    (mav0 / "imu0" / "data.csv").write_text("#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n" + "".join(lines))
    (mav0 / "state_groundtruth_estimate0").mkdir()
    lines = [f"{s},1,2,3,1,0,0,0,0,0,0,0,0,0,0,0,0\n" for s in stamps]
    (mav0 / "state_groundtruth_estimate0" / "data.csv").write_text("#timestamp,p,q\n" + "".join(lines))
    return mav0


def test_a_euroc_folder_gives_images_the_imu_between_them_and_the_cameras_true_poses(tmp_path):
    source, seen = views(euroc(tmp_path), stereo=True)
    assert source.camera.distortion == (-0.28, 0.07, 0.0002, 0.00002, 0.0) and source.camera.fy == 51.0
    assert source.provides == {"image", "gray", "imu", "right_image", "right_camera"}
    assert [c.extras["imu"][:, 1].tolist() for c, _ in seen] == [[], [1.0, 2.0], [3.0, 4.0, 5.0]]  # 20, 40; 60, 80, 100 ms
    assert [int(c.extras["right_image"][0, 0, 0]) for c, _ in seen] == [100, 101, 102]
    second = inverse(source.camera.body_from_camera) @ camera_of(seen[0][0].extras["right_camera"]).body_from_camera
    np.testing.assert_allclose(second[:3, 3], [0, -0.1, 0], atol=1e-12)  # the IMU's x is cam0's -y
    np.testing.assert_allclose(seen[1][1][:3, 3], [1.5, 2, 3], atol=1e-12)  # T_BS puts cam0 half a metre along the IMU's x
    assert views(tmp_path / "MH_01")[0].provides == {"image", "gray", "imu"}
    _, every_second = views(tmp_path / "MH_01", stride=2)
    assert every_second[1][0].extras["imu"][:, 1].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize(("name", "there"), [("vicon0", [1.5, 2.0, 2.5]), ("mocap0", [1.5, 2.0, 3.0]), ("leica0", None)])
def test_the_truth_of_markers_is_carried_to_the_camera_and_positions_alone_are_none(tmp_path, name, there, caplog):
    """Vicon's markers half a metre above the IMU, at (1, 2, 3) unturned; the camera half a metre along the IMU's x."""
    mav0 = euroc(tmp_path)
    (mav0 / "state_groundtruth_estimate0").rename(mav0 / name)
    if name == "vicon0":
        (mav0 / name / "sensor.yaml").write_text("T_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.5, 0, 0, 0, 1]\n")
    truth = views(mav0)[1][1][1]
    if there is None:
        assert truth is None and "leica0 has positions without turns" in caplog.text
    else:
        np.testing.assert_allclose(truth[:3, 3], there, atol=1e-12)


def test_a_recording_two_folders_down_is_named_and_depth_is_not_taken_for_one(tmp_path):
    sequence = kitti(tmp_path / "dataset")
    assert f"type source.path={sequence}" in refused(tmp_path / "dataset")
    images(tmp_path / "other" / "depth_left", ["1.png", "2.png"])
    assert "found depth_left" in refused(tmp_path / "other")


@pytest.mark.parametrize(("file", "text", "words"), [
    ("cam0/data.csv", "#timestamp\n", "the list is empty"),
    ("cam0/data.csv", f"{T0},../../../x.png\n", "leads out of the recording"),
    ("cam0/data.csv", "now,a.png\n", "cam0/data.csv:1: found 'now' where a number"),
    ("cam0/sensor.yaml", SENSOR.replace("radial-tangential", "mei"), "distortion_model is mei"),
    ("cam0/sensor.yaml", SENSOR.replace("intrinsics:", "nothing:"), "expected intrinsics [fu, fv, cu, cv]"),
    ("cam0/sensor.yaml", SENSOR.replace("T_BS", "T"), "no T_BS with 16 numbers"),
    ("cam0/sensor.yaml", SENSOR.replace("[0.0, -1.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]",
                                        "[0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0.5, 0, 0, 1]"),
     "T_BS: the last row of the pose is 0.5 0 0 1; expected 0 0 0 1 (a matrix column by column?)"),
    ("imu0/data.csv", f"{T0},1,2\n", "imu0/data.csv:1: found 3 columns"),
    ("state_groundtruth_estimate0/data.csv", f"{T0},1,2,3,0,0,0,0\n", "data.csv:1:"),
])
def test_broken_euroc_folders_are_refused_in_one_line(tmp_path, file, text, words):
    mav0 = euroc(tmp_path)
    (mav0 / file).write_text(text)
    assert words in refused(mav0)


def test_what_a_format_has_no_use_for_is_refused(tmp_path):
    images(tmp_path / "rgb", ["1.png", "2.png"])
    assert "of a recording of the kind frames no second camera is read" in refused(tmp_path, camera=K, stereo=True)
    assert "source.rate_hz: a recording of the kind euroc" in refused(euroc(tmp_path / "e"), rate_hz=5.0)
    sequence = kitti(tmp_path / "k")
    for k in range(3):
        (sequence / "image_3" / f"{k:06d}.png").unlink()
    (sequence / "image_3").rmdir()
    assert "holds no image_3" in refused(sequence, stereo=True)
