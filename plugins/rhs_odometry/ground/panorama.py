"""A picture laid round the camera: one column per bearing, one row per slope, so that whatever stands upright is a column,
however the camera is tilted."""

from __future__ import annotations

import cv2
import numpy as np

from rhs.api.geometry import Camera

HIGHEST = 0.6  # slope above which nothing is looked at: a door's lintel at 2 m
BLUR_PX = 1.0  # against the noise of single pixels


class Panorama:
    """bearings_rad (B,): left positive, ascending; slopes (T,): height over horizontal distance, ascending; shown (B, T)
    bool: inside the picture. eye_m: height of the camera, origin_m (2,): where it stands in the body frame."""

    def __init__(self, camera: Camera, beams: int, rows: int) -> None:
        turned = camera.body_from_camera[:3, :3]
        edges = camera.rays(np.array([[0.0, camera.cy], [camera.width - 1.0, camera.cy]])) @ turned.T
        left, right = np.arctan2(edges[:, 1], edges[:, 0])
        columns, lines = np.linspace(0.0, camera.width - 1.0, 9), np.array([0.0, camera.height - 1.0])
        corners = camera.rays(np.stack(np.meshgrid(columns, lines), axis=-1).reshape(-1, 2)) @ turned.T
        slope = corners[:, 2] / np.hypot(corners[:, 0], corners[:, 1])
        self.bearings_rad = np.linspace(right, left, beams)
        self.slopes = np.linspace(slope.min(), min(slope.max(), HIGHEST), rows)
        self.eye_m = camera.height_m
        self.origin_m = camera.body_from_camera[:2, 3].copy()
        bearing, up = np.meshgrid(self.bearings_rad, self.slopes, indexing="ij")
        rays = np.stack([np.cos(bearing), np.sin(bearing), up], axis=-1).reshape(-1, 3) @ turned
        ahead = rays[:, 2] > 1e-3
        pixels = np.full((len(rays), 2), -1.0)
        pixels[ahead] = camera.project(rays[ahead])
        inside = (pixels >= 1.0).all(axis=1) & (pixels[:, 0] <= camera.width - 2) & (pixels[:, 1] <= camera.height - 2)
        self.shown = (ahead & inside).reshape(beams, rows)
        self._at = pixels.reshape(beams, rows, 2).astype(np.float32)

    @property
    def nearest_floor_m(self) -> float:
        """The nearest floor in the picture, metres; infinite for a camera that never sees it."""
        low = self.slopes[0]
        return float(-self.eye_m / low) if low < 0.0 else np.inf

    def of(self, image: np.ndarray) -> np.ndarray:
        """(B, T, 3) uint8 of an image (H, W, 3); what is not shown is 0."""
        smooth = cv2.GaussianBlur(image, (0, 0), BLUR_PX * image.shape[1] / 320.0)
        out: np.ndarray = cv2.remap(smooth, self._at[..., 0], self._at[..., 1], cv2.INTER_LINEAR)
        out[~self.shown] = 0
        return out
