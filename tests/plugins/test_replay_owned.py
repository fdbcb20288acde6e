"""Recordings as people own them: several cameras in a bag, packed bags, other lenses, data sets as they are unpacked."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from bags import HEIGHT, KINDS, WIDTH, BagFile, picture
from helpers.replayed import views

from rhs.api.errors import ConfigError

K = [50.0, 50.0, 31.5, 23.5]


def two_cameras(folder, kind):
    """Depth of 2 m before the left camera, of 3 m before the right one."""
    with BagFile(folder, kind) as bag:
        for k in range(3):
            for side, metres in (("left", 2.0), ("right", 3.0)):
                bag.camera_info(f"/{side}/color/camera_info", 1.0 + 0.1 * k)
                bag.image(f"/{side}/color/image_raw", 1.0 + 0.1 * k, picture(k), "rgb8", side)
                bag.image(f"/{side}/depth/image_raw", 1.0 + 0.1 * k, np.full((HEIGHT, WIDTH), metres, np.float32), "32FC1",
                          side)
            bag.odometry("/odom", 1.0 + 0.1 * k, 0.1 * k, 0.0, 0.0)
    return bag.path


@pytest.mark.parametrize("kind", KINDS)
def test_of_several_cameras_the_depth_beside_the_chosen_colour_is_taken(tmp_path, kind):
    path = two_cameras(tmp_path, kind)
    with pytest.raises(ConfigError, match=r"several color topics; type source\.color_topic=NAME of /left/color"):
        views(path)
    _, seen = views(path, color_topic="/right/color/image_raw")
    assert [float(np.median(capture.depth)) for capture, _ in seen] == [3.0] * 3


@pytest.mark.parametrize("name", ["color", "depth", "info", "scan", "wheel"])
def test_a_topic_that_holds_something_else_is_refused_with_what_there_is(tmp_path, name):
    path = two_cameras(tmp_path, "ros2_mcap")
    wrong = "/odom" if name != "wheel" else "/left/color/image_raw"
    typed = {"color_topic": "/left/color/image_raw"} | {f"{name}_topic": wrong}
    said = rf"{wrong} holds \w+; found /.*; expected source\.{name}_topic=NAME of "
    with pytest.raises(ConfigError, match=said) as caught:
        views(path, **typed)
    assert "\n" not in str(caught.value)
    with pytest.raises(ConfigError, match=r"no topic /right/color; did you mean /right/color/\w+\?"):
        views(path, color_topic="/right/color")


def test_a_packed_file_and_a_lost_part_of_a_bag_are_told_apart_from_broken_ones(tmp_path):
    folder = two_cameras(tmp_path, "ros2_mcap")
    (folder / "bag.mcap").rename(folder / "bag.mcap.zstd")
    with pytest.raises(ConfigError, match=rf"found a packed file; type source\.path={folder}"):
        views(folder / "bag.mcap.zstd")
    with pytest.raises(ConfigError, match=r"files are missing.*bag\.mcap.*; put them back, or type: ros2 bag reindex "):
        views(folder)
    (folder / "metadata.yaml").unlink()
    with pytest.raises(ConfigError, match=r"found a packed file; type zstd -d bag\.mcap\.zstd"):
        views(folder / "bag.mcap.zstd")


def put(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def test_a_list_of_colour_images_alone_is_one_camera(tmp_path):
    lines = ""
    for k in range(3):
        put(tmp_path / f"rgb/{k}.png", picture(k))
        lines += f"{1.7e9 + 0.1 * k:.6f} rgb/{k}.png\n"
    (tmp_path / "rgb.txt").write_text(lines)
    (tmp_path / "calibration.txt").write_text("50 51 31.5 23.5\n")  # as ETH3D writes it
    source, seen = views(tmp_path)
    assert source.provides == {"image", "gray"} and source.camera.fy == 51.0
    assert [round(capture.stamp_s - 1.7e9, 3) for capture, _ in seen] == [0.0, 0.1, 0.2]
    with pytest.raises(ConfigError, match="holds no list of depth images; leave it out"):
        views(tmp_path, depth_camera=[50.0, 50.0, 31.5, 23.5])
    (tmp_path / "depth").mkdir()
    with pytest.raises(ConfigError, match=r"depth\.txt is not; type source\.depth_topic=none"):
        views(tmp_path)
    assert len(views(tmp_path, depth_topic="none")[1]) == 3


@pytest.mark.parametrize("name", ["associations.txt", "associated.txt", "association.txt", "rgbd_assoc.txt"])
def test_a_list_of_pairs_is_known_by_whatever_it_is_called(tmp_path, name):
    put(tmp_path / "rgb/1.png", picture())
    put(tmp_path / "depth/1.png", np.full((HEIGHT, WIDTH), 10_000, np.uint16))
    (tmp_path / name).write_text("1.5 rgb/1.png 1.5 depth/1.png\n")
    _, seen = views(tmp_path, camera=K)
    assert float(np.median(seen[0][0].depth)) == 2.0  # 5000 a metre, as such lists are TUM's


@pytest.mark.parametrize("pattern", ["rggb", "gbrg"])
def test_the_mosaic_of_a_bayer_filter_is_smoothed_into_grey(tmp_path, caplog, pattern):
    """Red 200, green 100, blue 40 everywhere: grey is a quarter, a half and a quarter of them, whatever the pattern."""
    values = {"r": 200, "g": 100, "b": 40}
    tile = np.array([values[letter] for letter in pattern], np.uint8).reshape(2, 2)
    put(tmp_path / "rgb/1400505894395159.png", np.tile(tile, (HEIGHT // 2, WIDTH // 2)))
    _, seen = views(tmp_path, camera=K)
    assert np.unique(seen[0][0].image).tolist() == [110] and "raw mosaic of a Bayer filter" in caplog.text
    caplog.clear()
    noise = np.clip(128 + 20 * np.random.default_rng(0).standard_normal((HEIGHT, WIDTH)), 0, 255)
    put(tmp_path / "rgb/1400505894395159.png", noise.astype(np.uint8))
    views(tmp_path, camera=K)
    assert not caplog.text


CHAIN = ("cam0:\n  camera_model: pinhole\n  distortion_model: {}\n  distortion_coeffs: {}\n  intrinsics: {}\n"
         "  resolution: [64, 48]\n")
FISHEYE = [-0.01, 0.02, -0.03, 0.01]


@pytest.mark.parametrize(("name", "text"), [
    ("camchain.yaml", CHAIN.format("equidistant", FISHEYE, K)),
    ("camera.json", json.dumps({"camera_model": "OPENCV_FISHEYE", "fl_x": 50, "fl_y": 50, "cx": 32, "cy": 24}
                               | {f"k{i}": k for i, k in enumerate(FISHEYE, 1)})),
    ("camera.txt", f"KannalaBrandt 50 50 31.5 23.5 {' '.join(map(str, FISHEYE))}\n64 48\ncrop\n64 48\n"),
    ("camera.yaml", "%YAML:1.0\nCamera.type: \"KannalaBrandt8\"\nCamera1.fx: 50\nCamera1.fy: 50\nCamera1.cx: 31.5\n"
                    "Camera1.cy: 23.5\n" + "".join(f"Camera1.k{i}: {k}\n" for i, k in enumerate(FISHEYE, 1))),
])
def test_a_fisheye_is_undone_as_its_model_says(tmp_path, name, text):
    """A ray 30 degrees off the axis is seen at 50 theta (1 + k1 theta^2 + ...) pixels from the middle."""
    put(tmp_path / "rgb/1.png", picture())
    (tmp_path / name).write_text(text)
    camera = views(tmp_path)[0].camera
    theta = np.radians(30.0)
    away = 50.0 * theta * (1.0 + sum(k * theta ** (2 * i) for i, k in enumerate(FISHEYE, 1)))
    assert camera.rays(np.array([[31.5 + away, 23.5]]))[0] == pytest.approx([np.tan(theta), 0.0, 1.0], abs=1e-5)


@pytest.mark.parametrize("text", ["0.78125 1.0416667 0.5 0.5 0.9\n64 48\ncrop\n64 48\n",
                                  "FOV 50 50 31.5 23.5 0.9\n64 48\nfull\n64 48\n"])
def test_the_fov_lens_of_dso_is_undone(tmp_path, text):
    """Devernay and Faugeras: a point of the plane z = 1 at the radius 0.6 is seen at atan(2 * 0.6 tan(w / 2)) / w."""
    put(tmp_path / "images/00001.png", picture())
    (tmp_path / "camera.txt").write_text(text)
    camera = views(tmp_path)[0].camera
    away = 50.0 * np.arctan(1.2 * np.tan(0.45)) / 0.9
    assert camera.rays(np.array([[31.5, 23.5 - away]]))[0] == pytest.approx([0.0, -0.6, 1.0], abs=1e-5)


@pytest.mark.parametrize("text", [
    "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [50, 0, 31.5, 0, 51, 23.5, 0, 0, 1]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [0.1, 0, 0, 0.02, 0]\n",
    "%YAML:1.0\nCamera.fx: 50\nCamera.fy: 51\nCamera.cx: 31.5\nCamera.cy: 23.5\nCamera.k1: 0.1\nCamera.p2: 0.02\n",
    "%YAML:1.0\nmodel_type: PINHOLE\nimage_width: 64\nimage_height: 48\ndistortion_parameters:\n   k1: 0.1\n   k2: 0.0\n"
    "   p1: 0.0\n   p2: 0.02\nprojection_parameters:\n   fx: 50\n   fy: 51\n   cx: 31.5\n   cy: 23.5\n",
    CHAIN.format("radtan", [0.1, 0.0, 0.0, 0.02], [50, 51, 31.5, 23.5]),
])
def test_calibrations_of_opencv_orb_slam_vins_and_kalibr_are_read(tmp_path, text):
    put(tmp_path / "rgb/1.png", picture())
    (tmp_path / "mine.yaml").write_text(text)
    camera = views(tmp_path, camera=str(tmp_path / "mine.yaml"))[0].camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (50.0, 51.0, 31.5, 23.5)
    assert camera.distortion == (0.1, 0.0, 0.0, 0.02, 0.0)


def test_a_folder_of_euroc_with_its_second_camera_alone_is_read_by_kalibrs_chain(tmp_path):
    stamp = 1403636579763555584
    put(tmp_path / f"mav0/cam1/data/{stamp}.png", picture()[:, :, 0])
    (tmp_path / "mav0/cam1/data.csv").write_text(f"#timestamp [ns],filename\r\n{stamp},{stamp}.png\r\n")
    (tmp_path / "mav0/mocap0").mkdir()
    (tmp_path / "mav0/mocap0/data.csv").write_text(f"#timestamp [ns], p, q\n{stamp},1,2,3,1,0,0,0\n")
    with pytest.raises(ConfigError, match="holds no camera intrinsics"):
        views(tmp_path)
    assert views(tmp_path, camera=K)[1][0][1] is None  # nobody says where the camera sits
    inside = CHAIN.format("radtan", [0.0] * 4, K).replace("cam0", "cam1")
    place = "  T_cam_imu: [[1, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
    (tmp_path / "camchain.yaml").write_text(inside + place)
    source, seen = views(tmp_path)
    assert source.camera.fx == 50.0
    assert (seen[0][1] @ source.camera.body_from_camera)[:3, 3] == pytest.approx([1.5, 2.0, 3.0])
    with pytest.raises(ConfigError, match="holds no cam0; leave it out"):
        views(tmp_path, stereo=True)


@pytest.mark.parametrize(("name", "text", "words"), [
    ("graph.g2o", "VERTEX_SE2 0 0 0 0\n", "found a graph of poses .* give the log that it was made of"),
    ("toro.log", "VERTEX2 0 0 0 0\nEDGE2 0 1 1 0 0 1 0 1 1 0 0\n", "found EDGE2, VERTEX2; .* give the log that it was "),
    ("rear.log", "# CARMEN\nROBOTLASER2 0 -1.57 3.14 0.017 81.9 0.01 0 0\n", r"write ROBOTLASER1 for it \(sed"),
])
def test_a_log_without_its_scans_says_what_it_holds(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=words) as caught:
        views(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_virtual_kitti_is_in_centimetres_and_its_cameras_from_the_world(tmp_path):
    for k in range(2):
        put(tmp_path / f"frames/rgb/Camera_0/rgb_{k:05d}.jpg", picture(k))
        put(tmp_path / f"frames/depth/Camera_0/depth_{k:05d}.png", np.full((HEIGHT, WIDTH), 300, np.uint16))
    (tmp_path / "intrinsic.txt").write_text("frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n0 0 50 51 31.5 23.5\n0 1 9 9 9 9\n")
    (tmp_path / "extrinsic.txt").write_text("frame cameraID r1,1 ...\n" + "".join(
        f"{k} 0 1 0 0 {-k} 0 1 0 -2 0 0 1 -3 0 0 0 1\n{k} 1 1 0 0 9 0 1 0 9 0 0 1 9 0 0 0 1\n" for k in range(2)))
    for path in (tmp_path, tmp_path / "frames"):
        source, seen = views(path)
        assert source.camera.fy == 51.0 and float(np.median(seen[1][0].depth)) == 3.0
        assert (seen[1][1] @ source.camera.body_from_camera)[:3, 3].tolist() == [1.0, 2.0, 3.0]
