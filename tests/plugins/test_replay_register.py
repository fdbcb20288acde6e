"""Depth of a camera beside the colour camera, carried over."""

from __future__ import annotations

import numpy as np
import pytest
from bags import KINDS, BagFile, picture
from painted_room import observe, paintings

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, exp_se3, inverse, se2, se3
from rhs_sources.bags.depth import depth_camera_of
from rhs_sources.replay_cameras import DEPTH_CAMERAS
from rhs_sources.replay_config import Replay
from rhs_sources.replay_register import DepthCamera, typed_depth_camera

COLOR = Camera(160, 120, 131.25, 131.25, 80.0, 60.0)
BESIDE = DepthCamera(146.25, 146.25, 80.0, 60.0, DEPTH_CAMERAS["seven_scenes"].color_from_depth)
STANDS = se2(-0.5, 0.2, 0.3) @ exp_se3(np.array([0, 0, 1.2, 0, 0, 0]))


def test_registered_depth_is_what_the_colour_camera_would_measure():
    mount, textures = COLOR.body_from_camera, paintings()
    depth = observe(Camera(160, 120, 146.25, 146.25, 80.0, 60.0), STANDS, textures).depth
    wanted = observe(COLOR, STANDS @ mount @ inverse(BESIDE.color_from_depth) @ inverse(mount), textures).depth
    carried = BESIDE.registered(depth, COLOR)
    share = carried / wanted - 1.0
    assert 0.75 < np.isfinite(carried).mean() < 0.9  # colour sees more to the sides: nothing is measured there
    assert np.nanmax(np.abs(share)) < 0.02 and abs(np.nanmean(share)) < 2e-4
    inner = carried[20:100, 30:130]
    assert np.isfinite(inner).mean() > 0.99  # and no holes


def test_depth_of_fewer_pixels_than_colour_leaves_no_holes():
    """Depth of 80 by 60 pixels beside colour of 160 by 120 that sees a little less: each pixel covers two by two."""
    textures = paintings()
    depth = observe(Camera(80, 60, 60.0, 60.0, 39.5, 29.5), STANDS, textures).depth
    carried = DepthCamera(60.0, 60.0, 39.5, 29.5, np.eye(4)).registered(depth, COLOR)
    share = carried[8:-8, 8:-8] / observe(COLOR, STANDS, textures).depth[8:-8, 8:-8] - 1.0
    assert np.isfinite(share).all() and np.abs(share).max() < 0.05 and abs(share.mean()) < 2e-3


def test_of_two_surfaces_on_one_pixel_the_nearer_is_seen():
    """Two depth pixels side by side, 1 m and 3 m, fall on one pixel of a colour camera that is half as sharp."""
    depth = np.full((2, 4), np.nan, np.float32)
    depth[0, 2], depth[0, 3] = 3.0, 1.0
    coarse = Camera(2, 1, 2.0, 2.0, 0.75, 0.25)
    carried = DepthCamera(4.0, 4.0, 2.0, 1.0, np.eye(4)).registered(depth, coarse)
    assert carried[0, 1] == pytest.approx(1.0) and np.isnan(carried[0, 0])


def test_a_typed_depth_camera_stands_where_its_last_three_numbers_say():
    """A point 2 m before a depth camera 10 cm to the right of the colour camera is seen 5 pixels right of its middle."""
    typed = typed_depth_camera([100.0, 100.0, 10.0, 10.0, 0.1, 0.0, 0.0])
    depth = np.full((20, 20), np.nan, np.float32)
    depth[10, 10] = 2.0
    carried = typed.registered(depth, Camera(20, 20, 100.0, 100.0, 10.0, 10.0))
    assert np.argwhere(np.isfinite(carried)).tolist() == [[10, 15]]  # 100 * 0.1 / 2 = 5 pixels
    assert typed_depth_camera([]) is None


@pytest.mark.parametrize("values", [[525.0], [525.0, 525.0, 320.0], [0.0, 525.0, 320.0, 240.0], ["a", 1, 1, 1],
                                    [525.0, 525.0, 320.0, 240.0, 5.0, 0.0, 0.0]])
def test_what_is_no_depth_camera_is_refused(values):
    with pytest.raises(ConfigError, match="depth_camera"):
        Replay(path="x", depth_camera=values)


BESIDE_M = 0.05  # the depth camera of these bags is this far to the right of the colour camera
FINER = Camera(200, 150, 182.0, 182.0, 98.0, 76.0)


