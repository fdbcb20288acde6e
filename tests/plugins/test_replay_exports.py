"""Folders as renderers, scanners and data sets export them: distances along rays, scales in info.txt, poses by number."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

WIDTH, HEIGHT, F = 64, 48, 50.0
CAMERA = [F, F, 31.5, 23.5]
POSE = np.eye(4)


def views(path, **settings):
    return list(open_recording(Replay(path=str(path), **settings)).views)


def image(path, pixels=None):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 90, np.uint8) if pixels is None else pixels)


def pose_words(k):
    return " ".join(f"{v:g}" for v in (POSE + np.outer([k, 0, 0, 0], [0, 0, 0, 1]))[:3].ravel())


@pytest.fixture
def rendered(tmp_path):
    """A wall 2 m ahead as ICL-NUIM has it, by distances along the rays. The camera rises and looks up."""
    u, v = np.meshgrid(np.arange(WIDTH) - CAMERA[2], np.arange(HEIGHT) - CAMERA[3])
    along = 2.0 * np.sqrt((u / F) ** 2 + (v / F) ** 2 + 1.0)
    for k in range(2):
        image(tmp_path / f"scene_00_{k:04d}.png")
        (tmp_path / f"scene_00_{k:04d}.depth").write_text(" ".join(f"{d:.6f}" for d in along.ravel()) + " \n")
        (tmp_path / f"scene_00_{k:04d}.txt").write_text(
            f"cam_pos      = [0, {k}, -2]';\ncam_dir      = [0, {0.6 * k}, {1 - 0.2 * k}]';\n"
            f"cam_up       = [0, {1 - 0.2 * k}, {-0.6 * k}]';\ncam_right    = [1.33, 0, 0]';\ncam_angle    = 90;\n")
    return tmp_path


def test_distances_along_the_rays_become_depth_ahead_and_y_points_down(rendered):
    (first, begin), (_, end) = views(rendered, camera=CAMERA)
    np.testing.assert_allclose(first.depth, 2.0, atol=1e-5)
    np.testing.assert_allclose(begin[:3, 3], [0.0, 0.0, -2.0])
    np.testing.assert_allclose(end[:3, 3], [0.0, -1.0, -2.0])  # up is against y
    np.testing.assert_allclose(end[:3, 0], [0.0, -0.6, 0.8], atol=1e-9)  # as is what it looks along, x of a body
    assert np.linalg.det(end[:3, :3]) == pytest.approx(1.0)


def test_distances_in_centimetres_take_a_scale_and_broken_ones_are_refused(rendered):
    (first, _), (_, end) = views(rendered, camera=CAMERA, depth_scale=2.0)
    assert float(first.depth[0, 0]) == pytest.approx(1.0) and end[1, 3] == pytest.approx(-0.5)
    (rendered / "scene_00_0000.depth").write_text("1 2 3")
    with pytest.raises(ConfigError, match=r"scene_00_0000\.depth: found 3 numbers; expected 64x48") as caught:
        views(rendered, camera=CAMERA)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("scale", "metres"), [(1000, 2.0), (5000, 0.4)])
@pytest.mark.parametrize("names", ["frame-{:06d}.{}", "{1}/{0}"])
def test_a_scanners_info_says_what_a_step_of_depth_is(tmp_path, scale, metres, names):
    for k in range(2):
        image(tmp_path / (names.format(k, "color") + ".png"))
        image(tmp_path / (names.format(k, "depth") + ".png"), np.full((HEIGHT, WIDTH), 2000, np.uint16))
    (tmp_path / "info.txt").write_text(
        f"m_versionNumber = 4\nm_colorWidth = 64\nm_colorHeight = 48\nm_depthShift = {scale}\n"
        "m_calibrationColorIntrinsic = 50 0 31.5 0 0 50 23.5 0 0 0 1 0 0 0 0 1 \n")
    assert float(views(tmp_path)[0][0].depth[0, 0]) == pytest.approx(metres)
    assert float(views(tmp_path, depth_scale=500.0)[0][0].depth[0, 0]) == pytest.approx(4.0)  # what is typed wins


def test_depth_of_another_size_is_carried_to_colour_by_the_numbers_of_a_scanners_info(tmp_path):
    """3RScan, ScanNet's SensReader: it was refused. Half as many pixels of the same angle: a wall stays a wall."""
    for k in range(2):
        image(tmp_path / f"frame-{k:06d}.color.jpg")
        image(tmp_path / f"frame-{k:06d}.depth.pgm", np.full((HEIGHT // 2, WIDTH // 4), 2000, np.uint16))
    with pytest.raises(ConfigError, match=r"colour is 64x48 but depth is 16x24.*type source\.depth_camera="):
        views(tmp_path, camera=CAMERA)
    assert np.isfinite(views(tmp_path, camera=CAMERA, depth_camera=[12.5, 25.0, 7.5, 11.5])[0][0].depth).mean() > 0.9
    here = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
    (tmp_path / "_info.txt").write_text(
        f"m_colorWidth = {WIDTH}\nm_colorHeight = {HEIGHT}\nm_depthWidth = {WIDTH // 4}\nm_depthHeight = {HEIGHT // 2}\n"
        "m_depthShift = 1000\nm_calibrationColorIntrinsic = 50 0 31.5 0 0 50 23.5 0 0 0 1 0 0 0 0 1\n"
        "m_calibrationDepthIntrinsic = 12.5 0 7.5 0 0 25 11.5 0 0 0 1 0 0 0 0 1\n"
        f"m_calibrationColorExtrinsic = {here}\nm_calibrationDepthExtrinsic = {here}\n")
    depth = views(tmp_path)[0][0].depth
    assert depth.shape == (HEIGHT, WIDTH) and np.isfinite(depth).mean() > 0.9 and np.nanmax(np.abs(depth - 2.0)) < 1e-6


def test_of_the_intrinsics_of_colour_and_depth_those_of_colour_count(tmp_path):
    for k in range(2):
        image(tmp_path / f"color/{100 * k:06d}.jpg")
        image(tmp_path / f"depth/{100 * k:06d}.png", np.full((HEIGHT, WIDTH), 2000, np.uint16))
    for name, f in (("color", 50), ("depth", 40)):
        (tmp_path / f"intrinsics_{name}.txt").write_text(f"{f} 0 31.5 0\n0 {f} 23.5 0\n0 0 1 0\n0 0 0 1\n")
    assert open_recording(Replay(path=str(tmp_path))).camera.fx == 50.0


@pytest.mark.parametrize("tail", ["", " 0 0 0 1"])
def test_poses_behind_the_number_of_a_view_are_those_of_its_name(tmp_path, tail):
    """KITTI-360 leaves out views before it moved."""
    for k in range(4):
        image(tmp_path / f"drive/{k:010d}.png")
    (tmp_path / "poses.txt").write_text("".join(f"{k} {pose_words(k)}{tail}\n" for k in (1, 3)))
    seen = views(tmp_path / "drive", camera=CAMERA, truth=str(tmp_path / "poses.txt"))
    assert [None if pose is None else pose[0, 3] for _, pose in seen] == [None, 1.0, None, 3.0]


@pytest.mark.parametrize("inside", ["", "data"])
def test_clouds_of_kitti_360_have_the_times_beside_them_and_the_poses_of_their_numbers(tmp_path, inside):
    """Read as seconds, the numbers of the poses met those of a few clouds: an ATE of metres, without a word."""
    drive = tmp_path / "velodyne_points"
    (drive / "data").mkdir(parents=True)
    points = np.column_stack([np.linspace(-9, 9, 400), np.full(400, 4.0), np.linspace(-1, 1, 400), np.zeros(400)])
    for k in range(4):
        points.astype("<f4").tofile(drive / f"data/{k:010d}.bin")
    times = [f"2013-05-28 08:46:0{2 + k}.500000000\n" for k in range(4)]
    (drive / "timestamps.txt").write_text("".join(times))
    (tmp_path / "poses.txt").write_text("".join(f"{k} {pose_words(k)}\n" for k in (1, 3)))
    for rate_hz, apart_s in ((0.0, 1.0), (5.0, 0.2)):
        seen = views(drive / inside, truth=str(tmp_path / "poses.txt"), rate_hz=rate_hz)
        assert [None if pose is None else pose[0, 3] for _, pose in seen] == [None, 1.0, None, 3.0]
        assert seen[1][0].stamp_s - seen[0][0].stamp_s == pytest.approx(apart_s)
    (drive / "timestamps.txt").write_text("".join(times[:2]))
    with pytest.raises(ConfigError, match=r"timestamps\.txt: 2 lines but the last view is number 3"):
        views(drive / inside)


def test_poses_behind_the_number_of_an_image_stand_beside_its_time(tmp_path):
    for k in range(4):
        image(tmp_path / f"drive/{k:010d}.png")
    (tmp_path / "drive/timestamps.txt").write_text("".join(f"2013-05-28 08:46:02.{k}00000000\n" for k in range(4)))
    (tmp_path / "poses.txt").write_text("".join(f"{k} {pose_words(k)}\n" for k in (1, 3)))
    seen = views(tmp_path / "drive", camera=CAMERA, truth=str(tmp_path / "poses.txt"))
    assert [None if pose is None else pose[0, 3] for _, pose in seen] == [None, 1.0, None, 3.0]


def test_poses_behind_a_stamp_are_those_of_that_time(tmp_path):
    folder = tmp_path / "Ouster"
    folder.mkdir()
    points = np.column_stack([np.linspace(-9, 9, 400), np.full(400, 4.0), np.linspace(-1, 1, 400), np.zeros(400)])
    stamps = [1561000444390857630 + 10**8 * k for k in range(3)]
    for stamp in stamps:
        points.astype("<f4").tofile(folder / f"{stamp}.bin")
    lines = [f"{stamp},{pose_words(k).replace(' ', ',')}\n" for k, stamp in enumerate(stamps)]
    (tmp_path / "global_pose.csv").write_text("".join(lines))
    seen = views(folder, truth=str(tmp_path / "global_pose.csv"))
    assert [pose[0, 3] for _, pose in seen] == pytest.approx([0.0, 1.0, 2.0])
    (tmp_path / "global_pose.csv").write_text(lines[0] + "1,2,3\n")
    with pytest.raises(ConfigError, match=r"global_pose\.csv:2: found 3 numbers; expected 13"):
        views(folder, truth=str(tmp_path / "global_pose.csv"))
    (tmp_path / "global_pose.csv").write_text(lines[0].replace("1,0,0,0", "nan,0,0,0"))
    assert [pose for _, pose in views(folder, truth=str(tmp_path / "global_pose.csv"))] == [None] * 3


def test_poses_as_semantic_nerf_calls_them_are_the_truth(tmp_path):
    for k in range(2):
        image(tmp_path / f"rgb/rgb_{k}.png")
        image(tmp_path / f"depth/depth_{k}.png", np.full((HEIGHT, WIDTH), 2000, np.uint16))
    (tmp_path / "traj_w_c.txt").write_text("".join(f"{pose_words(k)} 0 0 0 1\n" for k in range(2)))
    assert [pose[0, 3] for _, pose in views(tmp_path, camera=CAMERA)] == [0.0, 1.0]
