"""Depth as the colour camera sees it, of recordings whose depth image was taken by a camera of its own and left so.

Every depth pixel is carried into the colour camera and falls on those of its pixels that it covers, one at least; where
several do, the nearest surface is seen, and the readings on it are averaged (the nearest reading alone would lie before the
surface by its noise). Read as if
colour and depth were one camera, an image pair of 7-Scenes is a tenth too narrow in colour: motion across the view comes out
too short by up to that share, and key-points get depths from up to 30 pixels away.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rhs.api.errors import ConfigError, check_range
from rhs.api.geometry import Camera, se3
from rhs.api.jit import compiled

MOST_BESIDE = 8.0  # pixels to each side that one of depth covers: of cameras 17 times as fine, or nearer than they see
SAME_SURFACE = 0.02  # readings within this share of the nearest one on a pixel are of one surface


@dataclass(frozen=True, eq=False)
class DepthCamera:
    """A camera that measures depth beside one that sees colour. fx, fy, cx, cy in pixels of the depth image;
    color_from_depth (4x4): its points in the colour camera; distortion: of its lens, OpenCV's order."""

    fx: float
    fy: float
    cx: float
    cy: float
    color_from_depth: np.ndarray
    distortion: tuple[float, ...] = ()

    def registered(self, depth: np.ndarray, color: Camera) -> np.ndarray:
        """(H, W) float32 metres along the optical axis of the colour camera, NaN unknown, of a depth image (h, w)."""
        shape = color.height, color.width
        nearest, total, count = np.full(shape, np.inf), np.zeros(shape), np.zeros(shape)
        slopes = _slopes(depth.shape, (self.fx, self.fy, self.cx, self.cy), self.distortion)
        theirs = np.array([color.fx, color.fy, color.cx, color.cy, color.skew])
        lens = np.array((*color.distortion, *[0.0] * 8)[:8])
        covers = np.array([color.fx / self.fx, color.fy / self.fy])
        _carry(depth, slopes, self.color_from_depth, (theirs, lens, covers), (nearest, total, count))
        with np.errstate(invalid="ignore"):
            return np.where(count > 0, total / count, np.nan).astype(np.float32)


@lru_cache(maxsize=4)
def _slopes(shape: tuple[int, int], numbers: tuple[float, ...], distortion: tuple[float, ...]) -> np.ndarray:
    """(h, w, 2) x / z and y / z of the rays of the pixels of a camera, the lens undone."""
    fx, fy, cx, cy = numbers
    camera = Camera(shape[1], shape[0], fx, fy, cx, cy, distortion=distortion)
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    return np.ascontiguousarray(camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))[:, :2].reshape(*shape, 2))


def check_depth_camera(values) -> None:
    """Refuse what is not the intrinsics of a depth camera, with where it sits or without."""
    try:
        numbers = [float(v) for v in values] if not isinstance(values, str) else [np.nan]
    except (TypeError, ValueError):
        numbers = [np.nan]
    if numbers and (len(numbers) not in (4, 7) or not np.isfinite(numbers).all()):
        raise ConfigError(f"source.depth_camera={values}: expected [fx,fy,cx,cy] or [fx,fy,cx,cy,x_m,y_m,z_m]")
    for name, value in zip(("fx", "fy"), numbers, strict=False):
        check_range("source", f"depth_camera {name}", value, low=1.0, high=1e5, unit="pixels")
    for name, value in zip("xyz", numbers[4:], strict=False):
        check_range("source", f"depth_camera {name}", value, low=-1.0, high=1.0, unit="m")


def typed_depth_camera(values) -> DepthCamera | None:
    """The depth camera of source.depth_camera (4 or 7 numbers); None when empty."""
    fx, fy, cx, cy, *place = (float(v) for v in values) if len(values) else (0.0,) * 4
    return DepthCamera(fx, fy, cx, cy, se3(np.eye(3), np.array(place or [0.0] * 3))) if len(values) else None


@compiled
def _carry(depth, slopes, pose, seen_by, out):
    """Fill nearest, total and count (H, W) of the depths that fall on each pixel of the colour camera. seen_by: its numbers,
    its lens, and how many of its pixels (across, down) one of depth covers at the same distance."""
    theirs, lens, covers = seen_by
    nearest, total, count = out
    for averaging in range(2):
        for v in range(depth.shape[0]):
            for u in range(depth.shape[1]):
                z = depth[v, u]
                if not z > 0.0:  # false for NaN
                    continue
                x, y = slopes[v, u, 0] * z, slopes[v, u, 1] * z
                far = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
                if far <= 0.0:
                    continue
                column, row = _bent((pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / far,
                                    (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / far, lens)
                column, row = theirs[0] * column + theirs[4] * row + theirs[2], theirs[1] * row + theirs[3]
                left, right = _covered(column, covers[0] * z / far, nearest.shape[1])
                top, bottom = _covered(row, covers[1] * z / far, nearest.shape[0])
                for i in range(top, bottom):
                    for j in range(left, right):
                        if averaging == 0:
                            nearest[i, j] = min(nearest[i, j], far)
                        elif far <= nearest[i, j] * (1.0 + SAME_SURFACE):
                            total[i, j] += far
                            count[i, j] += 1.0


@compiled
def _covered(at, wide, size):
    """The first of the pixels, at least one, that `wide` pixels about a place cover, and the one behind the last."""
    beside = min(max(0.5 * (wide - 1.0), 0.0), MOST_BESIDE)
    return max(int(np.floor(at + 0.5 - beside)), 0), min(int(np.floor(at + 0.5 + beside)) + 1, size)


@compiled
def _bent(x, y, lens):
    """`rhs.api.distortion.distorted` of one point."""
    r2 = x * x + y * y
    radial = (1.0 + r2 * (lens[0] + r2 * (lens[1] + r2 * lens[4]))) / (1.0 + r2 * (lens[5] + r2 * (lens[6] + r2 * lens[7])))
    return (x * radial + 2.0 * lens[2] * x * y + lens[3] * (r2 + 2.0 * x * x),
            y * radial + lens[2] * (r2 + 2.0 * y * y) + 2.0 * lens[3] * x * y)
