"""Bags whose CameraInfo tells of the whole sensor, beside images that are a part of it or binned; images of no camera."""

from __future__ import annotations

import numpy as np
import pytest
from bags import CAMERA, HEIGHT, KINDS, WIDTH, BagFile, picture

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

DEPTH = np.full((HEIGHT, WIDTH), 2000, np.uint16)
TWICE = Camera(2 * WIDTH, 2 * HEIGHT, 2 * CAMERA.fx, 2 * CAMERA.fy, 63.5, 47.5)  # whose middle is that of CAMERA


def opened(path, **settings):
    return open_recording(Replay(path=str(path), **settings))


def recorded(folder, kind="ros2_mcap", *, packed=False, more=(), **info):
    """Two views, with a CameraInfo of both topics of images; more: topics of other images."""
    folder.mkdir(exist_ok=True)
    with BagFile(folder, kind) as bag:
        for k in range(2):
            stamp = 1.0 + 0.1 * k
            if packed:
                bag.compressed("/camera/color/image/compressed", stamp, picture(k)[:, :, ::-1], "rgb8; jpeg compressed bgr8")
            else:
                bag.image("/camera/color/image", stamp, picture(k), "rgb8")
            bag.image("/camera/depth/image", stamp, DEPTH, "16UC1")
            for eye in ("color", "depth"):
                bag.camera_info(f"/camera/{eye}/camera_info", stamp, **info)
            for topic in more:
                bag.image(topic, stamp, picture(k), "rgb8")
    return bag.path


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("camera", "binning", "part"), [
    (TWICE, 2, (0, 0, 0, 0)),  # two by two pixels are one
    (Camera(96, 72, 50.0, 50.0, 47.5, 41.5), 0, (16, 18, WIDTH, HEIGHT)),  # of the same shape as the whole
    (Camera(160, 112, 100.0, 100.0, 73.5, 55.5), 2, (10, 8, 2 * WIDTH, 2 * HEIGHT)),
    (CAMERA, 2, (0, 0, 0, 0)), (CAMERA, 0, (0, 0, WIDTH, HEIGHT)),  # as drivers write them that tell of the images
])
def test_images_that_are_binned_or_cut_out_have_the_camera_of_what_they_show(tmp_path, kind, camera, binning, part):
    recording = opened(recorded(tmp_path, kind, camera=camera, binning=binning, part=part))
    seen = recording.camera
    assert (seen.width, seen.height, seen.fx, seen.fy, seen.cx, seen.cy) == (64, 48, 50.0, 50.0, 31.5, 23.5)
    assert [float(np.median(capture.depth)) for capture, _ in recording.views] == [2.0, 2.0]


def test_compressed_images_that_are_binned_are_told_by_their_size(tmp_path):
    assert opened(recorded(tmp_path, packed=True, camera=TWICE, binning=2)).camera.fx == 50.0


def test_images_of_a_size_that_neither_binning_nor_roi_explains_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="images in bag are 64x48 but .* is for 128x96"):
        opened(recorded(tmp_path, camera=TWICE, binning=4))


def test_of_several_topics_of_images_those_that_a_camera_took_are_read(tmp_path, caplog):
    """A simulator's labels, and what other programs draw, have no CameraInfo of their own."""
    path = recorded(tmp_path / "a", more=("/camera/color/semantic_segmentation", "/aruco/result"), camera=CAMERA)
    assert opened(path).camera.fx == 50.0
    assert "a CameraInfo goes with /camera/color/image alone" in caplog.text and "segmentation" not in caplog.text
    two = recorded(tmp_path / "b", more=("/camera/color/image_rect",), camera=CAMERA)
    with pytest.raises(ConfigError, match="several color topics"):
        opened(two)
