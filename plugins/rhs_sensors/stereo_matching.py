"""Depth of the first camera of a pair from the disparity of both.

Bouguet's rectification as in OpenCV turns both cameras until their rows coincide; semi-global matching (Hirschmueller 2008,
OpenCV's StereoSGBM) finds the disparity; what has no texture, is not unique, or is not found again from the other image
stays unknown. The first image is left as it is: depth is carried back to its own pixels, so that nothing that sees the
image needs to know that there was a pair.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse

from .stereo import Stereo

ALIGNED_RAD = 1e-4  # cameras turned by less against each other are rectified: a tenth of a pixel at 1000 px of focal length
ALIGNED_SHARE = 0.02  # and moved by less than this share of the baseline off the row
STEPS = 16.0  # OpenCV's disparities are in sixteenths of a pixel, and looked for in multiples of 16


class StereoPair:
    """Two cameras whose places are known. baseline_m: from eye to eye; focal_m_px: focal length times baseline, metre
    pixels: depth = focal_m_px / disparity."""

    def __init__(self, left: Camera, right: Camera, settings: Stereo) -> None:
        """Raises ConfigError where the second camera is not to the right of the first."""
        if (left.width, left.height) != (right.width, right.height):
            raise ConfigError(f"sensor=stereo: the left camera is {left.width}x{left.height}, the right one {right.width}x"
                              f"{right.height}; expected one size")
        self._settings, self._left = settings, left
        right_from_left = inverse(right.body_from_camera) @ left.body_from_camera
        at = inverse(right_from_left)[:3, 3]
        if not at[0] > np.hypot(at[1], at[2]):
            raise ConfigError(f"sensor=stereo: the second camera sits at ({at[0]:.3f}, {at[1]:.3f}, {at[2]:.3f}) m of the "
                              "first (x right, y down, z ahead); expected a place to its right")
        self.baseline_m = float(np.linalg.norm(at))
        self._maps: list[tuple[np.ndarray, np.ndarray]] = []
        if _aligned(left, right, right_from_left):
            self._view, self._apart_px = left, right.cx - left.cx
        else:
            self._rectify(right, right_from_left)
        self.focal_m_px = self._view.fx * self.baseline_m
        least = settings.disparity_sigma_px / settings.depth_error_share
        self.max_range_m = min(settings.max_range_m or np.inf, self.focal_m_px / least)
        self._matcher = self._made()

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: OpenCV's matcher is made anew."""
        return {name: value for name, value in vars(self).items() if name != "_matcher"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._matcher = self._made()

    def _rectify(self, right: Camera, right_from_left: np.ndarray) -> None:
        """Maps of both images onto one upright pair, and of that pair's depth back to the left image."""
        left, size = self._left, (self._left.width, self._left.height)
        lenses = [np.array(camera.distortion or (0.0,) * 5) for camera in (left, right)]
        turn_left, turn_right, projection, *_ = cv2.stereoRectify(
            left.matrix, lenses[0], right.matrix, lenses[1], size, right_from_left[:3, :3], right_from_left[:3, 3:],
            flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)
        fx, fy, cx, cy = projection[0, 0], projection[1, 1], projection[0, 2], projection[1, 2]
        self._view, self._apart_px = Camera(*size, fx, fy, cx, cy), 0.0
        rays = self._view.rays(_pixels(self._view))
        self._maps = [_map(camera.project(rays @ turn), self._view)
                      for camera, turn in ((left, turn_left), (right, turn_right))]
        back = left.rays(_pixels(left)) @ turn_left.T  # rays of the left image's pixels in the rectified camera's axes
        self._back = _map(self._view.project(back), left)
        self._along = back[:, 2].reshape(left.height, left.width).astype(np.float32)

    def _made(self) -> cv2.StereoSGBM:
        settings, width = self._settings, self._left.width
        nearest_px = min(self.focal_m_px / settings.min_range_m, settings.search_share * width)
        self._count = int(STEPS * np.ceil(max(nearest_px, 1.0) / STEPS))
        weight = settings.block_px**2
        return cv2.StereoSGBM.create(
            minDisparity=0, numDisparities=self._count, blockSize=settings.block_px,
            P1=round(settings.advanced.step_penalty * weight), P2=round(settings.advanced.jump_penalty * weight),
            disp12MaxDiff=-1, preFilterCap=31, uniquenessRatio=settings.uniqueness_percent,
            speckleWindowSize=round(settings.advanced.speckle_px * (width / 320) ** 2), speckleRange=1,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY)

    def depth(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """(H, W) float32 metres along the left camera's axis of the pair of (H, W, 3) uint8 images; NaN where unknown."""
        pair = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (left, right)]
        if self._maps:
            pair = [cv2.remap(grey, *maps, cv2.INTER_LINEAR) for grey, maps in zip(pair, self._maps, strict=True)]
        disparity = self._disparity(pair[0], pair[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.float32(self.focal_m_px) / disparity
            depth[~((depth > 0) & (depth <= self.max_range_m))] = np.nan
        return self._carried_back(depth) if self._maps else depth

    def _disparity(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """(H, W) float32 pixels of grey images whose rows coincide, NaN where nothing can be said."""
        disparity = self._searched(left, right)
        back = self._searched(right[:, ::-1], left[:, ::-1])[:, ::-1]  # of the right image's pixels
        columns, rows = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in left.shape[::-1]))
        there = cv2.remap(np.ascontiguousarray(back), columns - np.nan_to_num(disparity, nan=1e6), rows, cv2.INTER_NEAREST,
                          borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
        same = np.abs(there - disparity) <= self._settings.left_right_px  # False where either is unknown
        disparity[~(same & self._textured(left))] = np.nan
        return disparity + np.float32(self._apart_px)

    def _searched(self, here: np.ndarray, there: np.ndarray) -> np.ndarray:
        """(H, W) float32 by how many pixels things seen here lie further left there; NaN where none fits."""
        wider = [cv2.copyMakeBorder(grey, 0, 0, self._count, 0, cv2.BORDER_REPLICATE) for grey in (here, there)]
        raw = self._matcher.compute(wider[0], wider[1])[:, self._count:].astype(np.float32)
        return np.where(raw < 0, np.float32(np.nan), raw / np.float32(STEPS))

    def _textured(self, grey: np.ndarray) -> np.ndarray:
        """(H, W) bool: whether grey changes along the row somewhere near."""
        side = 2 * self._settings.advanced.texture_half_px + 1
        slope = cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5, 0.0, 0.5]], np.float32))
        return cv2.sqrBoxFilter(slope, cv2.CV_32F, (side, side)) >= self._settings.texture**2

    def _carried_back(self, depth: np.ndarray) -> np.ndarray:
        """Depth of the rectified view at the pixels of the left image: that of the nearest pixel, along its axis."""
        there = cv2.remap(depth, *self._back, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
        return there / self._along


def _aligned(left: Camera, right: Camera, right_from_left: np.ndarray) -> bool:
    """Whether rows of both images coincide already."""
    if any(left.distortion) or any(right.distortion) or left.skew or right.skew:
        return False
    same = np.allclose([left.fx, left.fy, left.cy], [right.fx, right.fy, right.cy], rtol=1e-6)
    turned = np.abs(right_from_left[:3, :3] - np.eye(3)).max()
    across = np.abs(right_from_left[1:3, 3]).max()
    return bool(same and turned < ALIGNED_RAD and across < ALIGNED_SHARE * np.linalg.norm(right_from_left[:3, 3]))


def _pixels(camera: Camera) -> np.ndarray:
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _map(pixels: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """x and y (H, W) float32 for cv2.remap; what cannot be seen lies outside."""
    grid = np.nan_to_num(pixels, nan=-1e4).reshape(camera.height, camera.width, 2).astype(np.float32)
    return np.ascontiguousarray(grid[..., 0]), np.ascontiguousarray(grid[..., 1])
