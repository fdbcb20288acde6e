"""Loops over key-points: ratio-test matches per stored view, key-points found again, residuals to words. Loads numba: import
it when it is needed."""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import compiled, typed

_ROWS = nb.types.Array(nb.float32, 2, "C", readonly=True)


@compiled
def count_matches(likeness: np.ndarray, bounds: np.ndarray, ratio_squared: float) -> np.ndarray:
    """(P,) rows of `likeness` (N, M), cosines of unit vectors, whose best column in bounds[p]:bounds[p + 1] passes
    Lowe's ratio test against the second best there; |a - b|^2 = 2 - 2 cos, so the test is on 1 - cos."""
    views = len(bounds) - 1
    counts = np.zeros(views)
    for row in range(likeness.shape[0]):
        for view in range(views):
            first, second = -2.0, -2.0
            for column in range(bounds[view], bounds[view + 1]):
                value = likeness[row, column]
                if value > first:
                    first, second = value, first
                elif value > second:
                    second = value
            if second > -2.0 and 1.0 - first < ratio_squared * (1.0 - second):
                counts[view] += 1.0
    return counts


@compiled
def found_again(drawn: np.ndarray, theirs: np.ndarray, pixels: np.ndarray, depths: np.ndarray, descriptors: np.ndarray,
                limits: tuple[float, float, float, float]) -> int:
    """How many of the key-points drawn into a view (N, 3: pixel x, y and depth) with descriptors `theirs` (N, 128) are among
    those seen there: pixels (M, 2), depths (M,) NaN where unknown, descriptors (M, 128). limits: greatest distance in
    pixels, share and constant (metres) of the depth, least cosine."""
    radius, share, constant, alike = limits
    count = 0
    for i in range(len(drawn)):
        for j in range(len(pixels)):
            dx, dy = pixels[j, 0] - drawn[i, 0], pixels[j, 1] - drawn[i, 1]
            if dx * dx + dy * dy >= radius * radius or abs(depths[j] - drawn[i, 2]) > share * drawn[i, 2] + constant:
                continue
            cosine = 0.0
            for d in range(theirs.shape[1]):
                cosine += descriptors[j, d] * theirs[i, d]
            if cosine > alike:
                count += 1
                break
    return count


@typed(nb.types.Array(nb.float32, 1, "C")(_ROWS, _ROWS, _ROWS))
def residuals(descriptors: np.ndarray, likeness: np.ndarray, words: np.ndarray) -> np.ndarray:
    """(W * 128,) float32: for each word the sum of what the descriptors (N, 128) whose likeness (N, W) is greatest for it
    differ from it, brought to unit length word by word and then as a whole; zero without descriptors."""
    width = descriptors.shape[1]
    out = np.zeros((len(words), width), np.float32)
    for k in range(len(descriptors)):
        word = 0
        for other in range(1, len(words)):
            if likeness[k, other] > likeness[k, word]:
                word = other
        for d in range(width):
            out[word, d] += descriptors[k, d] - words[word, d]
    used = 0
    for word in range(len(words)):
        squared = np.float32(0.0)
        for d in range(width):
            squared += out[word, d] * out[word, d]
        length = np.sqrt(squared)
        if length > 1e-6:  # below, it is what rounding left
            used += 1
            for d in range(width):
                out[word, d] /= length
    scale = np.float32(np.sqrt(max(used, 1)))
    for word in range(len(words)):
        for d in range(width):
            out[word, d] /= scale
    return out.reshape(-1)
