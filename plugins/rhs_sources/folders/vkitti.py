"""Virtual KITTI 2: frames/rgb/Camera_0/rgb_00000.jpg, frames/depth/Camera_0, intrinsic.txt and extrinsic.txt.

Cabon et al., "Virtual KITTI 2", 2020. Depth in whole centimetres, 65535 is the sky; 10 views a second. The tables have a
line a frame and camera, below a header: fx fy cx cy, and camera_from_world (4x4, optical axes). Camera_0 alone is read.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse

from ..replay_cameras import chosen_camera
from ..replay_images import check_pair, read_color, read_depth
from ..replay_mounts import placed_camera
from ..replay_stamps import number_of, rows
from ..replay_tum import Recording
from .views import Listed, led, matrix34, moved, numbered, truth_of

CAMERA, RATE_HZ, DEPTH_SCALE = "Camera_0", 10.0, 100.0


def is_vkitti(path: Path) -> bool:
    return path.is_dir() and (_frames(path) / "rgb" / CAMERA).is_dir()


def open_vkitti(path: Path, settings) -> Recording:
    """The views of Camera_0: image, and depth where there is any. Raises ConfigError."""
    images, depths = (dict(numbered((_frames(path) / kind / CAMERA).glob("*.*"))) for kind in ("rgb", "depth"))
    depths = {} if settings.depth_topic == "none" else depths
    numbers = [number for number in images if not depths or number in depths]
    if not numbers:
        raise ConfigError(f"{path}: {len(images)} images and {len(depths)} of depth in {CAMERA}, no two with one number")
    height, width = read_color(images[numbers[0]]).shape[:2]
    said = _table(path, "intrinsic.txt", 4).get(int(numbers[0]))
    recorded = None if said is None else Camera(width, height, said[0], said[1], said[2], said[3])
    camera = placed_camera(chosen_camera(settings.camera, (width, height), recorded=recorded, where=str(path)), settings)
    true, counts = truth_of(None, settings)
    if not settings.truth:
        places = _table(path, "extrinsic.txt", 16)
        true = lambda k, _: inverse(matrix34(places[k][:12])) if k in places else None  # noqa: E731
    stamps = np.array([int(number) for number in numbers]) / (settings.rate_hz or RATE_HZ)

    def read(i: int, before: int | None) -> dict[str, Any]:
        image = read_color(images[numbers[i]])
        if not depths:
            return {"image": image}
        depth = read_depth(depths[numbers[i]], scale=settings.depth_scale or DEPTH_SCALE, max_depth_m=settings.max_depth_m,
                           typed=bool(settings.depth_scale))
        check_pair(image, depth, images[numbers[i]].name)
        return {"image": image, "depth": depth}

    def pose(i: int) -> np.ndarray | None:
        return moved(true(int(numbers[i]), float(stamps[i])), inverse(camera.body_from_camera))

    provides = frozenset({"image", "gray", *(["depth"] if depths else [])})
    return led(Listed(str(path), stamps, read, camera, provides, pose, counts + Counter(unpaired=len(images) - len(numbers)),
                      timed=bool(settings.rate_hz)), settings)


def _frames(path: Path) -> Path:
    return path / "frames" if (path / "frames").is_dir() else path


def _table(path: Path, name: str, count: int) -> dict[int, list[float]]:
    """Frame -> numbers of CAMERA in a table of the folder or the one above; empty without it."""
    file = next((file for file in (path / name, path.parent / name) if file.is_file()), None)
    out: dict[int, list[float]] = {}
    for number, words in rows(file)[1:] if file is not None else ():
        where = f"{name}:{number}"
        if len(words) != 2 + count:
            raise ConfigError(f"{where}: found {len(words)} columns; expected frame, camera and {count} numbers")
        if words[1] == CAMERA[-1]:
            out[int(number_of(words[0], where))] = [number_of(word, where) for word in words[2:]]
    return out
