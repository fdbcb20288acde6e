"""Points followed from view to view by pyramidal Lucas-Kanade: the front end of every one-eye odometry.

Sources: Lucas and Kanade 1981 (pyramids after Bouguet 2000), Shi and Tomasi 1994 for the points, Kalal, Mikolajczyk
and Matas 2010 for the forward-backward check. The floor has its own quota of points: floors are plain beside walls,
and without it the floor, which fixes the scale, would hardly be tracked.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rhs.records import Observation

from .track_frames import TrackFrame, travel_of


@dataclass(frozen=True)
class KltSettings:
    """Front end settings; sizes in pixels for a 320x240 image, scaled with the image width."""

    points: int = 130  # tracked at most; more costs time and gained nothing in the notes
    floor_points: int = 40  # of these, kept for the lower third of the image
    quality: float = 0.008  # weakest corner relative to the best one, upper two thirds
    floor_quality: float = 0.02  # the same in the lower third, where weak corners are rendering noise
    distance_px: float = 7.0  # least distance between two points
    window_px: int = 13  # side of the patch that is followed
    levels: int = 3  # pyramid levels above the image itself
    check_px: float = 0.6  # largest disagreement between following forward and back


class KltTracker:
    """Follows points through the images of one camera. A view without an image ends all tracks."""

    def __init__(self, settings: KltSettings) -> None:
        self._settings = settings
        self._gray: np.ndarray | None = None
        self._ids = np.zeros(0, np.int64)
        self._pixels = np.zeros((0, 2), np.float32)
        self._next_id = 0

    def track(self, observation: Observation) -> TrackFrame:
        gray = None if observation.image is None else cv2.cvtColor(observation.image, cv2.COLOR_RGB2GRAY)
        if gray is None or self._gray is None or gray.shape != self._gray.shape:
            self._ids, self._pixels = self._ids[:0], self._pixels[:0]
        else:
            self._follow(self._gray, gray)
        if gray is not None:
            self._refill(gray)
        self._gray = gray
        command, wheel = travel_of(observation)
        return TrackFrame(observation.stamp_s, self._ids.copy(), self._pixels.astype(float), command, wheel)

    def _follow(self, before: np.ndarray, after: np.ndarray) -> None:
        """Follow the points, keep those that come back to where they started and stay inside the image."""
        if not len(self._ids):
            return
        s = self._settings
        flow = {"winSize": (s.window_px, s.window_px), "maxLevel": s.levels}
        there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, self._pixels, None, **flow)
        back, found_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, **flow)
        height, width = after.shape
        good = (found.ravel() > 0) & (found_back.ravel() > 0)
        good &= np.abs(back - self._pixels).max(axis=1) < s.check_px
        good &= (there >= 3).all(axis=1) & (there[:, 0] < width - 3) & (there[:, 1] < height - 3)
        self._ids, self._pixels = self._ids[good], there[good]

    def _refill(self, gray: np.ndarray) -> None:
        """Find new corners away from the followed ones, wall part and floor part each up to its quota."""
        s, height = self._settings, gray.shape[0]
        border = 2 * height // 3
        on_floor = int((self._pixels[:, 1] >= border).sum())
        for rows, quota, have, quality in (
            (slice(0, border), s.points - s.floor_points, len(self._ids) - on_floor, s.quality),
            (slice(border, height), s.floor_points, on_floor, s.floor_quality),
        ):
            missing = quota - have
            if missing >= max(1, quota // 10):
                self._add(self._corners(gray, rows, missing, quality))

    def _corners(self, gray: np.ndarray, rows: slice, count: int, quality: float) -> np.ndarray:
        s = self._settings
        distance = s.distance_px * gray.shape[1] / 320.0
        mask = np.full(gray.shape, 255, np.uint8)
        for x, y in self._pixels:
            cv2.circle(mask, (round(float(x)), round(float(y))), round(distance), 0, -1)
        corners = cv2.goodFeaturesToTrack(gray[rows], count, quality, distance, mask=mask[rows])
        if corners is None:
            return np.zeros((0, 2), np.float32)
        return corners.reshape(-1, 2) + np.array([0, rows.start], np.float32)

    def _add(self, pixels: np.ndarray) -> None:
        fresh = np.arange(self._next_id, self._next_id + len(pixels), dtype=np.int64)
        self._next_id += len(pixels)
        self._ids = np.concatenate([self._ids, fresh])
        self._pixels = np.concatenate([self._pixels, pixels]).astype(np.float32)
