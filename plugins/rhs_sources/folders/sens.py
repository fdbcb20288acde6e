"""ScanNet's scans as they are given out, .sens: colour (JPEG), depth and poses of each view in one file.

Dai et al., "ScanNet", CVPR 2017; SensReader/python/SensorData.py of its repository tells the layout (version 4): a header
with the 4x4 intrinsics and extrinsics of colour and of depth, compressions, sizes and steps of depth in a metre; then, a
view after the other, world_from_camera (optical axes, -inf where it was lost), two stamps in microseconds, two lengths and
the images. Colour is made as small as depth; depth of a camera elsewhere is carried to it.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse
from rhs.api.pictures import HEAD_BYTES, check_size

from ..replay_cameras import check_pose, chosen_camera
from ..replay_images import UnreadableImage, check_depth, metres, resized, shrunk
from ..replay_mounts import placed_camera
from ..replay_register import DepthCamera
from ..replay_tum import Recording
from .views import Listed, led, moved, truth_of

SUFFIX, VERSION, RATE_HZ = ".sens", 4, 30.0
NAME_BYTES = 1000  # at most, of a sensor
ZLIB, RAW = 1, 0  # compressions of depth
SAME = 0.01  # of the width: intrinsics that differ by less are of one camera


class View(NamedTuple):
    """Where a view lies in the file: its pose, stamp in microseconds, and (offset, length) of colour and depth."""

    pose: np.ndarray
    stamp_us: int
    color: tuple[int, int]
    depth: tuple[int, int]


def is_sens(path: Path) -> bool:
    return _file(path) is not None


def open_sens(path: Path, settings) -> Recording:
    """The views of a .sens file, or of the only one in a folder. Raises ConfigError."""
    file = _file(path)
    if file is None:
        raise ConfigError(f"{path}: no .sens file")
    matrices, packed, sizes, steps, expected, views = _checked(file)
    camera, beside = _cameras(file, matrices, sizes, settings)
    scale = settings.depth_scale or steps
    stamps = np.array([view.stamp_us for view in views]) * 1e-6
    timed = len(stamps) > 1 and bool((np.diff(stamps) > 0.0).all()) and not settings.rate_hz
    stamps = stamps if timed else np.arange(len(views)) / (settings.rate_hz or RATE_HZ)

    def deep(i: int, max_depth_m: float) -> np.ndarray:
        where = f"{file.name}: depth of view {i}"
        shown = _depth(_bytes(file, views[i].depth), sizes[1], where, packed=packed)
        return metres(shown, scale=scale, max_depth_m=max_depth_m, where=where)

    def read(i: int, before: int | None) -> dict[str, Any]:
        image = _color(_bytes(file, views[i].color), sizes[0], f"{file.name}: colour of view {i}")
        seen = deep(i, settings.max_depth_m)
        return {"image": image if sizes[0] == sizes[1] else shrunk(image, sizes[1]),
                "depth": seen if beside is None else beside.registered(seen, camera)}

    check_depth(deep(0, np.inf), scale=scale, where=file.name, typed=bool(settings.depth_scale))
    read(0, None)
    true, counts = truth_of(None, settings, [str(i) for i in range(len(views))], untimed=not timed)
    camera_from_body = inverse(camera.body_from_camera)

    def pose(i: int) -> np.ndarray | None:
        if settings.truth:
            return moved(true(i, float(stamps[i])), camera_from_body)
        own = views[i].pose
        return moved(check_pose(own, f"{file.name}: view {i}") if np.isfinite(own).all() else None, camera_from_body)

    listed = Listed(str(file), stamps, read, camera, frozenset({"image", "gray", "depth"}), pose, counts,
                    timed=timed or bool(settings.rate_hz))
    recording = led(listed, settings)
    if len(views) < expected:
        recording.lost.append(f"{file.name} is cut: it holds {len(views)} of {expected} views")
    return recording


def _checked(file: Path) -> tuple:
    """(matrices, whether depth is packed, sizes (width, height), steps a metre, views said, views that are there)."""
    try:
        (matrices, kinds, sizes, steps, expected), views = _index(file)
    except (struct.error, ValueError) as error:
        raise ConfigError(f"{file}: cannot be read as ScanNet's .sens ({error}); expected version {VERSION}") from None
    if not views or kinds[1] not in (ZLIB, RAW) or not steps > 0.0:
        raise ConfigError(f"{file}: found {len(views)} whole views, depth of compression {kinds[1]}, {steps:g} steps in a "
                          "metre; expected depth packed by zlib (1) or raw (0)")
    return matrices, kinds[1] == ZLIB, sizes, steps, expected, views


def _cameras(file: Path, matrices: list[np.ndarray], sizes: tuple, settings) -> tuple[Camera, DepthCamera | None]:
    """Of colour, at the size of depth, and of depth where that is another."""
    color, depth = (Camera(width, height, m[0, 0], m[1, 1], m[0, 2], m[1, 2]) for m, (width, height) in
                    zip((matrices[0], matrices[2]), sizes, strict=True))
    camera = resized(chosen_camera(settings.camera, sizes[0], recorded=color, where=str(file)), sizes[1])
    apart = inverse(check_pose(matrices[1], f"{file}: colour")) @ check_pose(matrices[3], f"{file}: depth")
    near = np.allclose([camera.fx, camera.fy, camera.cx, camera.cy], [depth.fx, depth.fy, depth.cx, depth.cy],
                       atol=SAME * depth.width)
    one = near and np.allclose(apart, np.eye(4), atol=1e-4)
    return placed_camera(camera, settings), None if one else DepthCamera(depth.fx, depth.fy, depth.cx, depth.cy, apart)


def _color(packed: bytes, size: tuple[int, int], where: str) -> np.ndarray:
    check_size(packed[:HEAD_BYTES], where)
    image = cv2.imdecode(np.frombuffer(packed, np.uint8), cv2.IMREAD_COLOR_RGB) if packed else None
    if image is None or image.shape[1::-1] != size:
        raise UnreadableImage(f"{where} is no JPEG or PNG of {size[0]}x{size[1]} pixels")
    return image


def _depth(raw: bytes, size: tuple[int, int], where: str, *, packed: bool) -> np.ndarray:
    """(height, width) steps of depth."""
    try:
        raw = zlib.decompressobj().decompress(raw, 2 * size[0] * size[1] + 1) if packed else raw
        return np.frombuffer(raw, "<u2").reshape(size[::-1])
    except (zlib.error, ValueError) as error:
        raise UnreadableImage(f"{where}: {error}") from None


def _file(path: Path) -> Path | None:
    """The file, or the only one of that kind in a folder."""
    if path.is_dir():
        found = list(path.glob(f"[!.]*{SUFFIX}"))
        return found[0] if len(found) == 1 else None
    return path if path.suffix.lower() == SUFFIX else None


def _bytes(file: Path, at: tuple[int, int]) -> bytes:
    with file.open("rb") as opened:
        opened.seek(at[0])
        return opened.read(at[1])


def _index(file: Path) -> tuple[tuple, list[View]]:
    """(matrices, compressions, sizes (width, height), steps of depth, views said), and the views that are there whole."""
    end = file.stat().st_size
    with file.open("rb") as opened:
        def take(form: str) -> tuple:
            return struct.unpack(f"<{form}", opened.read(struct.calcsize(f"<{form}")))

        version, length = take("IQ")
        if version != VERSION or length > NAME_BYTES:
            raise ValueError(f"found version {version}")
        opened.seek(length, 1)
        matrices = [np.array(take("16f")).reshape(4, 4) for _ in range(4)]
        kinds, (width, height, deep_width, deep_height), (steps, expected) = take("2i"), take("4I"), take("fQ")
        views: list[View] = []
        while len(views) < expected and opened.tell() + 96 <= end:
            pose, (stamp_us, _, color, depth) = np.array(take("16f")).reshape(4, 4), take("4Q")
            at = opened.tell()
            if at + color + depth > end:
                break
            views.append(View(pose, stamp_us, (at, color), (at + color, depth)))
            opened.seek(color + depth, 1)
    return (matrices, kinds, ((width, height), (deep_width, deep_height)), steps, expected), views
