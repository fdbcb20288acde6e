"""Recordings of phones and viewers as people have them: Stray Scanner, Polycam, Nerfstudio, RealSense's viewer, SensReader,
RGB-D Scenes, TUM VI, 4Seasons."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from bags import F, picture
from helpers.replayed import refused, views

from rhs.base.commands import LONGEST

DEEP = np.full((48, 64), 2000, np.uint16)
MATRIX = "50, 0, 31.5\n0, 50, 23.5\n0, 0, 1\n"


def put(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def pairs(folder, color, depth, deep=DEEP):
    for k in range(3):
        put(folder / color.format(k), picture(k))
        put(folder / depth.format(k), deep)


def test_a_video_beside_depth_says_how_to_unpack_it_and_is_read_then(tmp_path):
    """Stray Scanner: never the folder of confidence, which holds images too."""
    for k in range(3):
        put(tmp_path / f"depth/{k:06d}.png", DEEP)
        put(tmp_path / f"confidence/{k:06d}.png", np.full((48, 64), 2, np.uint8))
    (tmp_path / "rgb.mp4").write_bytes(b"\0" * 100)
    (tmp_path / "camera_matrix.csv").write_text(MATRIX)
    way = "".join(f"{100 + k / 60}, {k:06d}, {k}, 0, 0, 0, 0, 0, 1\n" for k in range(3))
    (tmp_path / "odometry.csv").write_text("timestamp, frame, x, y, z, qx, qy, qz, qw\n" + way)
    text = refused(tmp_path)
    assert "mkdir rgb; ffmpeg -i rgb.mp4 -vsync 0 -start_number 0 rgb/%06d.png" in text
    assert len("source.path=.../recording: ") + text.index("%06d.png") - text.index("found") < LONGEST - 30
    pairs(tmp_path, "rgb/{:06d}.png", "depth/{:06d}.png")
    source, seen = views(tmp_path, truth=str(tmp_path / "odometry.csv"))
    assert source.camera.fx == F and [truth[0, 3] for _, truth in seen] == pytest.approx([0.0, 1.0, 2.0])


@pytest.mark.parametrize("file", ["cameras/1700000000000000.json", "transforms.json"])
def test_the_camera_is_in_a_file_of_each_view_or_in_one_of_all_poses(tmp_path, file):
    numbers = {"fx": F, "fy": F, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48, "t_00": 1.0}
    if file == "transforms.json":
        numbers = {"camera_model": "OPENCV", "fl_x": F, "fl_y": F, "cx": 32, "cy": 24, "w": 64, "h": 48, "frames": []}
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text(json.dumps(numbers))
    pairs(tmp_path, "images/170000000{}000000.png", "depth/170000000{}000000.png")
    source, seen = views(tmp_path)
    assert (source.camera.fx, source.camera.cx) == (F, 31.5) and len(seen) == 3


def test_a_fisheye_that_sees_too_far_aside_beside_depth_is_refused(tmp_path):
    told = {"camera_model": "OPENCV_FISHEYE", "fl_x": 25.0, "fl_y": 25.0, "cx": 31.5, "cy": 23.5, "k1": 0.0}
    (tmp_path / "transforms.json").write_text(json.dumps(told))
    pairs(tmp_path, "images/{}.png", "depth/{}.png")
    assert "found a lens that sees too far aside beside depth; undistort both alike" in refused(tmp_path)


@pytest.mark.parametrize(("color", "depth"), [
    ("rs_Color_130503122952{}.748046875.png", "rs_Depth_130503122952{}.748046875.png"),  # milliseconds
    ("{:05d}-color.png", "{:05d}-depth.png"), ("frame-{:06d}.color.jpg", "frame-{:06d}.depth.pgm"),
])
def test_colour_and_depth_of_one_folder_go_together_by_their_names(tmp_path, color, depth):
    pairs(tmp_path, color, depth)
    _, seen = views(tmp_path, camera=[F, F, 31.5, 23.5])
    assert len(seen) == 3 and seen[0][0].depth[0, 0] == pytest.approx(2.0)
    step_s = seen[1][0].stamp_s - seen[0][0].stamp_s
    assert step_s == pytest.approx(0.001 if "Color" in color else 1 / 30, abs=1e-6)


def test_two_cameras_in_one_folder_say_what_to_do(tmp_path):
    pairs(tmp_path, "left{:06d}.png", "right{:06d}.png")
    assert "two of one number" in refused(tmp_path) and "move the others" in refused(tmp_path)


def test_of_two_folders_the_one_whose_lens_was_undone_is_named(tmp_path):
    pairs(tmp_path, "distorted_images/cam0/{}.png", "undistorted_images/cam0/{}.png")
    assert f"type source.path={tmp_path}/undistorted_images/cam0" in refused(tmp_path)


def test_the_lens_of_tum_vi_is_named(tmp_path, caplog):
    put(tmp_path / "mav0/cam0/data/1500000000000000000.png", picture()[:, :, 0])
    (tmp_path / "mav0/cam0/data.csv").write_text("#timestamp [ns],filename\n1500000000000000000,1500000000000000000.png\n")
    (tmp_path / "dso").mkdir()
    (tmp_path / "dso/camchain.yaml").write_text(
        "cam0:\n  camera_model: pinhole\n  distortion_model: equidistant\n"
        "  distortion_coeffs: [0.0034, 0.0007, -0.002, 0.0002]\n  intrinsics: [24.0, 24.0, 31.5, 23.5]\n"
        "  resolution: [64, 48]\n")
    assert len(views(tmp_path)[1]) == 1 and "lens (equidistant) sees further aside" in caplog.text
    assert len(views(tmp_path, camera=[F, F, 31.5, 23.5])[1]) == 1
