"""A lens that distorts, put before a pinhole renderer: a wider ideal view is drawn and bent, so that no corner is empty.

Brown, D. C., "Close-range camera calibration", Photogrammetric Engineering 37(8), 1971, with OpenCV's order of numbers.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from rhs.api.distortion import lens_slopes
from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera

MOST_WIDER = 2.0  # an ideal view this many times as wide or high is refused: most of it would be squeezed into the corners
UNDONE_PX = 1e-3  # the ray of a pixel must lead back to the pixel this exactly
EDGE_SHARE = 0.1  # inverse depths of neighbours that differ by more belong to two surfaces, and are not mixed


class Lens:
    """`ideal` is the pinhole camera to draw with; `bend` makes what `camera` sees of its picture and depth."""

    def __init__(self, camera: Camera, owner: str) -> None:
        """owner: how settings are named in complaints. Raises ConfigError where the lens folds the picture over itself,
        or sees so far aside that a flat picture cannot hold it."""
        u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
        rays = checked_rays(camera, np.stack([u.ravel(), v.ravel()], axis=1), owner)
        flat = replace(camera, distortion=())
        at = flat.project(rays).reshape(camera.height, camera.width, 2)
        low = np.minimum(np.floor(at.min(axis=(0, 1))) - 1.0, 0.0)
        high = np.maximum(np.ceil(at.max(axis=(0, 1))) + 1.0, [camera.width - 1.0, camera.height - 1.0])
        width, height = (int(n) for n in high - low + 1.0)
        if width > MOST_WIDER * camera.width or height > MOST_WIDER * camera.height:
            raise ConfigError(f"{owner}.distortion={list(camera.distortion)} needs a view of {width}x{height} pixels "
                              f"for one of {camera.width}x{camera.height}; expected at most twice the size: smaller numbers")
        self.ideal = replace(flat, width=width, height=height, cx=camera.cx - low[0], cy=camera.cy - low[1])
        self._x, self._y = ((at - low)[..., k].astype(np.float32) for k in (0, 1))

    def bend(self, image: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Picture (H, W, 3) and depth (H, W) of the camera from those of the ideal one. Depth along the optical axis stays
        what it is; it is taken between pixels by its inverse, which is linear over a plane, and never across an edge."""
        picture = cv2.remap(image, self._x, self._y, cv2.INTER_LINEAR)
        with np.errstate(divide="ignore"):
            inverse = np.nan_to_num(1.0 / depth.astype(np.float32), posinf=0.0)  # unknown: infinitely far
        square = np.ones((3, 3), np.uint8)
        most, least = cv2.dilate(inverse, square), cv2.erode(inverse, square)
        edge = ((most - least) > EDGE_SHARE * most).astype(np.float32)
        nearest = cv2.remap(inverse, self._x, self._y, cv2.INTER_NEAREST)
        between = cv2.remap(inverse, self._x, self._y, cv2.INTER_LINEAR)
        beside_edge = cv2.remap(edge, self._x, self._y, cv2.INTER_LINEAR) > 0
        with np.errstate(divide="ignore"):
            bent = np.float32(1.0) / np.where(beside_edge, nearest, between)
        return picture, np.where(np.isfinite(bent), bent, np.nan).astype(np.float32)


def checked_rays(camera: Camera, pixels: np.ndarray, owner: str) -> np.ndarray:
    """(N, 3) rays of (N, 2) pixels. Raises ConfigError unless each leads back to its pixel and the lens nowhere folds."""
    with np.errstate(over="ignore", invalid="ignore"):
        rays = camera.rays(pixels)
        off = np.abs(camera.project(rays) - pixels).max(axis=1)
        xx, xy, yy = lens_slopes(rays[:, 0], rays[:, 1], camera.distortion)
    bad = ~((off < UNDONE_PX) & (xx > 0) & (xx * yy > xy * xy))
    if bad.any():
        x, y = pixels[np.argmax(bad)]
        raise ConfigError(f"{owner}.distortion={list(camera.distortion)} folds the picture: pixel ({x:g}, {y:g}) of "
                          f"{camera.width}x{camera.height} has no ray of its own; type smaller numbers or a narrower view")
    return rays
