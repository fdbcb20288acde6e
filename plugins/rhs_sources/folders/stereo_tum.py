"""The second camera of ETH3D's SLAM recordings: rgb2 beside rgb, calibration2.txt and extrinsics_1_2.txt.

Schoeps, Sattler and Pollefeys, "BAD SLAM", CVPR 2019. Both images of a pair have one name; they are undistorted, not
rectified. extrinsics_1_2.txt holds the 3x4 matrix that takes points of the second camera to the first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers

from ..replay_images import UnreadableImage, read_color
from ..replay_stamps import number_of, rows
from .intrinsics import read_intrinsics
from .poses import rigid

FOLDER, CALIBRATION, PLACE = "rgb2", "calibration2.txt", "extrinsics_1_2.txt"


@dataclass(frozen=True, eq=False)
class Second:
    """Its intrinsics, 4x4 first_from_second, and the folder of its images."""

    camera: Camera
    place: np.ndarray
    folder: Path

    def beside(self, first: Camera) -> Camera:
        """The camera, placed beside the first."""
        return replace(self.camera, body_from_camera=first.body_from_camera @ self.place)

    def seen(self, first: Path, camera: Camera) -> dict[str, np.ndarray]:
        """Its image beside that of the first, and its numbers. Raises UnreadableImage."""
        image = read_color(self.folder / first.name)
        if image.shape[:2] != (camera.height, camera.width):
            raise UnreadableImage(f"{self.folder / first.name}: found {image.shape[1]}x{image.shape[0]} pixels; expected "
                                  f"{camera.width}x{camera.height}")
        return {RIGHT_IMAGE: image, RIGHT_CAMERA: camera_numbers(camera)}


def check_second(path: Path) -> None:
    """Refuse a folder without a second camera."""
    missing = [name for name in (FOLDER, CALIBRATION, PLACE) if not (path / name).exists()]
    if missing:
        raise ConfigError(f"source.stereo=true (sensor=stereo sets it): {path} holds no {missing[0]}; a second camera is "
                          f"read from {FOLDER}, {CALIBRATION} and {PLACE} (ETH3D); type sensor=rgbd, or sensor=mono")


def second_camera(path: Path, first: Path) -> Second:
    """The second camera of a folder, of whose first camera an image is given. Raises ConfigError."""
    height, width = read_color(path / FOLDER / first.name).shape[:2]
    camera = read_intrinsics(path / CALIBRATION, (width, height))
    numbers = [number_of(word, PLACE) for _, words in rows(path / PLACE) for word in words]
    return Second(camera, rigid(numbers, f"{path / PLACE}"), path / FOLDER)
