"""KITTI odometry: a sequence's folder with image_2 (colour) or image_0 (grey), velodyne, times.txt and calib.txt.

Geiger, Lenz and Urtasun, "Are we ready for autonomous driving?", CVPR 2012. The images are rectified; P0 to P3 are 3x4
projections of points in the frame of camera 0, Tr takes points of the Velodyne there. The body sits at camera 0 and looks
along its axis; the true poses (poses.txt, ../../poses/NN.txt or `source.truth`) are camera 0's, a line a view.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, inverse, se3, transform
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers

from ..carmen.log import NO_CAMERA
from ..replay_cameras import check_pose
from ..replay_images import read_color
from ..replay_mounts import mount_of
from ..replay_stamps import in_file_order, number_of, rows
from ..replay_tum import Recording
from .pcd import read_cloud
from .views import At, Listed, led, matrix34, moved, numbered, truth_of

P = ("P0", "P1", "P2", "P3")
OPTICAL = se3(BODY_FROM_OPTICAL, np.zeros(3))


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive in either form (kitti_raw.py has the other): the folders of images, as P0 to P3 name them, and of clouds; the
    projections by these names, and Tr, of a file; stamps of views by their numbers, of the camera chosen (empty: the
    clouds'), and how many were repaired; truth() gives the poses of camera 0, and counts. timed: a file
    has the times."""

    path: Path
    cameras: dict[str, Path]
    clouds: Path
    calib: dict[str, list[float]]
    calib_file: str
    stamps: Callable[[str, list[int]], tuple[np.ndarray, Counter]]
    truth: Callable[[], tuple[At, Counter]]
    timed: bool = True


def is_kitti(path: Path) -> bool:
    return path.is_dir() and (path / "calib.txt").is_file() and any(
        (path / n).is_dir() for n in ("image_2", "image_0", "velodyne"))


def open_kitti(path: Path, settings) -> Recording:
    """The views of a sequence: image, cloud, and with source.stereo the right image. Raises ConfigError."""
    return drive(Drive(path, {name: path / f"image_{name[-1]}" for name in P}, path / "velodyne",
                       _calibration(path / "calib.txt"), "calib.txt", lambda name, numbers: _stamps(path, numbers, settings),
                       lambda: truth_of(_truth(path), settings), (path / "times.txt").is_file()), settings)


def drive(found: Drive, settings) -> Recording:
    """Its views: image, cloud, and with source.stereo the right image. Raises ConfigError."""
    name = next((n for n in ("P2", "P0") if found.cameras[n].is_dir()), "")
    second = {"P2": "P3", "P0": "P1", "": "P3"}[name]
    images = numbered(found.cameras[name].glob("*.png")) if name else []
    clouds = numbered(found.clouds.glob("*.bin"))
    if not images and not clouds:
        raise ConfigError(f"{found.path}: no numbered image in {found.cameras['P2']} or {found.cameras['P0']}, no cloud in "
                          f"{found.clouds}")
    right = found.cameras[second]
    if settings.stereo and not (images and right.is_dir()):
        raise ConfigError(f"source.stereo=true: {found.path} holds no {right.relative_to(found.path)}; leave it out")
    numbers = [int(float(n)) for n, _ in images or clouds]
    stamps, repaired = found.stamps(name, numbers)
    mount = mount_of(settings.camera_mount, "camera_mount")
    body_from_0 = OPTICAL if mount is None else mount @ OPTICAL
    camera = _camera(images[0][1], found, name, body_from_0, settings) if images else NO_CAMERA
    beside: dict[str, np.ndarray] = {}
    if settings.stereo:
        beside[RIGHT_CAMERA] = camera_numbers(_camera(images[0][1], found, second, body_from_0, settings))
    body_from_cloud = body_from_0 @ _velodyne(found) if clouds else None
    digits = len(clouds[0][0]) if clouds else 0
    true, counts = found.truth()

    def read(i: int, before: int | None) -> dict[str, Any]:
        extras = dict(beside)
        if body_from_cloud is not None:
            points = read_cloud(found.clouds / f"{numbers[i]:0{digits}d}.bin")[0].astype(float)
            extras["cloud"] = transform(body_from_cloud, points).astype(np.float32)
        if settings.stereo:
            extras[RIGHT_IMAGE] = read_color(right / images[i][1].name)
        return {"image": read_color(images[i][1]) if images else None, "extras": extras}

    def pose(i: int) -> np.ndarray | None:
        return moved(true(numbers[i], float(stamps[i])), inverse(body_from_0))

    provides = {word for word, there in (("image", images), ("gray", images), ("cloud", clouds),
                                         (RIGHT_IMAGE, beside), (RIGHT_CAMERA, beside)) if there}
    return led(Listed(str(found.path), stamps, read, camera, frozenset(provides), pose, counts, repaired,
                      found.timed or bool(settings.rate_hz)), settings)


def _velodyne(found: Drive) -> np.ndarray:
    """4x4: points of the Velodyne in the frame of camera 0."""
    if "Tr" not in found.calib:
        raise ConfigError(f"{found.calib_file}: velodyne is there but no Tr, its place beside the cameras; type "
                          f"source.path={found.clouds} to have the clouds alone")
    return check_pose(matrix34(found.calib["Tr"]), f"{found.calib_file}: Tr")


def _calibration(file: Path) -> dict[str, list[float]]:
    """Name -> 12 numbers of `P0: ...` lines."""
    out = {}
    for number, words in rows(file):
        where = f"{file.name}:{number}"
        if len(words) != 13 or not words[0].endswith(":"):
            raise ConfigError(f"{where}: found {len(words)} words; expected a name such as P0: and 12 numbers")
        out[words[0][:-1]] = [number_of(word, where) for word in words[1:]]
    return out


def _camera(first: Path, found: Drive, name: str, body_from_0: np.ndarray, settings) -> Camera:
    """The rectified camera K [I | t]: it sits at -t in the frame of camera 0."""
    if settings.camera != "auto":
        raise ConfigError(f"source.camera: {found.calib_file} says which camera it is; leave it out")
    if name not in found.calib:
        raise ConfigError(f"{found.calib_file}: no {name}; found {', '.join(found.calib) or 'nothing'}")
    projection = matrix34(found.calib[name])[:3]
    k = projection[:, :3]
    if not np.all(np.isfinite(projection)) or k[0, 0] <= 0 or k[1, 1] <= 0:
        raise ConfigError(f"{found.calib_file}: a projection without a focal length above 0; expected K [I | t]")
    offset = se3(np.eye(3), -np.linalg.solve(k, projection[:, 3]))
    height, width = read_color(first).shape[:2]
    return Camera(width, height, k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1], body_from_camera=body_from_0 @ offset)


def _stamps(path: Path, numbers: list[int], settings) -> tuple[np.ndarray, Counter]:
    """Seconds of the views by their numbers, lines of times.txt from 0; 10 a second, or source.rate_hz, without it."""
    if settings.rate_hz or not (path / "times.txt").is_file():
        return np.array(numbers) / (settings.rate_hz or 10.0), Counter()
    times = [number_of(words[0], f"times.txt:{line}") for line, words in rows(path / "times.txt")]
    if len(times) <= max(numbers):
        raise ConfigError(f"{path}: times.txt has {len(times)} lines but the last view is number {max(numbers)}")
    return in_file_order([times[n] for n in numbers], settings.max_jump_s)


def _truth(path: Path) -> Path | None:
    where = (path / "poses.txt", path.parent.parent / "poses" / f"{path.resolve().name}.txt")
    return next((file for file in where if file.is_file()), None)
