"""Place databases as plain files: npz without pickle, written whole or not at all."""

from __future__ import annotations

import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from rhs.api.files import replacing
from rhs.api.geometry import Camera
from rhs.base.errors import RecordingError

from .place_memory import Memory

FORMAT = 1


def save(memory: Memory, path: Path) -> None:
    """Write a memory as plain arrays (npz without pickle)."""
    camera = memory.camera
    numbers = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, camera.skew]
    arrays = {name: getattr(memory, name) for name in _ARRAYS}
    with replacing(path, "wb") as file:
        np.savez_compressed(
            file, format=np.array(FORMAT), camera=np.array(numbers, float), **arrays,
            distortion=np.array(camera.distortion, float), body_from_camera=camera.body_from_camera,
        )  # fmt: skip


def load(path: Path) -> Memory:
    """Read a memory written by `save`. Raises RecordingError naming the file when it is not one."""
    try:
        with np.load(path, allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
        if int(data["format"]) != FORMAT:
            raise ValueError(f"format {int(data['format'])}, expected {FORMAT}")
        if "greys" not in data:  # written before views were kept as thumbnails
            data["greys"] = np.empty((len(data["poses"]), 0, 0), np.uint8)
        memory = Memory(**{name: data[name] for name in _ARRAYS}, camera=_camera_of(data))
        _check_sizes(memory)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error) as error:
        raise RecordingError(f"{path} is not a place database: {error}; write one with place_files.save") from error
    return memory


def _camera_of(data: dict[str, np.ndarray]) -> Camera:
    width, height, fx, fy, cx, cy, skew = data["camera"].tolist()
    distortion = tuple(data["distortion"].tolist())
    return Camera(int(width), int(height), fx, fy, cx, cy, skew, distortion, data["body_from_camera"])


_ARRAYS = ("poses", "indices", "starts", "pixels", "descriptors", "points", "greys")


def _check_sizes(memory: Memory) -> None:
    places, rows = len(memory.poses), len(memory.descriptors)
    steps = np.diff(memory.starts)
    if len(memory.starts) != places + 1 or memory.starts[0] != 0 or memory.starts[-1] != rows or np.any(steps < 0):
        raise ValueError("its rows do not add up")
    if len(memory.pixels) != rows or len(memory.points) != rows or not places == len(memory.indices) == len(memory.greys):
        raise ValueError("its arrays differ in length")
