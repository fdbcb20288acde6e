"""Beams that meet somebody who walks: they tell nothing of the map.

Where a beam ends now, others of the last seconds passed: what stands there came since. People who go with a robot hide and
are half of what its scanner sees, from right poses and wrong ones alike. Seen only by scans against earlier scans along the
odometry, as dynamic points are found in clouds by visibility (Pomerleau, Kruesi, Colas, Furgale and Siegwart 2014, Long-term
3D map maintenance in dynamic environments).
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from rhs.api.geometry import inverse, planar, se2
from rhs.api.records import Motion, Scan

from .advanced import PassersSettings

BESIDE = np.array([-2, -1, 0, 1])  # beams about a bearing: none of them may have met what stands there


class PassersBy:
    """Keeps the scans of the last seconds along the motion."""

    def __init__(self, settings: PassersSettings) -> None:
        self._s = settings
        self.begin()

    def begin(self) -> None:
        """Nothing was seen yet."""
        self._pose = np.eye(4)
        self._seen: deque[tuple[float, np.ndarray, Scan]] = deque()

    def without(self, scan: Scan, motion: Motion, stamp_s: float) -> Scan:
        """The scan, NaN where its beams end at what came in the last seconds. All of it where that would be most: then the
        motion is wrong, or somebody carried the robot."""
        self._pose = self._pose @ se2(*planar(motion.previous_from_body))
        while self._seen and self._seen[0][0] < stamp_s - self._s.back_s:
            self._seen.popleft()
        ranges = np.asarray(scan.ranges_m, float)
        known, came = np.isfinite(ranges), np.zeros(len(ranges), bool)
        ends = _ends(ranges[known], scan.bearings_rad[known]) + scan.origin_xy_m
        for _, pose, before in self._seen:
            came[known] |= self._passed(before, planar(inverse(pose) @ self._pose), ends)
        if not self._seen or self._seen[-1][0] <= stamp_s - self._s.every_s:
            self._seen.append((stamp_s, self._pose, scan))
        if not came.any() or came.sum() > self._s.most * known.sum():
            return scan
        return replace(scan, ranges_m=np.where(came, np.nan, ranges))

    def _passed(self, before: Scan, at: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """(K,) bool: beams of a scan before, from which the robot is now at (3,), passed the ends (K, 2) clearly."""
        c, s = np.cos(at[2]), np.sin(at[2])
        there = ends @ np.array([[c, s], [-s, c]]) + at[:2] - before.origin_xy_m
        bearing, reach = np.arctan2(there[:, 1], there[:, 0]), np.hypot(*there.T)
        beams = np.searchsorted(before.bearings_rad, bearing)[:, None] + BESIDE
        inside = (beams >= 0).all(axis=1) & (beams < len(before.bearings_rad)).all(axis=1)
        ranges = np.asarray(before.ranges_m, float)[np.clip(beams, 0, len(before.bearings_rad) - 1)]
        clear = np.isfinite(ranges) & (ranges > (reach * (1.0 + self._s.slack_share) + self._s.slack_m)[:, None])
        passed: np.ndarray = inside & clear.all(axis=1)
        return passed


def _ends(ranges: np.ndarray, bearings_rad: np.ndarray) -> np.ndarray:
    """(K, 2) ends of beams from the scanner."""
    return ranges[:, None] * np.stack([np.cos(bearings_rad), np.sin(bearings_rad)], axis=1)
