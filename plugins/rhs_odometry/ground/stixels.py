"""The free way ahead of one camera: on each bearing floor up to a foot, and something upright above it.

Every distance of the foot says where each pixel of the column was in the views before; the one under which the column looks
there as it looks now is taken. Where pictures do not decide, as before a plain wall, the colours of the floor and of what is
not floor help, learnt from columns that were clear. What is not clear, or what no other view shows, is unknown.
"""

from __future__ import annotations

import cv2
import numpy as np

from rhs.api.frozen import freeze
from rhs.api.geometry import Camera, wrap
from rhs.api.records import Scan

from .config import StixelSettings
from .stixel_kernels import column_costs, smoothest

TONES = 16  # of each of the three colours
AROUND = 3  # columns whose costs are averaged
HIGHEST = 0.6  # slope above which nothing is looked at: a door's lintel at 2 m
BLUR_PX = 1.0  # against the noise of single pixels


class Panorama:
    """A picture laid round the camera: one column per bearing, one row per slope, so that whatever stands upright is a
    column, however the camera is tilted.

    bearings_rad (B,): left positive, ascending; slopes (T,): height over horizontal distance, ascending; shown (B, T)
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


class Stixels:
    """Scans of one camera from its views and where they were taken."""

    def __init__(self, camera: Camera, settings: StixelSettings) -> None:
        self._settings, self.round = settings, Panorama(camera, settings.beams, settings.rows)
        self._ranges = 1.0 / np.linspace(1.0 / settings.nearest_m, 1.0 / settings.farthest_m, settings.steps)
        self._seen = np.full((2, TONES**3), 2.0)  # pixels of each colour that were floor, and that were not
        self._views: list[np.ndarray | None] = []  # (B, T, 3) uint8
        self._greys: dict[int, np.ndarray] = {}
        self._forgotten = 0  # views whose pictures were given up

    def add(self, image: np.ndarray | None) -> None:
        """The next view; None where it has no picture."""
        self._views.append(None if image is None else self.round.of(image))

    def scan(self, view: int, poses: np.ndarray, *, learn: bool = True, later: bool = False) -> Scan | None:
        """What stands round view number `view`, None without a picture. poses (N, 3): x, y, yaw of the body at all views so
        far. later: views after it may be compared too."""
        s, shown = self._settings, self._views[view]
        if shown is None:
            return None
        others = [] if self._pivoted(view, poses) else self._others(view, poses, later)
        tones = _tones(shown)
        extra = s.floor_cost + self._by_colour(tones)
        now = self._grey(view)
        there = np.stack([self._grey(k) for k in others]) if others else np.zeros((0, *now.shape), np.float32)
        seen_from = np.array([self._from(poses[view], poses[k]) for k in others]).reshape(-1, 3)
        eye_m = self.round.eye_m
        costs, pairs = column_costs(now, there, seen_from, self.round.bearings_rad, self.round.slopes, eye_m, self._ranges,
                                    extra,
                                    (s.cap, s.unknown, eye_m + s.above_m, s.low, s.low_each, s.low_m, s.behind))
        costs = cv2.blur(costs, (1, AROUND))
        best = smoothest(costs, s.bend, s.leap)
        ranges, clear = self._between(costs, best), self._clearness(costs, best)
        compared = pairs[np.arange(len(best)), best] >= s.compared * self.round.shown.sum(axis=1)
        if learn:
            self._learn(tones, ranges, (clear > s.learn) & compared)
        return self._scan(ranges, (clear > s.clear) & compared)

    def forget(self, before: int) -> None:
        """Pictures of views before this number are given up."""
        for view in range(self._forgotten, before):
            self._views[view] = None
            self._greys.pop(view, None)
        self._forgotten = max(self._forgotten, before)

    def _scan(self, ranges: np.ndarray, believed: np.ndarray) -> Scan:
        s = self._settings
        believed = believed & (ranges > s.least_m) & ~self._steep(ranges)
        out = np.where(believed, np.where(ranges > s.range_m, np.inf, ranges), np.nan)
        x, y = self.round.origin_m
        blind_m = min(self.round.nearest_floor_m, s.range_m)
        return Scan(freeze(self.round.bearings_rad), freeze(out), s.range_m, (float(x), float(y)), blind_m)

    def _steep(self, ranges: np.ndarray) -> np.ndarray:
        """(B,) whether the range leaps or runs away between a column and its neighbours."""
        s, out = self._settings, np.zeros(len(ranges), bool)
        step = 1.0 / self._ranges[0] - 1.0 / self._ranges[1]
        for k in range(1, s.steep_columns + 1):
            near = np.minimum(ranges[k:], ranges[:-k])
            leaps = np.abs(np.log(ranges[k:] / ranges[:-k])) > s.steep * k + step * near
            out[k:] |= leaps
            out[:-k] |= leaps
        return out

    def _between(self, costs: np.ndarray, best: np.ndarray) -> np.ndarray:
        """(B,) ranges where the parabola through the costs of the step taken and its two neighbours is least: steps are 13
        cm apart at 1.5 m (as sub-pixel disparities, Tian and Huhns 1986)."""
        columns, middle = np.arange(len(best)), np.clip(best, 1, len(self._ranges) - 2)
        nearer, here, further = (costs[columns, middle + side] for side in (-1, 0, 1))
        bent, inverse_m = nearer - 2.0 * here + further, 1.0 / self._ranges
        least = (middle == best) & (here <= nearer) & (here <= further) & (bent > 0.0)
        off = np.where(least, 0.5 * (nearer - further) / np.where(least, bent, 1.0), 0.0)
        return 1.0 / (inverse_m[best] + off * (inverse_m[1] - inverse_m[0]))

    def _clearness(self, costs: np.ndarray, best: np.ndarray) -> np.ndarray:
        """(B,) how much more the cheapest other distance costs than the one taken."""
        taken = self._ranges[best]
        other = np.abs(np.log(self._ranges[None, :] / taken[:, None])) > self._settings.other_share
        least: np.ndarray = np.where(other, costs, np.inf).min(axis=1)
        return least - costs[np.arange(len(best)), best]

    def _pivoted(self, view: int, poses: np.ndarray) -> bool:
        """Whether the camera turned on the spot before this view: how far it turned is known too badly for that."""
        if view == 0:
            return False
        turned = abs(wrap(poses[view, 2] - poses[view - 1, 2]))
        moved = float(np.hypot(*(poses[view, :2] - poses[view - 1, :2])))
        return bool(moved < self._settings.pivot_m and turned > self._settings.pivot_rad)

    def _others(self, view: int, poses: np.ndarray, later: bool) -> list[int]:
        """Views to compare with, from different distances, that look the same way."""
        s, found = self._settings, []
        for step in (-1, 1) if later else (-1,):
            wanted, k = list(s.apart_m[:: 2 if later else 1]), view + step
            while wanted and 0 <= k < min(len(poses), len(self._views)) and abs(k - view) <= s.oldest:
                if abs(wrap(poses[k, 2] - poses[view, 2])) > s.turned_rad or self._views[k] is None:
                    break
                if np.hypot(*(poses[k, :2] - poses[view, :2])) >= wanted[0]:
                    found.append(k)
                    wanted.pop(0)
                k += step
        return found

    def _from(self, here: np.ndarray, there: np.ndarray) -> np.ndarray:
        """(3,) x, y, yaw of the camera at body pose `there` (3,), seen from the one at `here`."""
        eye = [_turn(pose[2]) @ self.round.origin_m + pose[:2] for pose in (here, there)]
        return np.array([*(_turn(-here[2]) @ (eye[1] - eye[0])), there[2] - here[2]])

    def _grey(self, view: int) -> np.ndarray:
        """(B, T) float32, NaN where nothing is shown."""
        if view not in self._greys:
            if len(self._greys) > 4 * self._settings.oldest:
                self._greys.clear()
            shown = self._views[view]
            assert shown is not None
            grey = shown.astype(np.float32).mean(axis=2)
            self._greys[view] = np.where(self.round.shown, grey, np.float32(np.nan))
        return self._greys[view]

    def _by_colour(self, tones: np.ndarray) -> np.ndarray:
        """(B, T) what the colours (B, T) cost as floor."""
        s, share = self._settings, self._seen / self._seen.sum(axis=1, keepdims=True)
        odds = np.clip(np.log((share[1] + 1e-5) / (share[0] + 1e-5)), -s.colour_most, s.colour_most)
        cost: np.ndarray = s.colour * np.where(self._seen.sum(axis=0) > s.colour_least, odds, 0.0)
        return cost[tones]

    def _learn(self, tones: np.ndarray, ranges: np.ndarray, clear: np.ndarray) -> None:
        """Colours of clear columns, a little apart from the foot."""
        foot, slopes = -self.round.eye_m / ranges[:, None], self.round.slopes[None, :]
        counted = self.round.shown & clear[:, None]
        for row, where in enumerate((slopes < foot / 0.92, slopes > foot / 1.08)):
            self._seen[row] += np.bincount(tones[counted & where], minlength=TONES**3)


def _tones(shown: np.ndarray) -> np.ndarray:
    """(B, T) number of each pixel's colour."""
    coarse = shown.astype(np.int64) // (256 // TONES)
    return (coarse[..., 0] * TONES + coarse[..., 1]) * TONES + coarse[..., 2]


def _turn(yaw_rad: float) -> np.ndarray:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s], [s, c]])
