"""The folders of well-known data sets, as they are unpacked: their pictures, cameras, scales of depth and true poses."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse
from rhs_sources.replay_config import Replay

SIZE = (64, 48)
AWAY = [np.array([[0, -1, 0, k], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], float) for k in range(3)]  # world_from_camera


def views(path, **settings):
    source = Replay(path=str(path), **settings).build(None)
    seen = []
    while (capture := source.lead()) is not None:
        truth = source.truth()
        seen.append((capture, None if truth is None else truth @ source.camera.body_from_camera))
    source.close()
    return source, seen


def pictures(folder, color, depth, *, scale, size=SIZE):
    """Three views: colour 10, 11, 12, of that size, and depth of 2 m."""
    for k in range(3):
        for name, image in ((color, np.full((size[1], size[0], 3), 10 + k, np.uint8)),
                            (depth, np.full((SIZE[1], SIZE[0]), 2 * scale, np.uint16))):
            path = folder / name.format(k)
            path.parent.mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(path), image)


def lines(rows):
    return "".join(" ".join(map(str, np.ravel(row))) + "\n" for row in rows)


def replica(folder):
    room = folder / "room0"
    pictures(room, "results/frame{:06d}.jpg", "results/depth{:06d}.png", scale=6553)
    (room / "traj.txt").write_text(lines(AWAY))
    (folder / "cam_params.json").write_text(json.dumps({"camera": {
        "w": 64, "h": 48, "fx": 50.0, "fy": 51.0, "cx": 31.5, "cy": 23.5, "scale": 6553.0}}))
    return room


def matrices(folder):
    folder.mkdir()
    for k, pose in enumerate(AWAY):
        (folder / f"{k}.txt").write_text(lines(pose))


def scannet(folder):
    pictures(folder, "color/{}.jpg", "depth/{}.png", scale=1000, size=(129, 96))
    matrices(folder / "pose")
    (folder / "intrinsic").mkdir()
    camera = [[50.0 * 129 / 64, 0, 32 * 129 / 64 - 0.5, 0], [0, 102.0, 24 * 2 - 0.5, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    (folder / "intrinsic" / "intrinsic_color.txt").write_text(lines(camera))
    return folder


def redwood(folder):
    pictures(folder, "color/{:05d}.jpg", "depth/{:05d}.png", scale=1000)
    (folder / "trajectory.log").write_text("".join(f"{k} {k} {k + 1}\n" + lines(pose) for k, pose in enumerate(AWAY)))
    (folder / "camera_intrinsic.json").write_text(json.dumps({
        "width": 64, "height": 48, "intrinsic_matrix": [50.0, 0, 0, 0, 51.0, 0, 31.5, 23.5, 1]}))
    return folder


def bundle_fusion(folder):
    pictures(folder, "frame-{:06d}.color.jpg", "frame-{:06d}.depth.png", scale=1000)
    for k, pose in enumerate(AWAY):
        (folder / f"frame-{k:06d}.pose.txt").write_text(lines(pose))
    (folder / "info.txt").write_text("m_versionNumber = 4\nm_colorWidth = 64\nm_colorHeight = 48\n"
                                     "m_calibrationColorIntrinsic = 50 0 31.5 0 0 51 23.5 0 0 0 1 0 0 0 0 1 \n")
    return folder


def listed(folder, *, color="rgb", depth="depth", scale=5000):
    """TUM's lists and true poses, with the intrinsics of ETH3D."""
    pictures(folder, color + "/{}.png", depth + "/{}.png", scale=scale)
    for name in (color, depth):
        (folder / f"{name}.txt").write_text("".join(f"{10 + k}.0 {name}/{k}.png\n" for k in range(3)))
    (folder / "groundtruth.txt").write_text("".join(f"{10 + k}.0 {k} 2 3 0 0 {0.5**0.5} {0.5**0.5}\n" for k in range(3)))
    (folder / "calibration.txt").write_text("50 51 31.5 23.5\n")
    return folder


def openloris(folder):
    return listed(folder, color="color", depth="aligned_depth", scale=1000)


@pytest.mark.parametrize("made", [replica, scannet, redwood, bundle_fusion, listed, openloris])
def test_a_data_set_is_read_as_it_is_unpacked(tmp_path, made):
    source, seen = views(made(tmp_path))
    camera = source.camera
    assert (camera.width, camera.height) == SIZE and camera.distortion == ()
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], [50.0, 51.0, 31.5, 23.5], atol=1e-9)
    assert [int(capture.image[20, 30].mean()) for capture, _ in seen] == [10, 11, 12]
    for capture, _ in seen:
        np.testing.assert_allclose(capture.depth, 2.0, atol=1e-3)
        assert capture.image.shape == (48, 64, 3)
    for k, (_, truth) in enumerate(seen):
        np.testing.assert_allclose(inverse(seen[0][1]) @ truth, inverse(AWAY[0]) @ AWAY[k], atol=1e-9)


def test_a_pose_that_was_not_found_is_unknown_and_a_damaged_one_refused(tmp_path):
    folder = scannet(tmp_path)
    (folder / "pose" / "1.txt").write_text("-inf " * 16)
    _, seen = views(folder)
    assert [truth is None for _, truth in seen] == [False, True, False]
    (folder / "pose" / "1.txt").write_text("1 0 0")
    with pytest.raises(ConfigError, match=r"1.txt: found 3 numbers; expected a 3x4 or 4x4 pose"):
        views(folder)


def test_depth_of_another_shape_than_colour_is_refused(tmp_path):
    pictures(tmp_path, "color/{}.jpg", "depth/{}.png", scale=1000, size=(128, 80))
    with pytest.raises(ConfigError, match="colour is 128x80 but depth is 64x48"):
        views(tmp_path, camera=[50.0, 50.0, 31.5, 23.5])
