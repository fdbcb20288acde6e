"""Images that a driver cut out of what its sensor sees, or binned: CameraInfo tells of the whole sensor, and of both.

sensor_msgs/CameraInfo: width, height, K and P are of the full resolution; `roi` is given in it, and an image has its size
over `binning_x` and `binning_y`, whose pixels are those of neighbours combined. Drivers that write the numbers of the images
as they are and leave `binning` beside them are told by the size of these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.geometry import Camera

from ..replay_images import resized
from . import messages as ros


def as_taken(camera: Camera | None, info, image, topic: str) -> Camera | None:
    """The camera (of a CameraInfo, info) of the images of a topic, the first of them given; as it is where they are not of
    the size that roi and binning make."""
    roi = getattr(info, "roi", None)  # Foxglove's have none
    if camera is None or roi is None:
        return camera
    whole = int(roi.width or info.width), int(roi.height or info.height)
    small = whole[0] // max(1, int(info.binning_x)), whole[1] // max(1, int(info.binning_y))
    if small == (camera.width, camera.height) or small != _size(image, topic):
        return camera
    part = replace(camera, width=whole[0], height=whole[1], cx=camera.cx - roi.x_offset, cy=camera.cy - roi.y_offset)
    return resized(part, small)


def _size(image, topic: str) -> tuple[int, ...]:
    """(width, height)."""
    if not hasattr(image, "format"):
        return int(image.width), int(image.height)
    if "compressedDepth" in image.format:
        return ros.depth_of(image, topic, scale=1.0, max_depth_m=np.inf).shape[::-1]
    return ros.color_of(image, topic).shape[1::-1]
