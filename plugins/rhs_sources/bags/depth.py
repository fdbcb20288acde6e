"""The camera that took a bag's depth images, where it is another than the one of colour.

ROS says it twice: by the frame of the images (of one frame: registered, REP 118) and by the CameraInfo beside each topic.
Where the frames differ tf joins them; where the numbers differ by more than the size of images explains, so do the cameras.
"""

from __future__ import annotations

import logging

import numpy as np

from rhs.api.geometry import Camera

from ..replay_mounts import UNTURNED, Mounts
from ..replay_register import DepthCamera

log = logging.getLogger("rhs.replay")
SAME = 2e-3  # of the width: intrinsics that differ by less are of one camera
SAID_REGISTERED = ("registered", "aligned", "_to_rgb", "_to_color")  # in the names that drivers give to such topics


def depth_camera_of(frames: tuple[str, str], links: dict, cameras: tuple[Camera | None, Camera | None],
                    topic: str) -> DepthCamera | None:
    """The camera of a topic of depth images; None where it is the one of colour. frames, cameras: of colour and of depth, as
    the headers and the CameraInfo say ("" and None: they do not); links: of the tf tree."""
    if any(word in topic for word in SAID_REGISTERED) and "infra" not in topic:  # RealSense: aligned_depth_to_infra1
        return None
    color, depth = cameras
    pose = color_from(frames, links, topic)
    own = depth or color
    if own is None or (np.allclose(pose, UNTURNED, atol=1e-6) and _is_one(own, color or own)):
        return None
    return DepthCamera(own.fx, own.fy, own.cx, own.cy, pose, own.distortion)


def color_from(frames: tuple[str, str], links: dict, topic: str) -> np.ndarray:
    """4x4 color_from_depth by the fixed links of tf; where none joins the frames it is said, and they are taken as one."""
    if frames[0].strip("/") == frames[1].strip("/") or not all(frames):
        return UNTURNED
    pose = Mounts(links, frames[0]).of(frames[1])
    if pose is None:
        log.warning("%s: its frame %s is joined by no fixed tf links to %s of the colour images; it is taken to be of one "
                    "place with them (of images type source.depth_camera=[fx,fy,cx,cy,x_m,y_m,z_m] where it is not)",
                    topic, frames[1], frames[0])
    return UNTURNED if pose is None else pose


def _is_one(first: Camera, second: Camera) -> bool:
    """Whether two cameras differ by the size of their images alone."""
    one, other = (np.array([c.fx / c.width, c.cx / c.width, c.fy / c.height, c.cy / c.height]) for c in (first, second))
    return bool(np.allclose(one, other, atol=SAME, rtol=0.0))
