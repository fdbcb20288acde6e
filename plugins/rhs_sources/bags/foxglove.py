"""MCAP files whose messages are Foxglove's own schemas (protobuf or JSON), or those of ROS 1: read as those of ROS 2 are.

docs.foxglove.dev, "Schemas": RawImage, CompressedImage, CameraCalibration, LaserScan, PointCloud, PoseInFrame,
FrameTransform and FrameTransforms; what `mcap convert` makes of a .bag holds messages of ROS 1. `McapBag` hands them out as
rosbags' AnyReader does; all transforms are those of /tf.
"""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import rotation_of_quaternion, se3

TF = "/tf"
ROS = {"RawImage": "sensor_msgs/msg/Image", "CompressedImage": "sensor_msgs/msg/CompressedImage",
       "CameraCalibration": "sensor_msgs/msg/CameraInfo", "LaserScan": "sensor_msgs/msg/LaserScan",
       "PointCloud": "sensor_msgs/msg/PointCloud2", "PoseInFrame": "geometry_msgs/msg/PoseStamped",
       "FrameTransform": "tf2_msgs/msg/TFMessage", "FrameTransforms": "tf2_msgs/msg/TFMessage"}
FIELDS = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}  # Foxglove's numeric types as PointField's: unsigned come first
Plain = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Connection:
    """A channel by the names of ROS. read: its message of bytes."""

    topic: str
    msgtype: str
    number: int
    read: Callable[[bytes], Any]


class McapBag:
    """The part of AnyReader's face that readers of bags use."""

    def __init__(self, path: Path) -> None:
        """Raises ValueError where no channel of the file is of these kinds, whatever the library raises for a broken one."""
        from mcap.reader import make_reader

        self.paths = [path]
        self._file = path.open("rb")
        try:
            self._reader = make_reader(self._file)
            summary = self._reader.get_summary()
            if summary is None or any(channel.message_encoding == "cdr" for channel in summary.channels.values()):
                raise ValueError("no summary, or of ROS 2")
            self.connections = [found for channel in summary.channels.values() if channel.schema_id in summary.schemas and (
                found := _connection(channel, summary.schemas[channel.schema_id])) is not None]
            if not self.connections:
                raise ValueError("none of its messages is of Foxglove or ROS 1")
        except BaseException:
            self._file.close()
            raise
        counts: Counter = Counter()
        told = summary.statistics.channel_message_counts if summary.statistics else {}
        for one in self.connections:
            counts[one.topic] += told.get(one.number, 0)
        self.topics = {one.topic: SimpleNamespace(msgtype=one.msgtype, msgcount=counts[one.topic])
                       for one in self.connections}

    def messages(self, connections: list[Connection]) -> Iterator[tuple[Connection, int, Any]]:
        """(connection, when it was logged in nanoseconds, what `deserialize` makes a message of)."""
        chosen = {one.number: one for one in connections}
        for schema, channel, message in self._reader.iter_messages():
            if schema is not None and (one := chosen.get(channel.id)) is not None:
                yield one, message.log_time, (one, message.data)

    def deserialize(self, raw: Any, kind: str) -> Any:
        """The message, of the form that ROS 2 has. Raises ValueError, KeyError, TypeError."""
        connection, data = raw
        return connection.read(data)

    def close(self) -> None:
        self._file.close()


def _connection(channel, schema) -> Connection | None:
    """None of a channel that nothing is known of."""
    if channel.message_encoding == "ros1":
        name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/", 1)
        return Connection(channel.topic, name, channel.id, _of_ros1(schema.data.decode("utf-8", "replace"), name))
    package, _, word = schema.name.rpartition(".")
    if package != "foxglove" or channel.message_encoding not in ("protobuf", "json"):
        return None
    kind = ROS.get(word, f"foxglove/{word}")
    plain: Callable[[bytes], Plain]
    if channel.message_encoding == "json":
        plain = json.loads
    else:
        from .protobuf import reader_of

        plain = reader_of(schema.data, schema.name)
    made = MADE.get(word, lambda one: SimpleNamespace(**one))

    def read(data: bytes) -> Any:
        message = made(plain(data))
        message.__msgtype__ = kind
        return message

    return Connection(TF if kind == ROS["FrameTransform"] else channel.topic, kind, channel.id, read)


def _of_ros1(text: str, name: str) -> Callable[[bytes], Any]:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, name))
    return lambda data: store.deserialize_ros1(data, name)


