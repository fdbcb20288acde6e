"""Where a sensor sits on the robot: by the tf tree of a bag, or as the user types it.

The body is the frame whose motion the wheels tell (the child frame of their Odometry), else base_footprint or base_link,
else, for a laser, the frame at the end of the fixed links above it; a camera without any of these is held in a hand, and is
the body itself. A link counts as fixed when /tf_static has it, or when /tf
repeats it unchanged. A sensor of whose frame nothing is said sits where the body is, as it did when nobody asked.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace
from os.path import commonprefix

import numpy as np

from rhs.api.errors import ConfigError, check_range
from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, inverse, log_so3, se3, wrap
from rhs.api.records import Scan

BODIES = ("base_footprint", "base_link")
STILL_M, STILL_RAD = 1e-3, 1e-3  # a link of /tf that moves by less is fixed
MOST_TILT = 0.2  # rise of a beam per length; a scanner tilted more sees floor and ceiling, no floor plan
MOST_LINKS = 50
UPRIGHT = 0.9  # of the z axis of a frame: nearer to the vertical than 26 degrees
UNTURNED = np.eye(4)
log = logging.getLogger("rhs.replay")


def mount_of(values, name: str) -> np.ndarray | None:
    """4x4 body_from_sensor of [x_m, y_m, z_m, roll_deg, pitch_deg, yaw_deg] (turned about z, then y, then x); None when
    empty. Raises ConfigError."""
    try:
        numbers = [float(v) for v in values] if not isinstance(values, str) else [np.nan]
    except (TypeError, ValueError):
        numbers = [np.nan]
    if not numbers:
        return None
    if len(numbers) != 6:
        raise ConfigError(f"source.{name}={values}: expected [x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg], six numbers")
    for number, part in zip(numbers[:3], "xyz", strict=True):
        check_range("source", f"{name} {part}", number, low=-100.0, high=100.0, unit="m")
    for number, part in zip(numbers[3:], ("roll", "pitch", "yaw"), strict=True):
        check_range("source", f"{name} {part}", number, low=-360.0, high=360.0, unit="degrees")
    from scipy.spatial.transform import Rotation

    return se3(Rotation.from_euler("ZYX", numbers[:2:-1], degrees=True).as_matrix(), np.array(numbers[:3]))


def placed_camera(camera: Camera, settings) -> Camera:
    """The camera where it was typed to sit."""
    mount = mount_of(settings.camera_mount, "camera_mount")
    return camera if mount is None else replace(camera, body_from_camera=mount @ se3(BODY_FROM_OPTICAL, np.zeros(3)))


class Mounts:
    """The fixed links of a tf tree: child -> (parent, parent_from_child)."""

    def __init__(self, links: dict[str, tuple[str, np.ndarray]], body: str = "", *, wheels: str = "") -> None:
        """body: the frame that is the body; empty: found as the module says, where wheels is the frame they tell of."""
        self._links, self._body = links, body.strip("/")
        if not self._body and wheels.strip("/") in self._frames():
            self._body = wheels.strip("/")

    def knows(self, frame: str) -> bool:
        return frame.strip("/") in self._frames()

    def _frames(self) -> set[str]:
        return {*self._links, *(parent for parent, _ in self._links.values())}

    def of(self, frame: str, *, to_the_end: bool = False) -> np.ndarray | None:
        """4x4 body_from_frame; None where the tree does not join the two. to_the_end: where no body is named, the end of the
        links is it; where one is and is not joined, that is said."""
        at, pose = frame.strip("/"), UNTURNED
        for _ in range(MOST_LINKS):
            if at == self._body or (not self._body and at in BODIES):
                return pose
            if at not in self._links:
                break
            at, step = self._links[at]
            pose = step @ pose
        if self._body:
            found = self._beside(at, pose)
            if found is None and to_the_end:
                log.warning("no fixed tf links join the frame %s to %s of the body: it is taken to sit there; where it does "
                            "not type source.scan_mount=[x,y,z,roll,pitch,yaw]", frame, self._body)
            return found
        return pose if to_the_end and pose is not UNTURNED else None

    def listed(self) -> str:
        """The frames it knows, for people."""
        return ", ".join(sorted(self._frames())) or "no fixed link at all"

    def _beside(self, root: str, root_from_frame: np.ndarray) -> np.ndarray | None:
        """The same where the body hangs under the same root and not above the frame; None where it does not."""
        at, pose = self._body, UNTURNED
        for _ in range(MOST_LINKS):
            if at == root:
                found: np.ndarray = inverse(pose) @ root_from_frame
                return found
            if at not in self._links:
                return None
            at, step = self._links[at]
            pose = step @ pose
        return None


def say_apart(topic: str, frame: str, tree: Mounts) -> None:
    """Says so where wheels (topic) tell of a frame that tf does not know, though it puts sensors on a body."""
    bodies = [body for body in BODIES if tree.knows(body)]
    if bodies and frame and frame.strip("/") not in BODIES and not tree.knows(frame):
        log.warning("%s tells of the frame %s, which tf does not know: it is taken to be %s; if it sits elsewhere (a "
                    "tracking camera's), record its link in /tf_static, or type source.wheel_topic=none", topic, frame,
                    bodies[-1])


def optical(body_from_frame: np.ndarray | None, frame: str) -> np.ndarray | None:
    """Body_from_camera (optical axes) of images in a frame. One whose z points up has x ahead, as simulators write (REP 103
    calls frames with z ahead _optical): it is said."""
    if body_from_frame is None or "optical" in frame or abs(body_from_frame[2, 2]) < UPRIGHT:
        return body_from_frame
    log.warning("images are of the frame %s, whose z points up or down: it is taken to look along its x; for a camera that "
                "looks up or down type source.camera_mount=[x,y,z,roll,pitch,yaw]", frame)
    return body_from_frame @ se3(BODY_FROM_OPTICAL, np.zeros(3))


def tf_topics(topics: Iterable[str], sensor: str) -> list[tuple[str, bool]]:
    """(topic, is static) of tf, the static one first: /tf_static and /tf, or those of the robot in whose namespace the topic
    of a sensor is (/robot1/scan, /robot1/tf)."""
    def near(topic: str) -> tuple[int, int]:
        return len(commonprefix([topic.split("/"), sensor.split("/")])), -topic.count("/")

    found = (max((one for one in topics if one.endswith(ending)), key=near, default="") for ending in ("/tf_static", "/tf"))
    return [(topic, topic.endswith("static")) for topic in found if topic]


def links_of(transforms) -> tuple[dict[str, tuple[str, np.ndarray]], dict[str, str]]:
    """Of (child, parent, pose, is static), the static ones first: those that never move (child -> parent, pose), and those
    that do (child -> first parent). A static one stands whatever else is said of its child (motion capture sees it under a
    parent of its own)."""
    links: dict[str, tuple[str, np.ndarray]] = {}
    moving: set[str] = set()
    stands: set[str] = set()
    for child, parent, pose, static in transforms:
        if static:
            stands.add(child)
        if child not in links:
            links[child] = (parent, pose)
            continue
        off = inverse(links[child][1]) @ pose
        if child not in stands and (np.linalg.norm(off[:3, 3]) > STILL_M or np.linalg.norm(log_so3(off[:3, :3])) > STILL_RAD
                           or parent != links[child][0]):
            moving.add(child)
    fixed = {child: link for child, link in links.items() if child not in moving}
    return fixed, {child: links[child][0] for child in moving}


def mounted(scan: Scan, body_from_scanner: np.ndarray | None, where: str) -> Scan:
    """The scan as the body has it: bearings turned, beams from where the scanner sits; also of one mounted upside down.
    Raises ConfigError for a scanner that is tilted."""
    if body_from_scanner is None:
        return scan
    rotation = body_from_scanner[:3, :3]
    if abs(rotation[2, :2]).max() > MOST_TILT:
        tilt = np.degrees(np.arcsin(np.clip(np.hypot(*rotation[2, :2]), 0.0, 1.0)))
        raise ConfigError(f"{where}: the laser is mounted tilted by {tilt:.0f} degrees; expected one that looks around in "
                          "a plane (type source.scan_mount=[x,y,z,roll,pitch,yaw], or source.scan_topic=none)")
    way = rotation[:2, :2] @ np.stack([np.cos(scan.bearings_rad), np.sin(scan.bearings_rad)])
    bearings = np.unwrap(np.arctan2(way[1], way[0]))
    if len(bearings):
        bearings = bearings - 2.0 * np.pi * np.round(0.5 * (bearings.min() + bearings.max()) / (2.0 * np.pi))
        if np.abs(bearings).max() > np.pi + 1e-6:  # a scanner that looks backwards: its first beam is beside its last
            bearings = np.asarray(wrap(bearings))
    order = np.argsort(bearings, kind="stable")
    ranges = np.asarray(scan.ranges_m, float) * np.hypot(*way)
    x_m, y_m, _ = body_from_scanner[:3, :3] @ [*scan.origin_xy_m, 0.0] + body_from_scanner[:3, 3]
    out = Scan(bearings[order], ranges[order], scan.max_range_m, (float(x_m), float(y_m)))
    for array in (out.bearings_rad, out.ranges_m):
        array.setflags(write=False)
    return out
