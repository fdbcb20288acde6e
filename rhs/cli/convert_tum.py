"""Between MCAP and the text and PNG files of the TUM RGB-D benchmark."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import SourceContext
from rhs.api.files import write_whole
from rhs.api.geometry import rotation_of_quaternion, se3
from rhs.api.records import Capture
from rhs.api.trajectory import Trajectory, read_tum, tum_line, write_tum
from rhs.base.errors import ConfigError, RecordingError
from rhs.recording import ros
from rhs.recording.mcap_file import McapWriter
from rhs.recording.mcap_scan import Report
from rhs.recording.reader import read, read_head
from rhs.recording.writer import camera_to_plain, head_note, put_view, view_to_plain

DEPTH_STEPS_PER_M = 5000.0
POSE_TOPICS = {"geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped", "nav_msgs/msg/Odometry"}


def to_folder(source: Path, target: Path) -> tuple[Report, int]:
    """Write a TUM RGB-D folder of the views of a recording by rhs. The folder appears only when it is complete.

    groundtruth.txt holds true *camera* poses, as in the benchmark; camera.json the camera exactly. Depth is rounded to
    0.2 mm and unknown above 13.1 m.
    """
    head = read_head(source)
    if head is None or not head.has_images:
        raise RecordingError(f"{source} holds no images as rhs records them; expected a run with recording=full")
    partial = target.with_name(f"{target.name}.tmp-{os.getpid()}")
    reading = read(source)
    try:
        for name in ("rgb", "depth"):
            (partial / name).mkdir(parents=True)
        count = _write_views(reading, partial, head.camera.body_from_camera)
        (partial / "camera.json").write_text(json.dumps(camera_to_plain(head.camera), indent=1) + "\n")
        os.replace(partial, target)
    except OSError as error:
        raise RecordingError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return reading.report, count


def _write_views(reading: Any, folder: Path, body_from_camera: np.ndarray) -> int:
    count = 0
    with ((folder / "rgb.txt").open("w") as rgb, (folder / "depth.txt").open("w") as depth,
          (folder / "groundtruth.txt").open("w") as truth, (folder / "estimate.tum").open("w") as estimate):
        for view in reading.views():
            stamp_s, name = view.capture.stamp_s, f"{view.capture.stamp_s:.9f}.png"
            if view.capture.image is not None:
                _write_png(folder / "rgb" / name, view.capture.image[:, :, ::-1])
                rgb.write(f"{stamp_s:.9f} rgb/{name}\n")
            if view.capture.depth is not None:
                _write_png(folder / "depth" / name, depth_steps(view.capture.depth))
                depth.write(f"{stamp_s:.9f} depth/{name}\n")
            if view.truth is not None:
                truth.write(tum_line(stamp_s, view.truth @ body_from_camera))
            if view.plain.get("map_from_body") is not None:
                estimate.write(tum_line(stamp_s, np.array(view.plain["map_from_body"])))
            count += 1
    for name in ("groundtruth.txt", "estimate.tum"):
        if not (folder / name).stat().st_size:
            (folder / name).unlink()
    return count


def depth_steps(depth_m: np.ndarray) -> np.ndarray:
    """(H, W) uint16 fifths of a millimetre, 0 unknown or too far."""
    steps = np.rint(np.nan_to_num(depth_m, nan=0.0, posinf=0.0) * DEPTH_STEPS_PER_M)
    return np.where((steps > 0) & (steps < 65535), steps, 0).astype(np.uint16)


def _write_png(path: Path, image: np.ndarray) -> None:
    import cv2

    if not cv2.imwrite(str(path), image):
        raise RecordingError(f"cannot write {path}")


def to_trajectory(source: Path, target: Path, topic: str) -> tuple[Report, int]:
    """The poses of a topic (PoseStamped, PoseWithCovarianceStamped, Odometry) of any MCAP file, as TUM lines."""
    reading, stamps, poses, seen = read(source), [], [], set()
    for message in reading:
        kind = message.channel.schema.name
        seen |= {message.channel.topic} if kind in POSE_TOPICS else set()
        if message.channel.topic == topic and kind in POSE_TOPICS:
            decoded = ros.deserialize(message.data, kind)
            stamps.append(decoded.header.stamp.sec + decoded.header.stamp.nanosec / 10**9)
            pose = decoded.pose.pose if hasattr(decoded.pose, "pose") else decoded.pose
            p, q = pose.position, pose.orientation
            poses.append(se3(rotation_of_quaternion(np.array([q.x, q.y, q.z, q.w])), np.array([p.x, p.y, p.z])))
    if not poses:
        known = f"poses are on {', '.join(sorted(seen))}" if seen else "no topic holds poses"
        raise ConfigError(f"{source} has no poses on {topic}; {known}; type --topic TOPIC")
    write_tum(target, Trajectory(np.array(stamps), np.array(poses)))
    return reading.report, len(poses)


def from_trajectory(source: Path, target: Path) -> int:
    """A TUM trajectory as PoseStamped on /belief and tf map -> body."""
    trajectory = read_tum(source)
    if not len(trajectory):
        raise RecordingError(f"{source} holds no pose")

    def write(path: Path) -> None:
        writer = McapWriter(path)
        for stamp_s, pose in zip(trajectory.stamps_s, trajectory.poses, strict=True):
            t = ros.nanoseconds(float(stamp_s))
            writer.put("/belief", ros.pose_stamped(pose, t, "map"), t)
            writer.put("/tf", ros.transforms(t, [("map", "body", pose)]), t)
        writer.close()

    write_whole(target, write)
    return len(trajectory)


def from_recording(source: Path, target: Path, settings: Sequence[str]) -> int:
    """Whatever `source=replay` reads, as a recording that replays to the same views."""
    replay = _replay(source, settings)
    count = 0

    def write(path: Path) -> None:
        nonlocal count
        writer = McapWriter(path)
        writer.note("rhs", head_note(replay.camera, replay.facts, config={"converted_from": source.name}, level="full",
                                      timed=replay.timed))
        while (capture := replay.lead()) is not None:
            _put(writer, replay, capture)
            count += 1
        writer.close()

    try:
        write_whole(target, write)
    finally:
        replay.close()
    return count


def _replay(source: Path, settings: Sequence[str]) -> Any:
    """The replay source on a path, by its registered name, with settings from the command line."""
    import yaml

    from rhs.config.registry import load

    chosen: dict[str, Any] = {"path": str(source)}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise ConfigError(f"{setting!r} is not key=value, such as camera=tum_fr1")
        chosen[key.removeprefix("source.")] = yaml.safe_load(value)
    cls = load("source", "replay")
    known = sorted(item.name for item in dataclasses.fields(cls))
    for key in chosen:
        if key not in known:
            raise ConfigError(f"source.{key}: source=replay has no such setting; it has {', '.join(known)}")
    return cls(**chosen).build(SourceContext(np.random.default_rng(0), None, source.parent))


def _put(writer: McapWriter, replay: Any, capture: Capture) -> None:
    """One view without any estimate: the same topics and the same JSON as a run's."""
    t, camera, truth = ros.nanoseconds(capture.stamp_s), replay.camera, replay.truth()
    if writer.empty:
        writer.put("/tf_static", ros.transforms(t, [("body", "camera", camera.body_from_camera)]), t)
    plain = view_to_plain(capture, capture.travel, truth) | {"phase": "survey"}
    put_view(writer, camera, capture, plain=plain, images=True)
    if capture.scan is not None:
        writer.put("/scan", ros.laser_scan(capture.scan, t, "body"), t)
    if truth is not None:
        writer.put("/truth", ros.pose_stamped(truth, t, "map"), t)
        writer.put("/tf", ros.transforms(t, [("map", "body", truth)]), t)
