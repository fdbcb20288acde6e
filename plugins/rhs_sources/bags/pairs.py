"""The second camera of a pair in a bag: which it is, and where it sits beside the first.

CameraInfo says it (sensor_msgs/CameraInfo): R turns each camera's axes into those of the rectified pair, and in the second
one's P, K (I | t), t is where the first sits, -fx times the baseline across. Where it says no baseline, tf joins the frames;
bags of rs-record say it in topics of their own.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse, se3

from ..folders.intrinsics import second_of_chain
from ..replay_cameras import check_pose
from ..replay_mounts import Mounts
from . import messages as ros
from . import realsense
from .cut import as_taken
from .topics import Topics

LEAST_M = 1e-3  # of a baseline


def right_camera(reader, topics: Topics, camera: Camera, links: dict, settings) -> Camera:
    """The right camera, by the file of both that was typed, else as the bag says. camera: the left one, placed; links: of
    tf. Raises ConfigError where nothing says which camera it is or where it sits."""
    where, file = settings.path, Path(str(settings.camera)).expanduser()
    chain = second_of_chain(file, (camera.width, camera.height)) if file.is_file() else None
    if chain is not None:
        return replace(chain[0], body_from_camera=camera.body_from_camera @ check_pose(chain[1], f"{file.name}: T_cn_cnm1"))
    (left, frame, _), (right, other, image) = (_told(reader, topic, info) for topic, info in (
        (topics.color, topics.info), (topics.right, topics.right_info)))
    recorded = None if right is None else ros.camera_of(right, rectified=ros.is_rectified(topics.right))
    recorded = recorded if image is None else as_taken(recorded, right, image, topics.right)
    if recorded is None:
        raise ConfigError(f"{where}: no CameraInfo says which camera {topics.right} is; record it beside its images, "
                          "type source.camera=camchain.yaml (Kalibr's, of both), or sensor=mono for the first camera alone")
    if (recorded.width, recorded.height) != (camera.width, camera.height):
        raise ConfigError(f"{where}: {topics.right} is of {recorded.width}x{recorded.height} pixels and {topics.color} of "
                          f"{camera.width}x{camera.height}; expected one size; type sensor=mono for the first camera alone")
    place = realsense.first_from_second(reader, topics.color, topics.right)
    if place is None:
        place = _by_projection(left, right, rectified=ros.is_rectified(topics.color))
    if place is None and frame and other and frame != other:
        place = Mounts(links, frame).of(other)
    if place is None or np.linalg.norm(place[:3, 3]) < LEAST_M:
        raise ConfigError(f"{where}: nothing says where {topics.right} sits beside {topics.color}: P[3] of its CameraInfo "
                          f"is 0 and tf does not join {frame or 'its frame'} and {other or 'the other'}; record the "
                          "rectified CameraInfo, or type sensor=mono for the first camera alone")
    return replace(recorded, body_from_camera=camera.body_from_camera @ place)


def _told(reader, topic: str, info: str):
    """(the first CameraInfo or None, the frame of the images, the first of these or None)."""
    first = next(islice(ros.stamped(reader, {topic}), 1), None)
    told = next(islice(ros.stamped(reader, {info}), 1), None) if info else None
    image = None if first is None else first[2]
    return None if told is None else told[2], "" if image is None else image.header.frame_id.strip("/"), image


def _by_projection(left, right, *, rectified: bool) -> np.ndarray | None:
    """4x4 left_from_right as the two CameraInfo say; None where they say no baseline. rectified: of images that are."""
    shifts, turns = [], []
    for told in (left, right):
        if told is None:
            return None
        p = np.asarray(told.P if hasattr(told, "P") else told.p, float).reshape(3, 4)
        if not (np.isfinite(p).all() and p[0, 0] > 0.0):
            return None
        shifts.append(np.linalg.solve(p[:, :3], p[:, 3]))
        turn = np.asarray(told.R if hasattr(told, "R") else told.r, float).reshape(3, 3)
        turns.append(np.eye(3) if rectified or not turn.any() else turn)
    if np.linalg.norm(shifts[1] - shifts[0]) < LEAST_M:
        return None
    at = [inverse(se3(np.eye(3), shift)) @ se3(turn, np.zeros(3)) for shift, turn in zip(shifts, turns, strict=True)]
    return check_pose(inverse(at[0]) @ at[1], "CameraInfo")
