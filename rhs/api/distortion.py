"""What a lens does to points of the plane z = 1, and how it is undone: OpenCV's model (Brown 1971)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

SETTLED = 1e-9  # a step of Newton's this short leaves its square, less than a number of 64 bits holds


def distorted(x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Where a lens with OpenCV's (k1, k2, p1, p2, k3), or with k4, k5, k6 of the rational model after them, puts ideal
    points (x, y) of the plane z = 1 (Brown 1971)."""
    p1, p2 = (*coefficients, *[0.0] * 8)[2:4]
    r2 = x * x + y * y
    radial, _ = _radial(r2, coefficients)
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def lens_slopes(x: np.ndarray, y: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """xx, xy, yy of the Jacobian of `distorted`, which is symmetric."""
    p1, p2 = (*coefficients, *[0.0] * 8)[2:4]
    radial, slope = _radial(x * x + y * y, coefficients)
    slope = 2.0 * slope
    return (radial + slope * x * x + 2 * p1 * y + 6 * p2 * x, slope * x * y + 2 * p1 * x + 2 * p2 * y,
            radial + slope * y * y + 6 * p1 * y + 2 * p2 * x)


def _radial(r2: np.ndarray, coefficients: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """By how much a lens stretches at a squared radius, and its derivative by that."""
    k1, k2, _, _, k3, k4, k5, k6 = (*coefficients, *[0.0] * 8)[:8]
    over, slope = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), k1 + r2 * (2 * k2 + r2 * 3 * k3)
    if len(coefficients) <= 5:
        return over, slope
    under = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    return over / under, (slope - over / under * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / under


def undistorted(
    x: np.ndarray, y: np.ndarray, coefficients: Sequence[float], iterations: int = 10
) -> tuple[np.ndarray, np.ndarray]:
    """The ideal points that such a lens puts at (x, y): `distorted` the other way round, by Newton's steps. Steps from point
    to point (u = x - its own distortion) would not settle in the corners of a wide pincushion."""
    u, v = x, y
    for _ in range(iterations):
        du, dv = distorted(u, v, coefficients)
        xx, xy, yy = lens_slopes(u, v, coefficients)
        area = np.maximum(xx * yy - xy * xy, 0.05)  # where the lens folds there is no way back: go on in small steps
        right, down = (yy * (x - du) - xy * (y - dv)) / area, (xx * (y - dv) - xy * (x - du)) / area
        u, v = u + right, v + down
        if not (np.abs(right) > SETTLED).any() and not (np.abs(down) > SETTLED).any():
            break
    return u, v
