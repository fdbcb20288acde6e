"""A recording read back: messages of any MCAP file, and the views of one that rhs wrote, bit for bit.

Works on cut and damaged files: what is whole is handed out and `report` says what was lost.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.geometry import Camera
from rhs.api.pictures import HEAD_BYTES, check_size
from rhs.api.records import Capture, Scan, Twist, WorldFacts
from rhs.api.robot_shape import footprint_of
from rhs.base.errors import RecordingError

from . import ros
from .mcap_records import Message, Note
from .mcap_scan import Report, open_scan, scan

LEVELS = ("full", "jpeg", "light", "off")
WITH_IMAGES = LEVELS[:2]
STEP = "/rhs/step"
EXTRA = "/extra/"  # before the name of an extra modality
PARTS = {"image": "/camera/image/compressed", "depth": "/camera/depth", "scan": "/scan_points"}


@dataclass(frozen=True, eq=False)
class RunHead:
    """What stands at the beginning of a recording by rhs."""

    camera: Camera
    facts: WorldFacts | None
    config: dict[str, Any]
    level: str
    timed: bool = True  # False: nobody says when its views were taken

    @property
    def has_images(self) -> bool:
        """Whether it was recorded with what a camera saw."""
        return self.level in WITH_IMAGES


@dataclass(frozen=True, eq=False)
class RecordedView:
    """What the sensor reported at one step, as a Capture that a sensor without noise passes on; truth 4x4 or None.

    plain: the step as JSON (see recording.step_to_plain)."""

    capture: Capture
    truth: np.ndarray | None
    phase: str
    plain: dict[str, Any]


class Reading:
    """One pass over a recording. Iterate over it (messages) or over `views()`; then look at `report`."""

    def __init__(self, path: Path):
        file, self.report = open_scan(Path(path))
        file.close()
        self.notes: dict[str, dict[str, str]] = {}

    def __iter__(self) -> Iterator[Message]:
        for item in scan(self.report.path, self.report):
            if isinstance(item, Note):
                self.notes[item.name] = item.values
            else:
                yield item

    def views(self) -> Iterator[RecordedView]:
        """The complete views of a recording by rhs, in order. One that was cut in the middle is left out."""
        plain: dict[str, Any] | None = None
        parts: dict[str, Message] = {}
        for message in self:
            topic = message.channel.topic
            if topic == STEP:
                plain, parts = json.loads(ros.deserialize(message.data, "std_msgs/msg/String").data), {}
                awaited = [*(PARTS[name] for name in plain["holds"]), *(EXTRA + name for name in plain.get("extras", {}))]
            elif plain is not None and (topic in PARTS.values() or topic.startswith(EXTRA)):
                parts[topic] = message
            if plain is not None and all(topic in parts for topic in awaited):
                yield _view(plain, parts)
                plain = None


def read(path: Path) -> Reading:
    """The messages of an MCAP file up to its last whole chunk. Raises RecordingError when it is no MCAP file."""
    return Reading(path)


def read_head(path: Path) -> RunHead | None:
    """The head of a recording by rhs, or None for an MCAP file from elsewhere. Raises RecordingError for others."""
    reading = Reading(path)
    for item in scan(reading.report.path, reading.report):
        if isinstance(item, Note) and item.name == "rhs":
            return head_of(item.values, reading.report)
        if isinstance(item, Message):
            return None
    return None


def head_of(values: dict[str, str], report: Report) -> RunHead:
    """Camera, facts and config from the metadata record `rhs`."""
    try:
        world = json.loads(values["world"])
        return RunHead(camera_of(json.loads(values["camera"])), facts_of(world) if world else None,
                       json.loads(values["config"]), values["level"], values.get("timed") != "false")
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{report.path}: its head does not say which camera it was ({error}); it was not written by "
                             f"this version of rhs") from error


def camera_of(plain: dict[str, Any]) -> Camera:
    """The camera from its JSON form."""
    extrinsics = np.array(plain["body_from_camera"], float).reshape(4, 4)
    return Camera(**{**plain, "distortion": tuple(plain["distortion"]), "body_from_camera": extrinsics})


def facts_of(plain: dict[str, Any]) -> WorldFacts:
    """The facts of the world from their JSON form."""
    x, y, yaw = plain["start"]
    low_x, low_y, high_x, high_y = plain["bounds_m"]
    places = tuple((str(name), float(px), float(py)) for name, px, py in plain["places"])
    return WorldFacts(str(plain["name"]), (x, y, yaw), places, (low_x, low_y, high_x, high_y),
                      float(plain["robot_radius_m"]),
                      footprint_of((plain.get("footprint") or {}).get("corners_m", ()), "footprint"),
                      bool(plain.get("bounds_known", True)))


def _extras(plain: dict[str, Any], parts: dict[str, Message]) -> dict[str, np.ndarray]:
    """The extra modalities of a view, as they were."""
    out = {}
    for name, (dtype, shape) in plain.get("extras", {}).items():
        data = ros.deserialize(parts[EXTRA + name].data, "std_msgs/msg/UInt8MultiArray").data
        try:
            kind = np.dtype(dtype)
        except TypeError as error:
            raise RecordingError(f"the recorded {name} says it holds {dtype!r}; expected a NumPy type") from error
        if kind.hasobject or len(data) != kind.itemsize * int(np.prod(shape, dtype=np.int64)):
            raise RecordingError(f"the recorded {name} holds {len(data)} bytes; expected {dtype} of shape {shape}")
        out[name] = np.frombuffer(bytes(data), kind).reshape(shape)
    return out


def _view(plain: dict[str, Any], parts: dict[str, Message]) -> RecordedView:
    truth = None if plain["truth"] is None else np.array(plain["truth"])
    capture = Capture(
        plain["index"], plain["stamp_s"],
        image=read_image(parts[PARTS["image"]].data) if PARTS["image"] in parts else None,
        depth=read_depth(parts[PARTS["depth"]].data) if PARTS["depth"] in parts else None,
        command=None if plain["told"] is None else Twist(*plain["told"]),
        travel=None if plain["wheel"] is None else np.array(plain["wheel"]),
        scan=_scan(parts[PARTS["scan"]].data, plain["scan"]) if PARTS["scan"] in parts else None,
        sensed=True, extras=_extras(plain, parts),
    )
    return RecordedView(capture, truth, plain["phase"], plain)


def read_image(data: bytes) -> np.ndarray:
    """(H, W, 3) uint8 RGB of a sensor_msgs/CompressedImage."""
    import cv2

    packed = ros.deserialize(data, "sensor_msgs/msg/CompressedImage").data
    check_size(bytes(packed[:HEAD_BYTES]), "a recorded image")
    picture = cv2.imdecode(packed, cv2.IMREAD_COLOR)
    if picture is None:
        raise RecordingError("a recorded image cannot be decoded; expected PNG or JPEG")
    return np.ascontiguousarray(picture[:, :, ::-1])


def read_depth(data: bytes) -> np.ndarray:
    """(H, W) float32 metres of a 32FC1 sensor_msgs/Image."""
    message = ros.deserialize(data, "sensor_msgs/msg/Image")
    if message.encoding != "32FC1":
        raise RecordingError(f"a recorded depth image has the encoding {message.encoding}; expected 32FC1")
    depth_m: np.ndarray = message.data.view("<f4").reshape(message.height, message.width).astype(np.float32)
    return depth_m


def _scan(data: bytes, plain: dict[str, Any]) -> Scan:
    cloud = ros.deserialize(data, "sensor_msgs/msg/PointCloud2")
    table = cloud.data.view(np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("bearing", "<f8"), ("range", "<f8")]))
    x, y = plain["origin_xy_m"]
    return Scan(table["bearing"].copy(), table["range"].copy(), plain["max_range_m"], (x, y))
