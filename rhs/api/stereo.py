"""The second camera of a stereo pair, as it travels beside its images.

A capture of two cameras has the extras `right_image` (H, W, 3) uint8, of the camera to the right of the first one, and
`right_camera`, the numbers of that camera: width, height, fx, fy, cx, cy, skew, the 16 of body_from_camera row by row, then
the lens's. The first camera is the source's. Neither image needs to be rectified.
"""

from __future__ import annotations

import numpy as np

from .geometry import Camera

RIGHT_IMAGE, RIGHT_CAMERA = "right_image", "right_camera"
_FIXED = 7 + 16


def camera_numbers(camera: Camera) -> np.ndarray:
    """(23 + K,) float64 of a camera whose lens has K numbers; read-only."""
    numbers = np.array([camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, camera.skew,
                        *camera.body_from_camera.ravel(), *camera.distortion], float)
    numbers.setflags(write=False)
    return numbers


def camera_of(numbers: np.ndarray) -> Camera:
    """The camera of such numbers. Raises ValueError where there are too few."""
    numbers = np.asarray(numbers, float)
    if numbers.ndim != 1 or len(numbers) < _FIXED:
        raise ValueError(f"{RIGHT_CAMERA} has the shape {numbers.shape}; expected ({_FIXED} + K,)")
    width, height, fx, fy, cx, cy, skew = (float(v) for v in numbers[:7])
    return Camera(int(width), int(height), fx, fy, cx, cy, skew, distortion=tuple(float(v) for v in numbers[_FIXED:]),
                  body_from_camera=numbers[7:_FIXED].reshape(4, 4).copy())
