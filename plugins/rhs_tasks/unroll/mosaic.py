"""A flat picture that grows by strips, whose rows go round: the last is a neighbour of the first.

Columns run along the tube, rows round it. Strips stand on the mosaic's own grid of pixels, so that registering one means
finding small displacements: by correlation first, then by points followed (Lucas and Kanade) with a check backwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

WRAP = 24  # rows repeated past the seam while points are followed


@dataclass(frozen=True, eq=False)
class Strip:
    """grey (rows, columns) float32 and weight (0: not seen) from column `first` of the mosaic on."""

    first: int
    grey: np.ndarray
    weight: np.ndarray


class Mosaic:
    """Weighted mean of the strips so far. pixel: side of a pixel; perimeter: length once round, in the same unit."""

    def __init__(self, pixel: float, perimeter: float) -> None:
        self.rows = int(round(perimeter / pixel))
        self.pixel = pixel
        self._row = perimeter / self.rows  # exactly as many rows as fit round
        self.first = 0
        self._sum, self._weight = np.zeros((self.rows, 0)), np.zeros((self.rows, 0))

    @property
    def empty(self) -> bool:
        return self._weight.shape[1] == 0

    @property
    def columns(self) -> int:
        return self._weight.shape[1]

    def picture(self) -> np.ndarray:
        """(rows, columns) float32 grey, NaN where nothing was seen."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self._weight > 0, self._sum / self._weight, np.nan).astype(np.float32)

    def grid(self, first: int, count: int) -> np.ndarray:
        """(rows * count, 2) along and around of the centres of pixels."""
        along, around = np.meshgrid((first + np.arange(count) + 0.5) * self.pixel, (np.arange(self.rows) + 0.5) * self._row)
        return np.stack([along.ravel(), around.ravel()], axis=1)

    def flat(self, pixels: np.ndarray, first: int) -> np.ndarray:
        """(N, 2) along and around of (N, 2) pixels (column, row) of a strip that begins at column `first`."""
        return np.stack([(pixels[:, 0] + first + 0.5) * self.pixel, (pixels[:, 1] + 0.5) * self._row], axis=1)

    def part(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """grey and known (rows, count) of columns from `first` on; unknown outside the mosaic."""
        grey, known = np.zeros((self.rows, count), np.float32), np.zeros((self.rows, count), bool)
        a, b = max(first, self.first), min(first + count, self.first + self.columns)
        if a < b:
            mine = slice(a - self.first, b - self.first)
            weight = self._weight[:, mine]
            seen = weight > 0
            grey[:, a - first : b - first][seen] = (self._sum[:, mine][seen] / weight[seen]).astype(np.float32)
            known[:, a - first : b - first] = seen
        return grey, known

    def put(self, strip: Strip, warp: np.ndarray) -> float:
        """Add a strip, moved by a homography of its own pixels; returns its correlation with what was there."""
        cv2 = opencv()

        width = strip.grey.shape[1]
        lift = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, WRAP], [0.0, 0.0, 1.0]])
        whole, size = lift @ warp @ np.linalg.inv(lift), (width, len(strip.grey) + 2 * WRAP)

        def moved(part: np.ndarray, how: int) -> np.ndarray:
            return cv2.warpPerspective(_padded(part.astype(np.float32)), whole, size, flags=how)[WRAP:-WRAP]

        grey, weight = moved(strip.grey, cv2.INTER_LINEAR), moved(strip.weight, cv2.INTER_NEAREST).astype(float)
        weight[moved(strip.weight > 0, cv2.INTER_LINEAR) < 0.999] = 0.0  # mixed with what was not seen
        there, known = self.part(strip.first, width)
        both = known & (weight > 0)
        agreement = correlation(there[both], grey[both]) if both.sum() > 100 else float("nan")
        self._grow(strip.first, width)
        mine = slice(strip.first - self.first, strip.first - self.first + width)
        self._sum[:, mine] += grey * weight
        self._weight[:, mine] += weight
        return agreement

    def _grow(self, first: int, count: int) -> None:
        if self.empty:
            self.first = first
        before = max(0, self.first - first)
        behind = max(0, first + count - self.first - self.columns)
        if before or behind:
            self._sum, self._weight = (np.pad(a, ((0, 0), (before, behind))) for a in (self._sum, self._weight))
            self.first -= before


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Normalised cross-correlation of two arrays of equal shape; NaN where either is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = np.sqrt((a**2).sum() * (b**2).sum())
    return float((a * b).sum() / size) if size > 0 else float("nan")


