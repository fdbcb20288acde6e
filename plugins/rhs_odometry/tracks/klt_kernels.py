"""Compiled loops of the front end: the patch round a point as its first view showed it, found again in later views.

Inverse compositional registration (Baker and Matthews 2004, section 3.2) with an affine warp (Shi and Tomasi 1994)
and free brightness. A patch is side x side samples round its point, side = 2 half + 1, at offsets (x, y) in pixels of
the view it comes from. A warp is the (2, 3) matrix [A | t]: offset x lies at A x + t in the present view.
"""

from __future__ import annotations

import numpy as np

from rhs.api.jit import compiled

PARAMETERS = 6


@compiled
def _sample(image, x, y):
    """Bilinear value at pixel (x, y), which must lie inside the image."""
    i, j = int(y), int(x)
    a, b = y - i, x - j
    top = (1.0 - b) * image[i, j] + b * image[i, j + 1]
    return (1.0 - a) * top + a * ((1.0 - b) * image[i + 1, j] + b * image[i + 1, j + 1])


@compiled
def _descent(wide, patch, rows, half, soft_px):
    """From samples (side + 2, side + 2) of one point: its patch, its descent rows; returns its normal matrix (6, 6)."""
    side = 2 * half + 1
    total, mean, normal = 0.0, np.zeros(PARAMETERS), np.zeros((PARAMETERS, PARAMETERS))
    weight = np.zeros(side * side)
    for r in range(side):
        for c in range(side):
            i, dx, dy = r * side + c, c - half, r - half
            patch[i] = wide[r + 1, c + 1]
            gx = 0.5 * (wide[r + 1, c + 2] - wide[r + 1, c])
            gy = 0.5 * (wide[r + 2, c + 1] - wide[r, c + 1])
            weight[i] = np.exp(-0.5 * (dx * dx + dy * dy) / (soft_px * soft_px))
            total += weight[i]
            rows[i, 0], rows[i, 1], rows[i, 2] = gx * dx, gx * dy, gx
            rows[i, 3], rows[i, 4], rows[i, 5] = gy * dx, gy * dy, gy
            for a in range(PARAMETERS):
                mean[a] += weight[i] * rows[i, a]
    mean /= total
    for i in range(side * side):
        for a in range(PARAMETERS):
            rows[i, a] -= mean[a]
        for a in range(PARAMETERS):
            for b in range(a + 1):
                normal[a, b] += weight[i] * rows[i, a] * rows[i, b]
        for a in range(PARAMETERS):
            rows[i, a] *= weight[i]
    return normal


@compiled
def remember(image, pixels, half, soft_px):
    """Patches (N, side^2), descent rows (N, side^2, 6) and gains (N, 6, 6) of the points at pixels (N, 2).

    A descent row holds the weighted derivatives by the warp, with their mean taken off so that brightness is free; the
    gain is the inverse of their normal matrix. Points must lie half + 2 pixels inside the image. soft_px: weights fall off
    with this distance from the middle (1 sigma)."""
    side = 2 * half + 1
    n, m = len(pixels), side * side
    patches, rows, gains = np.zeros((n, m)), np.zeros((n, m, PARAMETERS)), np.zeros((n, PARAMETERS, PARAMETERS))
    wide = np.zeros((side + 2, side + 2))
    for k in range(n):
        for r in range(side + 2):
            for c in range(side + 2):
                wide[r, c] = _sample(image, pixels[k, 0] + c - half - 1, pixels[k, 1] + r - half - 1)
        normal = _descent(wide, patches[k], rows[k], half, soft_px)
        for a in range(PARAMETERS):
            for b in range(a):
                normal[b, a] = normal[a, b]
            normal[a, a] = 1.001 * normal[a, a] + 1e-3
        gains[k] = np.linalg.inv(normal)
    return patches, rows, gains


@compiled
def _compare(image, patch, rows, warp, slope, half):
    """Root mean square of what the image under the warp shows more than the patch, its mean taken off; -1 where the warp
    leaves the image. slope (6,): sum of descent rows times that difference."""
    side = 2 * half + 1
    height, width = image.shape
    total, square = 0.0, 0.0
    slope[:] = 0.0
    for r in range(side):
        for c in range(side):
            dx, dy = c - half, r - half
            x = warp[0, 0] * dx + warp[0, 1] * dy + warp[0, 2]
            y = warp[1, 0] * dx + warp[1, 1] * dy + warp[1, 2]
            if not (x >= 0.0 and y >= 0.0 and x < width - 1.0 and y < height - 1.0):
                return -1.0
            i = r * side + c
            more = _sample(image, x, y) - patch[i]
            total += more
            square += more * more
            for a in range(PARAMETERS):
                slope[a] += rows[i, a] * more
    m = side * side
    return np.sqrt(max(square / m - (total / m) ** 2, 0.0))


@compiled
def find_again(image, patches, rows, gains, warps, iterations, least_px, half):
    """Refine warps (N, 2, 3) in place until a step is shorter than least_px; returns (N,) rms difference of brightness,
    infinite where the patch left the image or fell apart."""
    n = len(patches)
    misfit, slope = np.full(n, np.inf), np.zeros(PARAMETERS)
    for k in range(n):
        w = warps[k]
        for _ in range(iterations):
            misfit[k] = _compare(image, patches[k], rows[k], w, slope, half)
            step = np.dot(gains[k], slope)
            a, b, c, d = 1.0 + step[0], step[1], step[3], 1.0 + step[4]
            det = a * d - b * c
            if misfit[k] < 0.0 or not (det > 0.25 and det < 4.0):
                misfit[k] = np.inf
                break
            tx, ty = -(d * step[2] - b * step[5]) / det, -(a * step[5] - c * step[2]) / det
            moved = 0.0
            for row in range(2):  # warp <- warp o (identity + step)^-1
                p, q = w[row, 0], w[row, 1]
                shift = p * tx + q * ty
                w[row, 0], w[row, 1] = (p * d - q * c) / det, (q * a - p * b) / det
                w[row, 2] += shift
                moved = max(moved, abs(shift))
            if moved < least_px:
                break
    return misfit
