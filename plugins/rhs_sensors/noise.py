"""Gaussian noise of a sensor, ten times sooner than one draw after the other.

Sixteen random bits choose one of 65,536 equally likely values, the normal distribution's quantiles in the middle of as many
slices (inversion: Devroye, "Non-Uniform Random Variate Generation", 1986, section II.2). Each reading has bits of its own.
The largest value is 4.3 deviations; beyond lie 16 of a million readings of a true normal distribution.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import ndtri

from rhs.api.jit import compiled

VALUES = 1 << 16


@cache
def normal() -> np.ndarray:
    """(VALUES,) float32: the equally likely values, of mean 0 and deviation 1, smallest first."""
    half = ndtri((np.arange(VALUES // 2) + 0.5) / VALUES)
    values = np.concatenate([half, -half[::-1]])
    return (values / values.std()).astype(np.float32)


@cache
def grey_levels(sigma: float) -> np.ndarray:
    """(VALUES,) int16: the same times sigma, in whole grey levels."""
    return np.rint(normal() * np.float64(sigma)).astype(np.int16)


def chosen(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count,) uint16: which value each reading gets."""
    return rng.integers(0, 2**64, -(-count // 4), np.uint64).astype("<u8", copy=False).view("<u2")[:count]


@compiled
def add_grey(pixels, which, levels, out):
    """out (N,) uint8: pixels (N,) uint8 with their noise, within 0 to 255."""
    for i in range(len(pixels)):
        out[i] = min(max(np.int64(pixels[i]) + np.int64(levels[which[i]]), 0), 255)


@compiled
def measure_depth(ideal_m, which, values, sigma, disparity, range_m):
    """(N,) float32 depths as a Kinect measures ideal ones (N,) float32, metres; NaN outside range_m (least, most).

    sigma: constant (m) and quadratic part (1/m) of the deviation. disparity: focal length times baseline (m px), and the
    step (px) that it is a whole number of; 0: exact."""
    (constant, quadratic), (m_px, step_px), (least, most) = sigma, disparity, range_m
    out = np.empty(len(ideal_m), np.float32)
    for i in range(len(ideal_m)):
        out[i] = values[which[i]]
    for i in range(len(ideal_m)):
        beyond = ideal_m[i] - np.float32(0.4)
        z = ideal_m[i] + (constant + quadratic * beyond * beyond) * out[i]
        if step_px > 0.0:
            z = m_px / (np.rint(m_px / z / step_px) * step_px)
        out[i] = z if z > 0.0 and z >= least and z <= most else np.float32(np.nan)
    return out
