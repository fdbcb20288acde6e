"""Lenses of other models than OpenCV's, as the rational one that follows them over all of the image.

Fisheyes by their angles: theta (1 + k1 theta^2 + .. + k4 theta^8) (Kannala and Brandt, PAMI 2006; `equidistant` in Kalibr
and ROS); FOV: atan(2 r tan(w / 2)) / w (Devernay and Faugeras, 2001; PTAM, DSO). What stretches the middle of the image is
taken into the focal length. Seen as far as 75 degrees from the middle both are followed to less than a twentieth of a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rhs.api.distortion import distorted
from rhs.api.geometry import Camera

ANGLES = ("equidistant", "fisheye", "opencv_fisheye", "kannala_brandt", "kannalabrandt", "kannala_brandt4",
          "kannalabrandt8", "kb4")
FOV = ("fov", "atan")
MODELS = (*ANGLES, *FOV)
MOST_DEG = 75.0  # from the middle; further out the rational model does not follow
OFF_PX = 0.05
ROUNDS = 4  # of least squares, weighted by the denominator of the one before (Sanathanan and Koerner, 1963)


def with_lens(camera: Camera, model: str, numbers: Sequence[float]) -> Camera:
    """The camera (pinhole) with a lens of one of MODELS. Raises ValueError where it sees further than is followed."""
    if model in FOV and not numbers[0]:
        return camera
    wide = np.tan(np.linspace(0.0, np.radians(MOST_DEG), 2000)[1:])  # radii in the plane z = 1
    if model in FOV:
        stretch = 2.0 * np.tan(0.5 * numbers[0]) / numbers[0]
        bent = np.arctan(stretch * numbers[0] * wide) / numbers[0]
    else:
        stretch, angle = 1.0, np.arctan(wide)
        bent = angle * np.polyval([*reversed((*numbers, 0.0, 0.0, 0.0, 0.0)[:4]), 1.0], angle**2)
    corners = [((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy) for x in (0, camera.width - 1)
               for y in (0, camera.height - 1)]
    seen = int(np.searchsorted(np.maximum.accumulate(bent), max(np.hypot(x, y) for x, y in corners))) + 1
    if seen >= len(wide) or (np.diff(bent[:seen]) <= 0.0).any():
        raise ValueError(f"a lens of the model {model} that sees further than {MOST_DEG:g} degrees from its middle; "
                         "undistort the images (cv2.fisheye.undistortImage) and type source.camera=[fx,fy,cx,cy]")
    lens, off = _rational(wide[:seen], bent[:seen] / stretch)
    if off * stretch * camera.fx > OFF_PX:
        raise ValueError(f"a lens of the model {model} that OpenCV's does not follow (to {off * stretch * camera.fx:.2g} "
                         "pixels); undistort the images and type source.camera=[fx,fy,cx,cy]")
    return replace(camera, fx=stretch * camera.fx, fy=stretch * camera.fy, distortion=lens)


def _rational(ideal: np.ndarray, bent: np.ndarray) -> tuple[tuple[float, ...], float]:
    """(k1, k2, 0, 0, k3, .. k6) of the rational model that puts radii (N,) where a lens does, and how far off at most."""
    powers = np.stack([ideal**2, ideal**4, ideal**6], axis=1)
    share, weights = (bent / ideal)[:, None], np.ones(len(ideal))
    for _ in range(ROUNDS):
        table = np.hstack([powers, -share * powers]) * (ideal * weights)[:, None]
        scale = np.linalg.norm(table, axis=0)
        k = np.linalg.lstsq(table / scale, (share[:, 0] - 1.0) * ideal * weights, rcond=1e-10)[0] / scale
        weights = 1.0 / np.maximum(np.abs(1.0 + powers @ k[3:]), 0.1)
    lens = tuple(float(v) for v in (k[0], k[1], 0.0, 0.0, *k[2:]))
    return lens, float(np.abs(distorted(ideal, np.zeros_like(ideal), lens)[0] - bent).max())
