"""A run as MCAP (ROS 2 messages), written while it happens.

Written straight to its final name: a log that is cut by a crash is worth having, and rhs.mcap_scan reads it up to its
last whole chunk. All that an estimator was given is stored without loss, so that a replay gives the same estimates.

Frames: map -> odom -> body -> camera, and map -> body_truth.
"""

from __future__ import annotations

import dataclasses
import json
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.geometry import Camera, inverse
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Capture, Observation, Step, Twist
from rhs.base.errors import ConfigError

from . import ros
from .mcap_file import McapWriter
from .reader import EXTRA, LEVELS, PARTS, STEP, WITH_IMAGES
from .reader import read as read

# One chunk is what a crash costs: a few views with images, a few dozen without.
CHUNK_BYTES = {"full": 1 << 20, "jpeg": 1 << 20, "light": 1 << 16}
JPEG_QUALITY = 95
# Bytes a pixel of what a view holds, measured: 684 views of the simulator's `square`, of `square_small` 249.
PACKED = {"full": {"image": 1.9, "right_image": 1.9, "depth": 0.9}, "jpeg": {"image": 0.4, "right_image": 1.9, "depth": 0.9}}


class Recorder:
    """Takes steps and maps, leaves a recording.

    level: `full` (all), `jpeg` (all, colour with loss), `light` (no images, depth or clouds) or `off` (no file). Raises
    RecordingError when the disk refuses.
    """

    def __init__(self, path: Path, level: str, camera: Camera, world_facts: Any = None, *,
                 config: dict[str, Any] | None = None, timed: bool = True) -> None:
        """timed: as in `Source`, whether somebody says when the views were taken."""
        if level not in LEVELS:
            raise ConfigError(f"recording={level} is not one of {', '.join(LEVELS)}")
        self._level, self._camera = level, camera
        self._odom_from_body = np.eye(4)
        self._drawn_path: object = None
        self._stamp_ns = 0
        self._writer = None if level == "off" else McapWriter(path, CHUNK_BYTES[level])
        if self._writer is not None:
            self._writer.note("rhs", head_note(camera, world_facts, config=config, level=level, timed=timed))

    def step(self, step: Step) -> None:
        """Append all that one step knows. /rhs/step comes first: it says which parts of the view follow."""
        if self._writer is None:
            return
        self._stamp_ns = ros.nanoseconds(step.stamp_s)
        if self._writer.empty:
            self._put("/tf_static", ros.transforms(self._stamp_ns, [("body", "camera", self._camera.body_from_camera)]))
        put_view(self._writer, self._camera, step.observation, plain=step_to_plain(step),
                 images=self._level in WITH_IMAGES, jpeg=JPEG_QUALITY if self._level == "jpeg" else 0)
        self._put_rest(step, self._stamp_ns)
        self._writer.flush()

    def map(self, grid: OccupancyGrid, stamp_s: float) -> None:
        """Append the map as it is now."""
        if self._writer is None:
            return
        self._stamp_ns = ros.nanoseconds(stamp_s)
        self._put("/map", ros.occupancy_grid(grid, self._stamp_ns, "map"))

    def close(self, status: str = "ok", reason: str = "") -> None:
        """Write the index. A failed run's recording is closed too, and says so."""
        if self._writer is not None:
            self._writer.note("rhs.end", {"status": status, "reason": reason})
            self._writer.close()

    def _put(self, topic: str, message: Any) -> None:
        if self._writer is not None:
            self._writer.put(topic, message, self._stamp_ns)

    def _put_rest(self, step: Step, t: int) -> None:
        """Readings and estimates, for viewers."""
        if step.scan is not None:
            self._put("/scan", ros.laser_scan(step.scan, t, "body"))
        if step.observation.wheel is not None:
            self._put("/wheel", ros.travel(step.observation.wheel, t, "body"))
        if step.command is not None:
            self._put("/command", ros.twist(step.command, t, "body"))
        belief, motion = step.belief, step.motion
        self._odom_from_body = self._odom_from_body @ motion.previous_from_body
        edges = [("map", "odom", belief.map_from_body @ inverse(self._odom_from_body)),
                 ("odom", "body", self._odom_from_body)]
        if step.truth is not None:
            edges.append(("map", "body_truth", step.truth))
            self._put("/truth", ros.pose_stamped(step.truth, t, "map"))
        self._put("/tf", ros.transforms(t, edges))
        self._put("/odom", ros.odometry(self._odom_from_body, motion.covariance, t, frame="odom", child="body"))
        self._put("/belief", ros.pose_with_covariance_stamped(belief.map_from_body, belief.covariance, t, frame="map"))
        if step.path is not None and step.path is not self._drawn_path:
            self._drawn_path = step.path
            self._put("/path", ros.path(step.path.points_m, t, "map"))
            self._put("/path_points", ros.path_cloud(step.path.points_m, t, "map"))


