"""Tracks: where the same points of the world were seen, view after view. All monocular filters eat these.

Tracks do not depend on the filter, so they can be saved once and replayed through any filter in seconds
(`python -m rhs_odometry`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from rhs.api.errors import RecordingError
from rhs.api.geometry import Camera
from rhs.api.records import Observation

FORMAT = 1
NO_TRAVEL = np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class TrackFrame:
    """The tracked points of one view.

    ids (N,) int64, unique, a number is never used for two points; pixels (N, 2) float64.
    command (3,): forward m, turn rad given since the previous view, and seconds; wheel (3,): dx m, dy m, dyaw rad
    by the encoders since then; NaN where none was given. stopped: something was in the way, and nobody knows how much of
    it was done.
    """

    stamp_s: float
    ids: np.ndarray
    pixels: np.ndarray
    command: np.ndarray = field(default_factory=NO_TRAVEL.copy)
    wheel: np.ndarray = field(default_factory=NO_TRAVEL.copy)
    stopped: bool = False


@dataclass(frozen=True, eq=False)
class Tracks:
    """A whole run: the camera, the start pose (x m, y m, yaw rad) in the map, one frame per view.

    truth (N, 4, 4): true map_from_body per view, NaN where unknown. Filters never get it; only the replay's report does.
    """

    camera: Camera
    start: np.ndarray
    frames: Sequence[TrackFrame]
    truth: np.ndarray


def travel_of(observation: Observation) -> tuple[np.ndarray, np.ndarray]:
    """(command, wheel) of an observation, in the form of TrackFrame."""
    given, command = NO_TRAVEL.copy(), observation.command
    if command is not None:
        given = np.array([command.forward_mps, command.turn_radps, 1.0]) * command.duration_s
    wheel = NO_TRAVEL.copy() if observation.wheel is None else np.asarray(observation.wheel, float)
    return given, wheel


def common(before: TrackFrame, after: TrackFrame) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (M, 2) and (M, 2) of the points seen in both frames."""
    _, i, j = np.intersect1d(before.ids, after.ids, assume_unique=True, return_indices=True)
    return before.pixels[i], after.pixels[j]


def save_tracks(path: Path, tracks: Tracks) -> None:
    """Write tracks as one compressed .npz; the name appears only when the file is complete."""
    c = tracks.camera
    intrinsics = {k: getattr(c, k) for k in ("width", "height", "fx", "fy", "cx", "cy", "skew")}
    head = json.dumps({"format": FORMAT, "camera": {**intrinsics, "distortion": list(c.distortion)}})
    partial = path.with_name(path.name + ".tmp-write.npz")
    np.savez_compressed(
        partial,
        head=np.frombuffer(head.encode(), np.uint8),
        body_from_camera=c.body_from_camera,
        start=tracks.start,
        truth=tracks.truth,
        stamps_s=np.array([f.stamp_s for f in tracks.frames]),
        counts=np.array([len(f.ids) for f in tracks.frames]),
        ids=np.concatenate([f.ids for f in tracks.frames]),
        pixels=np.concatenate([f.pixels for f in tracks.frames]).astype(np.float32),
        command=np.stack([f.command for f in tracks.frames]),
        wheel=np.stack([f.wheel for f in tracks.frames]),
    )
    partial.replace(path)


def load_tracks(path: Path) -> Tracks:
    """Read a file of save_tracks. Raises RecordingError when it is missing, broken or of another format."""
    try:
        with np.load(path, allow_pickle=False) as data:
            return _tracks_of({name: data[name] for name in data.files})
    except (OSError, KeyError, ValueError, EOFError, BadZipFile) as error:
        raise RecordingError(f"tracks {path} cannot be read ({error}); odometry.save_tracks=true leaves one") from None


def _tracks_of(data: dict[str, np.ndarray]) -> Tracks:
    head = json.loads(bytes(data["head"]).decode())
    if head["format"] != FORMAT:
        raise ValueError(f"format {head['format']}, this version reads {FORMAT}")
    camera = Camera(
        **{**head["camera"], "distortion": tuple(head["camera"]["distortion"])},
        body_from_camera=data["body_from_camera"],
    )
    ends = np.cumsum(data["counts"])
    frames = [
        TrackFrame(float(data["stamps_s"][i]), data["ids"][a:b], data["pixels"][a:b].astype(float), given, wheel)
        for i, (a, b, given, wheel) in enumerate(
            zip(ends - data["counts"], ends, data["command"], data["wheel"], strict=True)
        )
    ]
    return Tracks(camera, data["start"], frames, data["truth"])
