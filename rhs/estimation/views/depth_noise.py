"""How noisy a depth image is beside what a Kinect is told to be, and the same image with that noise averaged away.

The level needs neither pose nor map: on a plane inverse depth is linear in the pixel, so the second difference of three
inverse depths in a row is noise alone, of six times the variance of one reading (Immerkaer 1996 does so for pictures); the
median of all leaves out the edges. The three stand LAG_PX apart, further than readings commonly share their errors.

Where the level is above what is told, a plane is fitted round each pixel: over a window just large enough that the mean of
its readings is as sure as one of a Kinect, half as wide where the residuals are larger than that noise explains (chi-square
test), which is an edge (the rule of Lepski 1990: the largest window that its noise does not contradict). What is left is
measured like the level, a window apart, and not taken for what averaging promises: readings that err together stay wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .rigid import KINECT, MEDIAN_TO_SIGMA, PointNoise
from .settings import DepthNoiseSettings

USUAL = DepthNoiseSettings()
LAG_PX = 6
BLOCK_PX = 8  # of the mean depth that says how noisy a reading ought to be
LEAST_READINGS = 200


def noise_level(depth: np.ndarray, law: PointNoise = KINECT, *, lag_px: int = LAG_PX) -> float:
    """Deviation of the readings of an (H, W) depth image in metres, times what the law says of them; NaN where too little is
    known to tell. lag_px: between the readings that are compared."""
    height, width = (side - side % BLOCK_PX for side in depth.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = _block_means(depth[:height, :width])
        inverse = 1.0 / depth[BLOCK_PX // 2 : height : BLOCK_PX, :width]  # one row of each block
        bend = np.abs(inverse[:, 2 * lag_px :] + inverse[:, : -2 * lag_px] - 2.0 * inverse[:, lag_px:-lag_px])
        z = np.repeat(mean, BLOCK_PX, axis=1)[:, lag_px:-lag_px]
        times = (bend * z**2 / law.depth(z)).ravel() / np.sqrt(6.0)
    told = np.isfinite(times)
    if told.sum() < LEAST_READINGS:
        return float("nan")
    times, z = times[told], z.ravel()[told]
    return float(MEDIAN_TO_SIGMA * np.median(times[z <= np.median(z)]))  # the end of the range cuts off half of far ones


def _block_means(depth: np.ndarray) -> np.ndarray:
    """Means of the known readings of each block of an (H, W) depth image; NaN where none is known."""
    known = np.isfinite(depth)
    means: np.ndarray = _block_sums(np.where(known, depth, np.float32(0.0))) / _block_sums(known.view(np.uint8)).astype(int)
    return means


def _block_sums(values: np.ndarray) -> np.ndarray:
    """Sums over the blocks of an (H, W) array: of whole columns at once, five times sooner than block by block."""
    by = [values[:, k::BLOCK_PX] for k in range(BLOCK_PX)]
    across = ((by[0] + by[1]) + (by[2] + by[3])) + ((by[4] + by[5]) + (by[6] + by[7]))
    sums: np.ndarray = across.reshape(-1, BLOCK_PX, across.shape[1]).sum(axis=1, dtype=values.dtype)
    return sums


@dataclass
class DepthLevel:
    """The level of a camera, view by view: a running mean of the variances that single images show. 1: as told."""

    settings: DepthNoiseSettings = field(default_factory=DepthNoiseSettings)
    law: PointNoise = KINECT
    level: float = 1.0
    _seen: int = 0

    def look(self, depth: np.ndarray, lag_px: int = LAG_PX) -> float:
        """The level after one more image (H, W), metres."""
        now = noise_level(depth, self.law, lag_px=lag_px)
        if np.isfinite(now):
            self._seen += 1
            share = 1.0 / min(self._seen, self.settings.memory)
            self.level = float(np.sqrt((1.0 - share) * self.level**2 + share * now**2))
        return self.level


def mended(depth: np.ndarray, level: float, *, max_range_m: float, law: PointNoise = KINECT,
           settings: DepthNoiseSettings = USUAL) -> tuple[np.ndarray, int]:
    """An (H, W) float32 depth image whose noise is `level` times what the law says, with as much of it averaged away as
    brings it back to that, and the side of the window, pixels. NaN where no window is free of edges, and where the end of
    the range cut readings off."""
    widest = max(int(settings.widest_share * depth.shape[1]), 1)
    half = min(int(np.ceil(0.5 * (level - 1.0))), widest)
    out = np.full(depth.shape, np.nan)
    moments = _Moments(depth)
    for reach in sorted({half, half // 2} - {0}, reverse=True):
        value, off, count = moments.planes(reach)
        sigma = level * law.depth(value)
        with np.errstate(invalid="ignore"):
            noise_alone = off < sigma**2 * (1.0 + settings.edge_sigma * np.sqrt(2.0 / np.maximum(count - 3.0, 1.0)))
            enough = count >= settings.known * moments.inside(reach)
            within = value + settings.cut_sigma * sigma <= max_range_m
        out = np.where(np.isnan(out) & noise_alone & enough & within, value, out)
    return out.astype(np.float32), 2 * half + 1


class _Moments:
    """Sums of powers of a depth image over windows round each pixel."""

    def __init__(self, depth: np.ndarray) -> None:
        known = np.isfinite(depth)
        height, width = depth.shape
        v, u = np.mgrid[0:height, 0:width].astype(float)
        z = np.where(known, depth, 0.0).astype(float)
        self._known, self._z = known.astype(float), z
        self._u, self._v = u, v
        self._parts = (self._known, self._known * u, self._known * v, self._known * u * u, self._known * u * v,
                       self._known * v * v, z, z * u, z * v, z * z)

    def inside(self, reach: int) -> np.ndarray:
        """(H, W) pixels of each window that lie in the image."""
        return _box(np.ones_like(self._z), reach)

    def planes(self, reach: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(H, W) each: the plane through the known depths of the window, at its middle; the mean square of its residuals;
        how many were known."""
        n, u, v, uu, uv, vv, z, zu, zv, zz = (_box(part, reach) for part in self._parts)
        with np.errstate(invalid="ignore", divide="ignore"):
            mu, mv, mz = u / n, v / n, z / n
            uu, uv, vv = uu / n - mu * mu, uv / n - mu * mv, vv / n - mv * mv
            zu, zv, zz = zu / n - mz * mu, zv / n - mz * mv, zz / n - mz * mz
            determinant = uu * vv - uv * uv
            along_u, along_v = (vv * zu - uv * zv) / determinant, (uu * zv - uv * zu) / determinant
            value = mz + along_u * (self._u - mu) + along_v * (self._v - mv)
            off = (zz - along_u * zu - along_v * zv) * n / (n - 3.0)
        bad = (n < 4.0) | ~(determinant > 1e-6)
        return np.where(bad, np.nan, value), np.where(bad, np.nan, off), n


def _box(part: np.ndarray, reach: int) -> np.ndarray:
    """(H, W) sums over windows of 2 reach + 1 pixels a side, as far as they lie in the image."""
    import cv2

    side = 2 * reach + 1
    return cv2.boxFilter(part, cv2.CV_64F, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