def shift_between(strip: Strip, mosaic: Mosaic, reach: float) -> tuple[float, float]:
    """How far (along, around, in the mosaic's unit) the strip's place is behind what it shows: the shift, up to `reach`
    along, at which its nearer two thirds correlate best with the mosaic."""
    cv2 = opencv()

    width, slide = strip.grey.shape[1], int(np.ceil(reach / mosaic.pixel))
    wide = (2 * width) // 3
    grey, known = mosaic.part(strip.first - slide, wide + 2 * slide)
    piece = strip.grey[:, :wide].copy()
    seen = strip.weight[:, :wide] > 0
    if seen.sum() < 100 or known.sum() < 100:
        return 0.0, 0.0
    piece[~seen] = piece[seen].mean()
    grey[~known] = grey[known].mean()
    padded = np.vstack([grey[-WRAP:], grey, grey[:WRAP]]).astype(np.float32)
    score = cv2.matchTemplate(padded, piece.astype(np.float32), cv2.TM_CCOEFF_NORMED)
    share = np.array([known[:, k : k + wide].mean() for k in range(score.shape[1])])
    score = np.where(share[None] > 0.5, score, -1.0)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    return (column - slide) * mosaic.pixel, (row - WRAP) * mosaic.pixel


def follow(strip: Strip, grey: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) pixels (column, row) of points in the strip, and of the same points in another picture of the same wall:
    grey and known (rows, columns) on the strip's own columns."""
    cv2 = opencv()

    both = known & (strip.weight > 0)
    nothing = np.zeros((0, 2)), np.zeros((0, 2))
    if both.sum() < 400:
        return nothing
    low, high = np.percentile(grey[both], [1, 99])
    spread = max(high - low, 1e-3)
    images = [_padded(np.clip(255.0 * (g - low) / spread, 0, 255).astype(np.uint8)) for g in (grey, strip.grey)]
    mask = _padded(cv2.erode(both.astype(np.uint8), np.ones((7, 7), np.uint8)))
    found = cv2.goodFeaturesToTrack(images[0], 400, 0.01, 5, mask=mask)
    if found is None:
        return nothing
    options = {"winSize": (15, 15), "maxLevel": 2}
    there, ok, _ = cv2.calcOpticalFlowPyrLK(images[0], images[1], found, None, **options)
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(images[1], images[0], there, None, **options)
    home = np.linalg.norm(back - found, axis=2).ravel() < 0.5
    good = (ok.ravel() == 1) & (ok_back.ravel() == 1) & home
    found, there = found.reshape(-1, 2), there.reshape(-1, 2)
    lift = np.array([0.0, WRAP])
    seen, there = found[good] - lift, there[good] - lift
    single = (seen[:, 1] >= 0) & (seen[:, 1] < len(grey))  # those past the seam stand twice in the picture
    return there[single].astype(float), seen[single].astype(float)


def homography(seen: np.ndarray, known: np.ndarray, most_px: float) -> tuple[np.ndarray, int]:
    """(3x3 homography that carries pixels `seen` (N, 2) to where they are `known`, how many agree).

    The identity where few agree, or where it would move one of them by more than `most_px`."""
    cv2 = opencv()

    if len(seen) < 12:
        return np.eye(3), 0
    warp, mask = cv2.findHomography(seen, known, cv2.RANSAC, 2.0)
    if warp is None or mask.sum() < 12 or mask.mean() < 0.4:
        return np.eye(3), 0 if mask is None else int(mask.sum())
    (left, top), (right, bottom) = seen.min(0), seen.max(0)
    corners = np.array([[left, top], [right, bottom], [left, bottom], [right, top]])
    moved = cv2.perspectiveTransform(corners[:, None], warp)[:, 0]
    if not np.isfinite(moved).all() or np.abs(moved - corners).max() > most_px:
        return np.eye(3), int(mask.sum())
    return warp, int(mask.sum())


def sample(picture: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """grey (rows, columns) float32 of a view at pixels (rows, columns, 2), and whether each lies inside it."""
    cv2 = opencv()

    height, width = picture.shape
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 1).all(2) & (pixels[..., 0] <= width - 2) & (pixels[..., 1] <= height - 2)
    where = np.where(inside[..., None], pixels, -1.0).astype(np.float32)
    return cv2.remap(picture.astype(np.float32), where, None, cv2.INTER_LINEAR), inside


def _padded(picture: np.ndarray) -> np.ndarray:
    return np.vstack([picture[-WRAP:], picture, picture[:WRAP]])


@cache
def opencv() -> Any:
    """OpenCV on one thread, loaded when something is unrolled."""
    import cv2

    cv2.setNumThreads(1)  # results must not depend on the number of cores
    return cv2
