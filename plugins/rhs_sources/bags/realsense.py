"""What rs-record and the RealSense viewer write beside the images of a .bag: where cameras sit, and what a step of depth is.

Topics are called /device_0/sensor_1/Color_0/image/data. `.../Color_0/tf/0` holds a Transform without a header: the points of
the reference camera as this one has them (librealsense, ros_writer.cpp and device.cpp: get_extrinsics from the pin stream to
the stream). `/device_0/sensor_0/option/Depth_Units/value`: metres in a step of depth, 0.00025 of an L515.
"""

from __future__ import annotations

import re

import numpy as np

from rhs.api.geometry import inverse, rotation_of_quaternion, se3

from . import messages as ros

_IMAGES = re.compile(r"(/device_\d+/sensor_\d+)/\w+?_\d+/image/data$")


def first_from_second(reader, first: str, second: str) -> np.ndarray | None:
    """4x4, of the cameras of two topics of images; None where the bag is of another recorder or does not say."""
    if not (_IMAGES.match(first) and _IMAGES.match(second)):
        return None
    first_from_reference, second_from_reference = (_from_reference(reader, topic) for topic in (first, second))
    if first_from_reference is None or second_from_reference is None:
        return None
    out: np.ndarray = first_from_reference @ inverse(second_from_reference)
    return out


def depth_scale(reader, depth: str) -> float:
    """Steps of depth in a metre; 0 where the bag is of another recorder or does not say."""
    found = _IMAGES.match(depth)
    said = re.compile(rf"{found[1]}/option/Depth.Units/value$" if found else r"(?!)")
    for _, _, message in ros.messages(reader, [c for c in reader.connections if said.match(c.topic)]):
        return round(1.0 / float(message.data), 6) if message.data > 0.0 else 0.0
    return 0.0


def _from_reference(reader, topic: str) -> np.ndarray | None:
    stream = topic.removesuffix("/image/data")
    for _, _, message in ros.messages(reader, [c for c in reader.connections if c.topic.startswith(f"{stream}/tf/")]):
        place, turn = message.translation, message.rotation
        return se3(rotation_of_quaternion(np.array([turn.x, turn.y, turn.z, turn.w])), np.array([place.x, place.y, place.z]))
    return np.eye(4) if topic.split("/")[-3].startswith("Depth") else None  # the reference has none in some bags