def pair_bag(folder, kind, *, tf=True, registered=False):
    """Two views of the painted room by a colour camera and a depth camera of other intrinsics beside it; the depth that the
    colour camera would have measured."""
    mount, textures = COLOR.body_from_camera, paintings()
    seen = observe(COLOR, STANDS, textures)
    right = se3(np.eye(3), np.array([BESIDE_M, 0.0, 0.0]))
    deep = observe(FINER, STANDS @ mount @ right @ inverse(mount), textures).depth
    name = "/cam/aligned_depth_to_color" if registered else "/cam/depth"
    with BagFile(folder, kind) as bag:
        for stamp in (1.0, 1.1):
            if tf:
                bag.transform("/tf_static", stamp, "color_optical", "depth_optical", BESIDE_M)
            bag.camera_info("/cam/color/camera_info", stamp, camera=COLOR)
            bag.camera_info(f"{name}/camera_info", stamp, camera=COLOR if registered else FINER)
            bag.image("/cam/color/image_raw", stamp, seen.image, "rgb8", "color_optical")
            bag.image(f"{name}/image_raw", stamp, seen.depth if registered else deep, "32FC1", "depth_optical")
    return bag.path, seen.depth


def read(path, **settings):
    source = Replay(path=str(path), **settings).build(None)
    capture = source.lead()
    source.close()
    return capture


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_says_where_its_depth_camera_is(tmp_path, kind):
    path, wanted = pair_bag(tmp_path, kind)
    carried = read(path).depth
    assert carried.shape == wanted.shape == (120, 160)
    inner = (slice(12, 108), slice(20, 140))
    assert np.isfinite(carried[inner]).mean() > 0.97
    assert np.nanmedian(np.abs(carried / wanted - 1.0)[inner]) < 2e-3


def test_a_depth_camera_that_is_typed_for_a_bag_wins(tmp_path):
    path, _ = pair_bag(tmp_path, "ros2_mcap", tf=False)
    typed = read(path, depth_camera=[182.0, 182.0, 98.0, 76.0, BESIDE_M, 0.0, 0.0]).depth
    (tmp_path / "tf").mkdir()
    joined, _ = pair_bag(tmp_path / "tf", "ros2_mcap")
    assert np.array_equal(typed, read(joined).depth, equal_nan=True)


def test_depth_named_registered_is_left_as_it_is(tmp_path):
    path, wanted = pair_bag(tmp_path, "ros2_mcap", registered=True)
    assert np.array_equal(read(path).depth, wanted, equal_nan=True)


def test_a_depth_frame_that_nothing_joins_to_colour_is_said(tmp_path, caplog):
    path, _ = pair_bag(tmp_path, "ros2_mcap", tf=False)
    assert np.isfinite(read(path).depth).any()
    assert "depth_optical" in caplog.text and "source.depth_camera=" in caplog.text


def test_one_frame_and_one_camera_in_another_size_are_registered():
    half = Camera(80, 60, 65.6, 65.6, 40.0, 30.0)
    assert depth_camera_of(("c", "/c"), {}, (COLOR, half), "/depth") is None
    assert depth_camera_of(("c", "c"), {}, (COLOR, None), "/depth") is None
    assert depth_camera_of(("c", "c"), {}, (COLOR, FINER), "/depth").fx == 182.0


def test_the_lens_of_either_camera_is_minded():
    """A point at the corner: a lens moves it in the picture of colour, and the ray of its pixel in that of depth."""
    lens, flat = (0.1, -0.02, 0.003, -0.002, 0.0), Camera(200, 200, 100.0, 100.0, 99.5, 99.5)
    bent = Camera(200, 200, 100.0, 100.0, 99.5, 99.5, distortion=lens)
    point = flat.rays(np.array([[160.0, 150.0]]))
    depth = np.full((200, 200), np.nan, np.float32)
    depth[150, 160] = 1.0
    carried = DepthCamera(100.0, 100.0, 99.5, 99.5, np.eye(4)).registered(depth, bent)
    u, v = np.rint(bent.project(point))[0].astype(int)
    assert np.argwhere(np.isfinite(carried)).tolist() == [[v, u]] and (u, v) != (160, 150)
    back = np.full((200, 200), np.nan, np.float32)
    back[v, u] = 1.0
    again = DepthCamera(100.0, 100.0, 99.5, 99.5, np.eye(4), lens).registered(back, flat)
    assert np.abs(np.argwhere(np.isfinite(again))[0] - [150, 160]).max() <= 1


def test_a_cloud_of_a_camera_held_in_a_hand_is_moved_to_colour(tmp_path):
    """A point 2 m before a scanner 0.2 m to the right of the camera falls 50 * 0.2 / 2 = 5 pixels right of the middle."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.transform("/tf_static", 1.0, "color_optical", "camera", 0.2)
        bag.camera_info("/cam/color/camera_info", 1.0)
        bag.image("/cam/color/image_raw", 1.0, picture(), "rgb8", "color_optical")
        bag.cloud("/points", 1.0, np.array([[0.01, 0.01, 2.0]]))
    assert np.argwhere(np.isfinite(read(bag.path).depth)).tolist() == [[24, 37]]
