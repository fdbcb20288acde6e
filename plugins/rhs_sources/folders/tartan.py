"""TartanAir: image_left/000000_left.png with depth_left/000000_left_depth.npy and pose_left.txt; in its second version
lcam_front in the place of left, and depth as floats of four bytes in the channels of a PNG.

Wang et al., "TartanAir: a dataset to push the limits of visual SLAM", IROS 2020; https://tartanair.org/modalities.html.
Cameras see 90 degrees; the right one stands 0.25 m beside the left. Poses, a line a view, are of the camera with its axes
ahead, right and down, in a world whose z points down; here that world is turned so that z points up.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse, rotation_of_quaternion, se3
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers

from ..replay_cameras import chosen_camera
from ..replay_images import check_pair, read_color, read_depth
from ..replay_mounts import placed_camera
from ..replay_stamps import number_of, rows
from ..replay_tum import Recording
from .poses import Poses
from .views import Listed, led, moved, numbered, truth_of

SIDES = {"left": "right", "lcam_front": "rcam_front"}
BASELINE_M = 0.25
RATE_HZ = 10.0
UP_FROM_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
AHEAD_FROM_OPTICAL = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # from right, down, ahead


def is_tartan(path: Path) -> bool:
    return path.is_dir() and any(_files(path, "image", side) for side in SIDES)


def open_tartan(path: Path, settings) -> Recording:
    """The views of the left camera: image, depth where there is any, and with source.stereo the right image. Raises
    ConfigError."""
    side = next((side for side in SIDES if _files(path, "image", side)), "left")
    images, depths = _files(path, "image", side), _files(path, "depth", side)
    if not images:
        raise ConfigError(f"{path}: no image_left/000000_left.png or image_lcam_front/000000_lcam_front.png")
    right = _files(path, "image", SIDES[side]) if settings.stereo else {}
    if settings.stereo and not right:
        raise ConfigError(f"source.stereo=true: {path} holds no image_{SIDES[side]}; leave it out")
    depths = {} if settings.depth_topic == "none" else depths
    numbers = [n for n in images if (not depths or n in depths) and (not right or n in right)]
    if not numbers:
        raise ConfigError(f"{path}: {len(images)} images and {len(depths)} of depth, no two with one number; type "
                          "source.depth_topic=none to go without depth")
    height, width = read_color(images[numbers[0]]).shape[:2]
    seen = Camera(width, height, 0.5 * width, 0.5 * width, 0.5 * width, 0.5 * height)
    camera = placed_camera(chosen_camera(settings.camera, (width, height), recorded=seen, where=str(path)), settings)
    beside = {}
    if right:
        aside = se3(np.eye(3), np.array([BASELINE_M, 0.0, 0.0]))
        beside[RIGHT_CAMERA] = camera_numbers(replace(camera, body_from_camera=camera.body_from_camera @ aside))
    true, counts = truth_of(None, settings)
    if not settings.truth:
        poses = _true(path / f"pose_{side}.txt")
        true = lambda number, stamp_s: poses.get(number)  # noqa: E731
    stamps = np.array(numbers) / (settings.rate_hz or RATE_HZ)

    def read(i: int, before: int | None) -> dict[str, Any]:
        number = numbers[i]
        image = read_color(images[number])
        extras = beside | ({RIGHT_IMAGE: read_color(right[number])} if right else {})
        if not depths:
            return {"image": image, "extras": extras}
        depth = read_depth(depths[number], scale=settings.depth_scale or 1.0, typed=bool(settings.depth_scale),
                           max_depth_m=settings.max_depth_m, packed=True)
        check_pair(image, depth, images[number].name)
        return {"image": image, "extras": extras, "depth": depth}

    def pose(i: int) -> np.ndarray | None:
        return moved(true(numbers[i], float(stamps[i])), inverse(camera.body_from_camera))

    provides = {"image", "gray"} | ({"depth"} if depths else set()) | ({RIGHT_IMAGE, RIGHT_CAMERA} if right else set())
    rejected = counts + Counter(unpaired=len(images) - len(numbers))
    return led(Listed(str(path), stamps, read, camera, frozenset(provides), pose, rejected,
                      timed=bool(settings.rate_hz)), settings)


def _files(path: Path, kind: str, side: str) -> dict[int, Path]:
    """Number -> file of image_left/000012_left.png, depth_left/000012_left_depth.npy or .png."""
    tail = f"_{side}" if kind == "image" else f"_{side}_{kind}"
    found = (file for file in path.glob(f"{kind}_{side}/*{tail}.*") if file.suffix in (".png", ".npy"))
    return {int(number): file for number, file in numbered(found, tail)}


def _true(file: Path) -> Poses:
    """World_from_camera, optical axes, by line; empty without the file."""
    out: Poses = {}
    for k, (number, words) in enumerate(rows(file) if file.is_file() else ()):
        where = f"{file.name}:{number}"
        if len(words) != 7:
            raise ConfigError(f"{where}: found {len(words)} columns; expected tx ty tz qx qy qz qw")
        values = np.array([number_of(word, where) for word in words])
        try:
            turn = rotation_of_quaternion(values[3:]) if np.all(np.isfinite(values)) else None
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from None
        out[k] = None if turn is None else UP_FROM_DOWN @ se3(turn, values[:3]) @ AHEAD_FROM_OPTICAL
    return out