def _header(one: Plain, frame: str = "frame_id") -> SimpleNamespace:
    """Stamps of protobuf have seconds and nanos, those of JSON sec and nsec."""
    said = one.get("timestamp") or {}
    stamp = SimpleNamespace(sec=said.get("sec", said.get("seconds", 0)), nanosec=said.get("nsec", said.get("nanos", 0)))
    return SimpleNamespace(stamp=stamp, frame_id=one.get(frame) or "")


def _bytes(data: Any) -> np.ndarray:
    return np.frombuffer(base64.b64decode(data) if isinstance(data, str) else data, np.uint8)


def _image(one: Plain) -> SimpleNamespace:
    return SimpleNamespace(header=_header(one), width=one["width"], height=one["height"], encoding=one["encoding"],
                           step=one["step"], is_bigendian=0, data=_bytes(one["data"]))


def _compressed(one: Plain) -> SimpleNamespace:
    return SimpleNamespace(header=_header(one), format=one["format"], data=_bytes(one["data"]))


def _calibration(one: Plain) -> SimpleNamespace:
    def numbers(name: str, count: int) -> np.ndarray:
        given = np.asarray(one.get(name, ()), float)
        return given if len(given) == count else np.zeros(count)

    return SimpleNamespace(header=_header(one), width=one["width"], height=one["height"], k=numbers("K", 9),
                           p=numbers("P", 12), r=numbers("R", 9), d=one.get("D", ()),
                           distortion_model=one.get("distortion_model", ""))


def _scan(one: Plain) -> SimpleNamespace:
    ranges = np.asarray(one["ranges"], float)
    step = (one["end_angle"] - one["start_angle"]) / max(len(ranges) - 1, 1)
    return SimpleNamespace(header=_header(one), angle_min=one["start_angle"], angle_max=one["end_angle"],
                           angle_increment=step, time_increment=0.0, scan_time=0.0, range_min=0.0,
                           range_max=np.inf, ranges=ranges, own=_own(one))


def _cloud(one: Plain) -> SimpleNamespace:
    data, stride = _bytes(one["data"]), one["point_stride"]
    fields = [SimpleNamespace(name=f["name"], offset=int(f["offset"]), datatype=FIELDS.get(f["type"], 0), count=1)
              for f in one["fields"]]
    return SimpleNamespace(header=_header(one), height=1, width=len(data) // max(stride, 1), fields=fields,
                           is_bigendian=False, point_step=stride, row_step=0, data=data, own=_own(one))


def _own(one: Plain) -> np.ndarray | None:
    """4x4 frame_from_sensor of a scan or cloud that does not sit at the origin of its frame; None where it does."""
    pose = one.get("pose") or {}
    place, turn = ([float((pose.get(part) or {}).get(axis, 0.0)) for axis in axes]
                   for part, axes in (("position", "xyz"), ("orientation", "xyzw")))
    if not any(abs(value) > 1e-9 for value in (*place, *turn[:3])):
        return None
    turn = turn if any(turn) else [0.0, 0.0, 0.0, 1.0]  # left out: protobuf's zeros
    if not 0.9 < float(np.linalg.norm(turn)) < 1.1:
        raise ConfigError(f"Foxglove's message has a pose of its own in the frame {one.get('frame_id')!r} whose quaternion "
                          f"is {' '.join(f'{v:g}' for v in turn)}; expected a unit one")
    return se3(rotation_of_quaternion(np.array(turn)), np.array(place))


def _at(one: Plain | None) -> SimpleNamespace:
    return SimpleNamespace(**({axis: 0.0 for axis in "xyzw"} | (one or {})))


def _pose(one: Plain) -> SimpleNamespace:
    pose = one.get("pose") or {}
    return SimpleNamespace(header=_header(one), pose=SimpleNamespace(position=_at(pose.get("position")),
                                                                     orientation=_at(pose.get("orientation"))))


def _transforms(many: list[Plain]) -> SimpleNamespace:
    return SimpleNamespace(transforms=[SimpleNamespace(
        header=_header(one, "parent_frame_id"), child_frame_id=one["child_frame_id"], transform=SimpleNamespace(
            translation=_at(one.get("translation")), rotation=_at(one.get("rotation")))) for one in many])


MADE: dict[str, Callable[[Plain], SimpleNamespace]] = {
    "RawImage": _image, "CompressedImage": _compressed, "CameraCalibration": _calibration, "LaserScan": _scan,
    "PointCloud": _cloud, "PoseInFrame": _pose, "FrameTransform": lambda one: _transforms([one]),
    "FrameTransforms": lambda one: _transforms(one["transforms"])}
