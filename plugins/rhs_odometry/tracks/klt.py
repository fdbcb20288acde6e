"""Points followed by pyramidal Lucas-Kanade, then found again exactly: the front end of every monocular odometry.

Sources: Lucas and Kanade 1981 (pyramids after Bouguet 2000), Shi and Tomasi 1994 for the points. A point whose patch is
not found again is followed back instead (Kalal, Mikolajczyk and Matas 2010). The floor has its own quota of points:
floors are plain beside walls, and without it the floor, which fixes the scale, would hardly be tracked.
"""

from __future__ import annotations

import cv2
import numpy as np

from rhs.api.records import Observation
from rhs.estimation.views.settings import scaled_px

from .klt_patches import Patches
from .settings import KltSettings
from .track_frames import TrackFrame, travel_of


class KltTracker:
    """Follows points through the images of one camera. A view without an image ends all tracks."""

    def __init__(self, settings: KltSettings, points: int = 130) -> None:
        """points: followed at most."""
        self._settings, self._points = settings, points
        self._gray: np.ndarray | None = None
        self._patches: Patches | None = None  # made for the width of the first image
        self._ids = np.zeros(0, np.int64)
        self._pixels = np.zeros((0, 2), np.float32)
        self._next_id = 0

    def track(self, observation: Observation) -> TrackFrame:
        gray = None if observation.image is None else cv2.cvtColor(observation.image, cv2.COLOR_RGB2GRAY)
        if gray is not None and self._patches is None and self._settings.patches:
            self._patches = Patches(self._settings.patch, gray.shape[1])
        if gray is None or self._gray is None or gray.shape != self._gray.shape:
            self._keep(np.zeros(len(self._ids), bool))
        else:
            self._follow(self._gray, gray)
        if gray is not None:
            self._refill(gray)
        self._gray = gray
        command, wheel = travel_of(observation)
        return TrackFrame(observation.stamp_s, self._ids.copy(), self._pixels.astype(float), command, wheel)

    def _follow(self, before: np.ndarray, after: np.ndarray) -> None:
        """Follow the points, find their patches again; keep those found, or else those that come back when followed back."""
        if not len(self._ids):
            return
        height, width = after.shape
        there, found = self._flow(before, after, self._pixels)
        pixels, sure = there.astype(float), np.zeros(len(there), bool)
        if self._patches is not None:
            pixels, sure = self._patches.find(after, pixels)
        good = found & (sure | self._comes_back(before, after, there, ~sure))
        good &= (pixels >= 3).all(axis=1) & (pixels[:, 0] < width - 3) & (pixels[:, 1] < height - 3)
        self._pixels = pixels.astype(np.float32)
        self._keep(good)
        if self._patches is not None:
            self._patches.refresh(after, sure[good])

    def _flow(self, before: np.ndarray, after: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(pixels (N, 2) in the image `after`, found (N,) bool)."""
        side = round(scaled_px(self._settings.window_px, after.shape[1]))
        start = np.ascontiguousarray(pixels, np.float32)
        there, found, _ = cv2.calcOpticalFlowPyrLK(
            before, after, start, np.empty_like(start), winSize=(side, side), maxLevel=self._settings.levels)
        return np.asarray(there), np.asarray(found).ravel() > 0

    def _comes_back(self, before: np.ndarray, after: np.ndarray, there: np.ndarray, doubted: np.ndarray) -> np.ndarray:
        """(N,) bool: the doubted points that, followed back, arrive where they came from."""
        out, limit_px = np.zeros(len(there), bool), scaled_px(self._settings.check_px, after.shape[1])
        if doubted.any():
            back, found = self._flow(after, before, there[doubted])
            out[doubted] = found & (np.abs(back - self._pixels[doubted]).max(axis=1) < limit_px)
        return out

    def _keep(self, mask: np.ndarray) -> None:
        self._ids, self._pixels = self._ids[mask], self._pixels[mask]
        if self._patches is not None:
            self._patches.keep(mask)

    def _refill(self, gray: np.ndarray) -> None:
        """Find new corners away from the followed ones, wall part and floor part each up to its quota."""
        s, height = self._settings, gray.shape[0]
        border = 2 * height // 3
        on_floor = int((self._pixels[:, 1] >= border).sum())
        for rows, quota, have, quality in (
            (slice(0, border), self._points - s.floor_points, len(self._ids) - on_floor, s.quality),
            (slice(border, height), s.floor_points, on_floor, s.floor_quality),
        ):
            missing = quota - have
            if missing >= max(1, quota // 10):
                self._add(gray, self._corners(gray, rows, missing, quality))

    def _corners(self, gray: np.ndarray, rows: slice, count: int, quality: float) -> np.ndarray:
        s = self._settings
        distance = scaled_px(s.distance_px, gray.shape[1])
        mask = np.full(gray.shape, 255, np.uint8)
        for x, y in self._pixels:
            cv2.circle(mask, (round(float(x)), round(float(y))), round(distance), 0, -1)
        corners = cv2.goodFeaturesToTrack(gray[rows], count, quality, distance, mask=mask[rows])
        if corners is None:
            return np.zeros((0, 2), np.float32)
        return corners.reshape(-1, 2) + np.array([0, rows.start], np.float32)

    def _add(self, gray: np.ndarray, pixels: np.ndarray) -> None:
        if self._patches is not None:
            pixels = pixels[self._patches.whole(pixels, gray)]
        fresh = np.arange(self._next_id, self._next_id + len(pixels), dtype=np.int64)
        self._next_id += len(pixels)
        self._ids = np.concatenate([self._ids, fresh])
        self._pixels = np.concatenate([self._pixels, pixels]).astype(np.float32)
        if self._patches is not None:
            self._patches.add(gray, pixels.astype(float))
