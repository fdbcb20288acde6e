"""Bags of rs-record: depth is of a camera of its own, and the bag says where it sits and what a step of depth is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bags import CAMERA, HEIGHT, WIDTH, BagFile, picture
from helpers.replayed import refused, views

DEPTH_M, ASIDE_M, COLUMN = 2.0, 0.2, 30


@pytest.fixture
def bag(tmp_path):
    """A wall with a step at a column of depth; the colour camera sits 0.2 m to the right of it."""
    with BagFile(tmp_path, "ros1") as bag:
        depth = np.full((HEIGHT, WIDTH), round(DEPTH_M / 0.00025), np.uint16)
        depth[:, :COLUMN] = 0
        for k in range(3):
            bag.image("/device_0/sensor_1/Color_0/image/data", 1e9 + k, picture(k), "rgb8", frame="1")
            bag.image("/device_0/sensor_0/Depth_0/image/data", 1e9 + k, depth, "mono16", frame="1")
        for sensor, stream in ((1, "Color_0"), (0, "Depth_0")):
            bag.camera_info(f"/device_0/sensor_{sensor}/{stream}/info/camera_info", 1e9, camera=CAMERA)
        place = bag.make("geometry_msgs/msg/Vector3", x=-ASIDE_M, y=0.0, z=0.0)
        turn = bag.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        bag.put("/device_0/sensor_1/Color_0/tf/0", 1e9, bag.make("geometry_msgs/msg/Transform", translation=place,
                                                                 rotation=turn))
        bag.put("/device_0/sensor_0/option/Depth_Units/value", 1e9, bag.make("std_msgs/msg/Float32", data=0.00025))
    return bag.path


def test_depth_is_seen_from_the_colour_camera_in_metres(bag):
    _, seen = views(bag)
    known = np.isfinite(seen[0][0].depth)
    assert seen[0][0].depth[known] == pytest.approx(DEPTH_M, rel=1e-4)
    first = int(np.flatnonzero(known[HEIGHT // 2])[0])
    assert first == COLUMN - round(CAMERA.fx * ASIDE_M / DEPTH_M)


def test_a_camera_that_is_typed_stands_in_for_a_lens_that_is_not_read(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as made:
        for k in range(3):
            made.image("/camera/image_raw", 1e9 + k, picture(k), "rgb8")
        made.camera_info("/camera/camera_info", 1e9, (0.1, 0.01, 0.0, 0.0), "double_sphere", replace(CAMERA, fx=60.0))
    assert "distortion double_sphere" in refused(made.path, depth_topic="none")
    source, seen = views(made.path, depth_topic="none", camera=[50.0, 50.0, 31.5, 23.5])
    assert len(seen) == 3 and source.camera.fx == 50.0


def test_an_image_with_bytes_behind_it_is_read(tmp_path):
    with BagFile(tmp_path, "ros1") as made:
        image, pixels = "sensor_msgs/msg/Image", np.full((HEIGHT, WIDTH, 3), 9, np.uint8)
        made.camera_info("/camera/camera_info", 1e9)
        link = made.writer.add_connection("/camera/image_raw", image, typestore=made.store)
        message = made.make(image, header=made.header(1e9), height=HEIGHT, width=WIDTH, encoding="rgb8", is_bigendian=0,
                            step=3 * WIDTH, data=pixels.ravel())
        made.writer.write(link, 10**18, bytes(made.store.serialize_ros1(message, image)) + b"\0\0\0\0")
    _, seen = views(made.path, depth_topic="none")
    assert len(seen) == 1 and seen[0][0].image[0, 0, 0] == 9
