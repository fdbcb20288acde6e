"""Lenses of other models than OpenCV's, as the rational one that follows them over all of the image.

Fisheyes by their angles: theta (1 + k1 theta^2 + .. + k4 theta^8) (Kannala and Brandt, PAMI 2006; `equidistant` in Kalibr
and ROS); FOV: atan(2 r tan(w / 2)) / w (Devernay and Faugeras, 2001; PTAM, DSO). What stretches the middle of the image is
taken into the focal length. Seen as far as 75 degrees from the middle both are followed to less than a twentieth of a pixel;
of what sees further the middle is made a pinhole's image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np

from rhs.api.distortion import distorted
from rhs.api.geometry import Camera

ANGLES = ("equidistant", "fisheye", "opencv_fisheye", "kannala_brandt", "kannalabrandt", "kannala_brandt4",
          "kannalabrandt8", "kb4")
FOV = ("fov", "atan")
MODELS = (*ANGLES, *FOV)
FLAT_DEG = 60.0  # to each side of the middle, of a pinhole's view
MOST_DEG = 75.0  # from the middle; further out the rational model does not follow
OFF_PX = 0.05
ROUNDS = 4  # of least squares, weighted by the denominator of the one before (Sanathanan and Koerner, 1963)


@dataclass(frozen=True, eq=False)
class Flattened(Camera):
    """A pinhole camera whose images are yet to be made of those of a lens that sees too far aside for any model of OpenCV's:
    model and numbers as of `with_lens`, raw its fx, fy, cx, cy. Of its field FLAT_DEG to each side are kept at most."""

    model: str = ""
    numbers: tuple[float, ...] = ()
    raw: tuple[float, ...] = ()

    def flat(self, image: np.ndarray) -> np.ndarray:
        """(H, W, 3) uint8 as the pinhole camera sees it."""
        import cv2

        return np.asarray(cv2.remap(image, *_maps(self), cv2.INTER_LINEAR), np.uint8)

    def _numbers(self) -> tuple[object, ...]:
        return (*super()._numbers(), self.model, *self.numbers, *self.raw)

    def plain(self) -> Camera:
        """The pinhole camera."""
        return Camera(**{one.name: getattr(self, one.name) for one in fields(Camera)})


def with_lens(camera: Camera, model: str, numbers: Sequence[float]) -> Camera:
    """The camera (pinhole) with a lens of one of MODELS, of which OpenCV's model follows as much as is seen; else the
    Flattened one of its middle. Raises ValueError for a lens that folds the image over itself."""
    if model in FOV and not numbers[0]:
        return camera
    wide = np.tan(np.linspace(0.0, np.radians(MOST_DEG), 2000)[1:])  # radii in the plane z = 1
    bent = _bent(model, numbers, wide)
    stretch = 2.0 * np.tan(0.5 * numbers[0]) / numbers[0] if model in FOV else 1.0
    edges = [abs(at) for at in ((0 - camera.cx) / camera.fx, (camera.width - 1 - camera.cx) / camera.fx,
                                (0 - camera.cy) / camera.fy, (camera.height - 1 - camera.cy) / camera.fy)]
    corner = float(np.hypot(max(edges[:2]), max(edges[2:])))
    seen = int(np.searchsorted(np.maximum.accumulate(bent), corner)) + 1
    if (np.diff(bent[:seen]) <= 0.0).any():
        raise ValueError(f"a lens of the model {model} whose numbers fold the image over itself within {MOST_DEG:g} degrees "
                         "of its middle; type source.camera=[fx,fy,cx,cy] of undistorted images")
    if seen < len(wide):
        lens, off = _rational(wide[:seen], bent[:seen] / stretch)
        if off * stretch * camera.fx <= OFF_PX:
            return replace(camera, fx=stretch * camera.fx, fy=stretch * camera.fy, distortion=lens)
    sides = np.minimum(np.tan(np.radians(FLAT_DEG)), np.interp(edges, bent, wide))
    focal = 0.5 * max(camera.width / sides[:2].min(), camera.height / sides[2:].min())
    return Flattened(camera.width, camera.height, focal, focal, 0.5 * (camera.width - 1), 0.5 * (camera.height - 1),
                     body_from_camera=camera.body_from_camera, readout_s=camera.readout_s, model=model,
                     numbers=tuple(numbers), raw=(camera.fx, camera.fy, camera.cx, camera.cy))


def _bent(model: str, numbers: Sequence[float], radii: np.ndarray) -> np.ndarray:
    """Where radii in the plane z = 1 are put, in focal lengths from the middle."""
    if model in FOV:
        bent = np.arctan(2.0 * np.tan(0.5 * numbers[0]) * radii) / numbers[0]
    else:
        angle = np.arctan(radii)
        bent = angle * np.polyval([*reversed((*numbers, 0.0, 0.0, 0.0, 0.0)[:4]), 1.0], angle**2)
    return np.asarray(bent)


@lru_cache(maxsize=4)
def _maps(camera: Flattened) -> tuple[np.ndarray, np.ndarray]:
    """Where in the image of the lens each pixel (H, W) of the pinhole camera lies."""
    x, y = np.meshgrid((np.arange(camera.width) - camera.cx) / camera.fx, (np.arange(camera.height) - camera.cy) / camera.fy)
    radii = np.maximum(np.hypot(x, y), 1e-9)
    share = _bent(camera.model, camera.numbers, radii) / radii
    fx, fy, cx, cy = camera.raw
    return (fx * x * share + cx).astype(np.float32), (fy * y * share + cy).astype(np.float32)


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
