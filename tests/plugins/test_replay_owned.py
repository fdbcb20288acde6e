"""What people own, seventh round: several cameras in a bag, packed bags, data sets as they are unpacked, logs of other lasers."""

from __future__ import annotations

import numpy as np
import pytest
from bags import HEIGHT, KINDS, WIDTH, BagFile, picture

from rhs.api.errors import ConfigError
from rhs_sources.replay_config import Replay


def views(path, **settings):
    source = Replay(path=str(path), **settings).build(None)
    seen = []
    while (capture := source.lead()) is not None:
        seen.append((capture, source.truth()))
    source.close()
    return source, seen


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
    with pytest.raises(ConfigError, match=r"several color topics; type source\.color_topic=NAME of /left/color/image_raw, /ri"):
        views(path)
    _, seen = views(path, color_topic="/right/color/image_raw")
    assert [float(np.median(capture.depth)) for capture, _ in seen] == [3.0] * 3


@pytest.mark.parametrize("name", ["color", "depth", "info", "scan", "wheel"])
def test_a_topic_that_holds_something_else_is_refused_with_what_there_is(tmp_path, name):
    path = two_cameras(tmp_path, "ros2_mcap")
    wrong = "/odom" if name != "wheel" else "/left/color/image_raw"
    typed = {"color_topic": "/left/color/image_raw"} | {f"{name}_topic": wrong}
    with pytest.raises(ConfigError, match=rf"{wrong} holds \w+; found /.*; expected source\.{name}_topic=NAME of ") as caught:
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
