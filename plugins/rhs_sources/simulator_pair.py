"""The second camera of a simulated pair: like the first, so far to its right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rhs.api.geometry import Camera, inverse, se3
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers

EXTRAS = frozenset({RIGHT_IMAGE, RIGHT_CAMERA})
Look = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class SecondCamera:
    """Looks along the first camera from `baseline_m` to the right of it."""

    def __init__(self, camera: Camera, baseline_m: float) -> None:
        left_from_right = se3(np.eye(3), np.array([baseline_m, 0.0, 0.0]))
        there = camera.body_from_camera @ left_from_right
        self._numbers = camera_numbers(replace(camera, body_from_camera=there))
        self._body_from_there = there @ inverse(camera.body_from_camera)  # a body from which the first camera sees the same

    def extras(self, look: Look, world_from_body: np.ndarray) -> dict[str, np.ndarray]:
        """What it sees, and which camera it is. look: what the first camera sees from a body's pose."""
        image, _ = look(world_from_body @ self._body_from_there)
        image.flags.writeable = False
        return {RIGHT_IMAGE: image, RIGHT_CAMERA: self._numbers}