def bytes_a_view(level: str, camera: Camera, provides: frozenset[str]) -> float:
    """About what the images of a view take in a recording of that level. provides: what the parts hand on."""
    packed = PACKED.get(level, {})
    return camera.width * camera.height * sum(packed[word] for word in packed if word in provides)


def head_note(camera: Camera, world_facts: Any, *, config: dict[str, Any] | None, level: str,
              timed: bool = True) -> dict[str, str]:
    """The metadata record `rhs` at the beginning of a recording."""
    facts = dataclasses.asdict(world_facts) if dataclasses.is_dataclass(world_facts) else world_facts or {}  # type: ignore
    return {"camera": _json(camera_to_plain(camera)), "world": _json(facts),
            "config": _json(config or {}), "level": level} | ({} if timed else {"timed": "false"})


def camera_to_plain(camera: Camera) -> dict[str, Any]:
    """The camera as JSON can hold it, exactly."""
    plain = {f.name: getattr(camera, f.name) for f in dataclasses.fields(camera)}
    plain["body_from_camera"] = camera.body_from_camera.tolist()
    plain["distortion"] = [float(v) for v in camera.distortion]
    return {name: float(v) if isinstance(v, np.floating) else v for name, v in plain.items()}


def put_view(writer: McapWriter, camera: Camera, seen: Observation | Capture, *, plain: dict[str, Any],
             images: bool, jpeg: int = 0) -> None:
    """All that a sensor reported at one instant, without loss; `plain` goes first and says which parts follow. jpeg: quality
    of the colour image in per cent, 0: without loss."""
    t = ros.nanoseconds(seen.stamp_s)
    image, depth = (seen.image, seen.depth) if images else (None, None)
    parts = {"image": image, "depth": depth, "scan": seen.scan}
    holds = [name for name in PARTS if parts[name] is not None]
    extras = {name: np.asarray(array) for name, array in sorted(seen.extras.items())} if images else {}
    kinds = {name: [array.dtype.str, list(array.shape)] for name, array in extras.items()}
    writer.put(STEP, ros.text(_json(plain | {"holds": holds} | ({"extras": kinds} if kinds else {}))), t)
    if image is not None or depth is not None:
        writer.put("/camera/camera_info", ros.camera_info(camera, t, "camera"), t)
    if image is not None:
        writer.put(PARTS["image"], ros.compressed_image(image, t, "camera", jpeg=jpeg), t)
    if depth is not None:
        writer.put(PARTS["depth"], ros.depth_image(depth, t, "camera"), t)
        writer.put("/cloud", ros.depth_cloud(camera, depth, image, t, frame="camera"), t)
    if seen.scan is not None:
        writer.put(PARTS["scan"], ros.scan_cloud(seen.scan, t, "body"), t)
    for name, array in extras.items():
        writer.put(EXTRA + name, ros.raw_array(array), t)


def view_to_plain(seen: Observation | Capture, wheel: np.ndarray | None, truth: np.ndarray | None) -> dict[str, Any]:
    """What the ROS messages of a view cannot hold exactly: the full stamp, readings, the true pose."""
    scan = seen.scan
    return {
        "index": seen.index, "stamp_s": float(seen.stamp_s), "told": _twist(seen.command),
        "wheel": None if wheel is None else [float(v) for v in wheel],
        "scan": None if scan is None else {"max_range_m": float(scan.max_range_m),
                                           "origin_xy_m": [float(v) for v in scan.origin_xy_m]},
        "truth": None if truth is None else truth.tolist(),
    }


def step_to_plain(step: Step) -> dict[str, Any]:
    """The view, and beside it statuses, reasons and the believed pose."""
    return view_to_plain(step.observation, step.observation.wheel, step.truth) | {
        "step": step.index, "phase": step.phase, "mission": step.mission, "event": step.event,
        "motion": str(step.motion.status), "reason": step.motion.reason, "belief": str(step.belief.status),
        "probability": float(step.belief.probability), "map_from_body": step.belief.map_from_body.tolist(),
        "command": _twist(step.command), "clearance_m": float(step.clearance_m), "collided": bool(step.collided),
    }


def _twist(command: Twist | None) -> list[float] | None:
    if command is None:
        return None
    return [float(command.forward_mps), float(command.turn_radps), float(command.duration_s)]


def _json(value: Any) -> str:
    """A text of plain values, and of numbers and arrays of NumPy as such."""
    return json.dumps(value, default=methodcaller("tolist"))
