"""Grey levels of a small picture between its pixels. Loads numba: import it when it is needed."""

from __future__ import annotations

import numpy as np

from rhs.api.jit import compiled


@compiled
def sampled(grey: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) grey level of a picture (h, w) at positions (N, 2) in its pixels, x before y, by bilinear interpolation, and
    (N,) its slope there, in grey levels per pixel. NaN outside the middles of its outermost pixels and at NaN."""
    height, width = grey.shape
    value, slope = np.full(len(at), np.nan), np.full(len(at), np.nan)
    for k in range(len(at)):
        x, y = at[k, 0], at[k, 1]
        if not (0.0 <= x < width - 1 and 0.0 <= y < height - 1):
            continue
        column, row = int(x), int(y)
        right, down = x - column, y - row
        top_left, top_right = float(grey[row, column]), float(grey[row, column + 1])
        low_left, low_right = float(grey[row + 1, column]), float(grey[row + 1, column + 1])
        top, low = top_left + right * (top_right - top_left), low_left + right * (low_right - low_left)
        left_fall, right_fall = low_left - top_left, low_right - top_right
        across = (1.0 - down) * (top_right - top_left) + down * (low_right - low_left)
        fall = (1.0 - right) * left_fall + right * right_fall
        value[k], slope[k] = top + down * (low - top), np.sqrt(across**2 + fall**2)
    return value, slope
