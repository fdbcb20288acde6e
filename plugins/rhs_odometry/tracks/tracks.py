"""Points followed through images: chosen at corners, moved on by Lucas-Kanade.

Shi and Tomasi, "Good features to track", CVPR 1994; Bouguet's pyramidal Lucas-Kanade as in OpenCV, with the start
predicted from the expected motion and a check backwards.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

LEVELS = 3  # of the image pyramid above full size: finds a point some 60 pixels from where it was expected


def gray(image: np.ndarray) -> np.ndarray:
    """(H, W) uint8 of an RGB image."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image


def corners(picture: np.ndarray, taken: np.ndarray, *, count: int, spacing_px: int) -> np.ndarray:
    """(N, 2) float32 strongest corners of a gray image, none nearer than spacing_px to the pixels already `taken`."""
    if count <= 0:
        return np.zeros((0, 2), np.float32)
    mask = np.full(picture.shape, 255, np.uint8)
    for at in np.round(taken).astype(int).tolist():
        cv2.circle(mask, at, spacing_px, 0, -1)
    found = cv2.goodFeaturesToTrack(picture, count, 0.003, spacing_px, mask=mask)
    return np.zeros((0, 2), np.float32) if found is None else found.reshape(-1, 2)


def follow(before: np.ndarray, now: np.ndarray, pixels: np.ndarray, guess: np.ndarray, *, window_px: int):
    """Where (N, 2) pixels of image `before` are in image `now`: (pixels (N, 2), found (N,) bool)."""
    if len(pixels) == 0:
        return np.zeros((0, 2), np.float32), np.zeros(0, bool)
    start = np.ascontiguousarray(pixels, np.float32)
    goal = np.where(np.isfinite(guess), guess, start).astype(np.float32)
    size = (window_px, window_px)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.02)
    options: dict[str, Any] = {"winSize": size, "criteria": criteria, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
                               "minEigThreshold": 5e-4}
    there, ok, _ = cv2.calcOpticalFlowPyrLK(before, now, start, goal.copy(), maxLevel=LEVELS, **options)
    height, width = now.shape
    inside = (there[:, 0] > 1) & (there[:, 1] > 1) & (there[:, 0] < width - 2) & (there[:, 1] < height - 2)
    return there, (ok.ravel() == 1) & inside


def pyramid(picture: np.ndarray) -> list[np.ndarray]:
    """[full, half] size of a gray image."""
    return [picture, cv2.pyrDown(picture)]
