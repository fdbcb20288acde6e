"""Data sets that are downloaded as they are: Stray Scanner, Nerfstudio, COLMAP, SUN3D; their cameras and true poses."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rhs.api.errors import ConfigError
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

WIDTH, HEIGHT = 64, 48
CAMERA = [50.0, 50.0, 31.5, 23.5]
TURN = Rotation.from_euler("xyz", [0.1, -0.2, 0.3])
POSES = [np.vstack([np.column_stack([TURN.as_matrix(), [0.1 * k, 0.2, 0.3]]), [0, 0, 0, 1.0]]) for k in range(3)]


def views(path, **settings):
    recording = open_recording(Replay(path=str(path), **settings))
    return recording, list(recording.views)


def frames(folder, first=0, *, depth_m=2.0, steps=1000.0, name="{:06d}.png"):
    for place, pixels in (("rgb", np.full((HEIGHT, WIDTH, 3), 90, np.uint8)),
                          ("depth", np.full((HEIGHT, WIDTH), round(depth_m * steps), np.uint16))):
        (folder / place).mkdir(parents=True, exist_ok=True)
        for k in range(first, first + 3):
            cv2.imwrite(str(folder / place / name.format(k)), pixels)
    return folder


def agree(seen):
    """The true poses, of bodies that look along x, are those of the cameras."""
    body_from_camera = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    for (_, pose), wanted in zip(seen, POSES, strict=True):
        np.testing.assert_allclose(pose @ body_from_camera, wanted, atol=1e-6)


def stray(folder, *, more="", values=""):
    """odometry.csv begins a frame before the images do, as an unpacked video may."""
    lines = [f"timestamp, frame, x, y, z, qx, qy, qz, qw{more}", f"9.9, 000006, 9, 9, 9, 0, 0, 0, 1{values}"]
    for k, pose in enumerate(POSES):
        numbers = (*pose[:3, 3], *TURN.as_quat())
        lines.append(f"{10 + k / 60}, {k + 7:06d}, {', '.join(map(str, numbers))}{values}")
    (folder / "odometry.csv").write_text("\n".join(lines) + "\n")
    (folder / "camera_matrix.csv").write_text("50.0, 0.0, 31.5\n0.0, 50.0, 23.5\n0.0, 0.0, 1.0\n")


@pytest.mark.parametrize(("more", "values"), [("", ""), (", fx, fy, cx, cy", ", 50, 50, 31.5, 23.5")])
def test_stray_scanner_has_its_poses_by_the_number_of_the_frame(tmp_path, more, values):
    stray(frames(tmp_path, first=7), more=more, values=values)
    agree(views(tmp_path)[1])


def test_a_broken_odometry_of_stray_scanner_is_refused_in_one_line(tmp_path):
    stray(frames(tmp_path, first=7))
    with (tmp_path / "odometry.csv").open("a") as file:
        file.write("10.2, 000010, 1, 2\n")
    with pytest.raises(ConfigError, match=r"odometry\.csv:6: found 4 columns; expected 9: timestamp frame x y z"):
        views(tmp_path)


def test_the_pixels_of_nerfstudio_begin_at_their_corner(tmp_path):
    """COLMAP's principal point of 64x48 pixels is (32, 24): the middle, where that of the first pixel is (0.5, 0.5)."""
    frames(tmp_path)
    opengl = [{"file_path": f"rgb/{k:06d}.png", "transform_matrix": (pose @ np.diag([1, -1, -1, 1])).tolist()}
              for k, pose in enumerate(POSES)]
    (tmp_path / "transforms.json").write_text(json.dumps(
        {"fl_x": 50.0, "fl_y": 50.0, "cx": 32.0, "cy": 24.0, "w": 64, "h": 48, "camera_model": "OPENCV", "frames": opengl}))
    recording, seen = views(tmp_path, truth=str(tmp_path / "transforms.json"))
    assert (recording.camera.cx, recording.camera.cy) == (31.5, 23.5)
    agree(seen)


def colmap(names):
    """The world in the camera, w first, in no order, a line of points behind each."""
    lines = ["#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"]
    for k in (1, 2, 0):
        inside = np.linalg.inv(POSES[k])
        x, y, z, w = Rotation.from_matrix(inside[:3, :3]).as_quat()
        lines += [" ".join(map(str, (9 - k, w, x, y, z, *inside[:3, 3], 1, names[k]))), "10.5 20.5 -1 30.5 40.5 17"]
    return "\n".join(lines) + "\n"


def test_colmaps_images_are_true_poses_by_the_numbers_in_their_names(tmp_path):
    frames(tmp_path, first=4)
    (tmp_path / "images.txt").write_text(colmap(["000004.png", "000005.png", "000006.png"]))
    agree(views(tmp_path, camera=CAMERA, truth=str(tmp_path / "images.txt"))[1])
    (tmp_path / "images.txt").write_text(colmap(["front.png", "left.png", "right.png"]))
    with pytest.raises(ConfigError, match="no image of COLMAP with a number in its name; expected IMAGE_ID QW") as caught:
        views(tmp_path, camera=CAMERA, truth=str(tmp_path / "images.txt"))
    assert "\n" not in str(caught.value)


def test_sun3d_has_its_newest_poses_in_three_lines_each(tmp_path):
    frames(tmp_path, steps=8000.0, name="{:07d}-000000366666.png")
    (tmp_path / "extrinsics").mkdir()
    (tmp_path / "extrinsics/20130101000000.txt").write_text("1 0 0 9\n0 1 0 9\n0 0 1 9\n" * 3)
    text = "\n".join(" ".join(map(str, row)) for pose in POSES for row in pose[:3])
    (tmp_path / "extrinsics/20140512130736.txt").write_text(text + "\n")
    for k in range(3):  # a time each
        for place in ("rgb", "depth"):
            old = tmp_path / place / f"{k:07d}-000000366666.png"
            old.rename(old.with_name(f"{k:07d}-{33333 * k:012d}.png"))
    _, seen = views(tmp_path, camera=CAMERA, depth_scale=8000.0)
    agree(seen)
    assert float(np.median(seen[0][0].depth)) == 2.0
    (tmp_path / "extrinsics/20140512130736.txt").write_text(text + "\n1 2 3\n")
    with pytest.raises(ConfigError, match=r"20140512130736\.txt:1: found 4 columns"):
        views(tmp_path, camera=CAMERA, depth_scale=8000.0)


def test_the_shifted_bits_of_sun3d_are_said_also_where_a_view_is_flat(tmp_path, caplog):
    frames(tmp_path)
    steps = np.arange(WIDTH, dtype=np.uint16)[None, :].repeat(HEIGHT, 0)
    cv2.imwrite(str(tmp_path / "depth/000000.png"), np.full((HEIGHT, WIDTH), 16000, np.uint16))
    for k in (1, 2):
        cv2.imwrite(str(tmp_path / f"depth/{k:06d}.png"), 16000 + 8 * steps)
    views(tmp_path, camera=CAMERA)
    assert "whole times 8: of SUN3D, whose bits are shifted? type source.depth_scale=8000" in caplog.text


def test_what_to_type_for_a_folder_above_is_the_end_of_the_line(tmp_path):
    frames(tmp_path / "keyframes")
    with pytest.raises(ConfigError, match=rf"; type source\.path={tmp_path}/keyframes$"):
        views(tmp_path)
