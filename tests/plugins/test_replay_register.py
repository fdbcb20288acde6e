"""Depth of a camera beside the colour camera, carried over."""

from __future__ import annotations

import numpy as np
import pytest
from painted_room import observe, paintings

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, exp_se3, inverse, se2
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
