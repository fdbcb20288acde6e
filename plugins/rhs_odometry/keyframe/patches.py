"""Find a point again by its patch: a template warped as the pose and the surface say, then matched to sub-pixels.

Forster et al., "SVO: fast semi-direct monocular visual odometry", ICRA 2014, section IV-B: the template always comes
from the key frame that anchors the point, so that errors do not add up from view to view. Here the warp also knows the
slope of the surface, and brightness may change by gain and offset. Inverse compositional Gauss-Newton (Baker and
Matthews, IJCV 2004).
"""

from __future__ import annotations

import numpy as np

from rhs.api.jit import compiled

from ..advanced import PatchSearch

USUAL = PatchSearch()


def find_patches(
    then, now, *, pixels: np.ndarray, warps: np.ndarray, guess: np.ndarray, s: PatchSearch = USUAL
) -> tuple[np.ndarray, np.ndarray]:
    """Where (N, 2) pixels of image pyramid `then` are in image pyramid `now`: (pixels (N, 2) float64, found (N,) bool).

    Pyramids are [full, half, ...] (H, W) uint8, coarse first used. warps (N, 2, 2): d pixel then / d pixel now.
    guess (N, 2): start; to be within a patch of the truth."""
    where = np.asarray(guess, float).copy()
    pixels = np.asarray(pixels, float)
    found = np.isfinite(where).all(axis=1) & np.isfinite(warps).all(axis=(1, 2))
    where[~found] = -1e3
    for level in reversed(range(len(now))):
        scale = 0.5**level
        # pyrDown keeps pixel (0, 0) on (0, 0): coordinates scale without an offset
        limits = s.half_px, s.iterations, s.longest_step_px
        moved, likeness = _align(then[level], now[level], pixels * scale, warps, where * scale, limits)
        good = likeness > s.least_likeness
        where = np.where(good[:, None], moved / scale, where)
        if level == 0:
            found &= good
    return where, found


@compiled
def _align(then, now, pixels, warps, guess, limits):
    """Where the patches are, and their normalised correlation there; 0 where there was nothing to follow."""
    half, iterations, longest_px = limits
    n, side = pixels.shape[0], 2 * half + 1
    where = guess.copy()
    likeness = np.zeros(n)
    warped = np.empty((side + 2, side + 2))
    template, gx, gy = np.empty((side, side)), np.empty((side, side)), np.empty((side, side))
    patch = np.empty((side, side))
    for i in range(n):
        if not _sample_warped(then, pixels[i, 0], pixels[i, 1], warps[i], half + 1, warped):
            continue
        energy, hxx, hxy, hyy = _learn(warped, template, gx, gy)
        determinant = hxx * hyy - hxy * hxy
        if energy < side * side * 9.0 or determinant < 1e-4 * (hxx + hyy) ** 2:
            continue
        x, y = guess[i, 0], guess[i, 1]
        for _ in range(iterations):
            if not _sample(now, x, y, half, patch):
                likeness[i] = 0.0
                break
            likeness[i], gain, bx, by = _compare(patch, template, energy, gx, gy)
            if likeness[i] <= 0.0:
                break
            dx = (hyy * bx - hxy * by) / (determinant * gain)
            dy = (hxx * by - hxy * bx) / (determinant * gain)
            size = np.sqrt(dx * dx + dy * dy)
            if size > longest_px:
                dx, dy = dx * longest_px / size, dy * longest_px / size
            x -= dx
            y -= dy
            if size < 0.01:
                break
        if (x - guess[i, 0]) ** 2 + (y - guess[i, 1]) ** 2 > side * side:
            likeness[i] = 0.0
        where[i, 0] = x
        where[i, 1] = y
    return where, likeness


@compiled
def _learn(warped, template, gx, gy):
    """Fill template and slopes, each less its mean since brightness may be offset, from a patch with a rim of one pixel.
    Returns the template's energy and the three sums of products of the slopes."""
    side = template.shape[0]
    mean, sx, sy = 0.0, 0.0, 0.0
    for r in range(side):
        for c in range(side):
            template[r, c] = warped[r + 1, c + 1]
            mean += template[r, c]
            gx[r, c] = 0.5 * (warped[r + 1, c + 2] - warped[r + 1, c])
            gy[r, c] = 0.5 * (warped[r + 2, c + 1] - warped[r, c + 1])
            sx += gx[r, c]
            sy += gy[r, c]
    count = side * side
    mean, sx, sy = mean / count, sx / count, sy / count
    energy, hxx, hxy, hyy = 0.0, 0.0, 0.0, 0.0
    for r in range(side):
        for c in range(side):
            template[r, c] -= mean
            energy += template[r, c] ** 2
            gx[r, c] -= sx
            gy[r, c] -= sy
            hxx += gx[r, c] ** 2
            hxy += gx[r, c] * gy[r, c]
            hyy += gy[r, c] ** 2
    return energy, hxx, hxy, hyy


@compiled
def _compare(patch, template, energy, gx, gy):
    """Likeness of a patch to the template (0 when it is its negative), the gain of brightness, and the sums of the
    slopes times what differs."""
    side = template.shape[0]
    mean = 0.0
    for r in range(side):
        for c in range(side):
            mean += patch[r, c]
    mean /= side * side
    cross, power = 0.0, 0.0
    for r in range(side):
        for c in range(side):
            p = patch[r, c] - mean
            cross += p * template[r, c]
            power += p * p
    if cross <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    gain, bx, by = cross / energy, 0.0, 0.0
    for r in range(side):
        for c in range(side):
            e = (patch[r, c] - mean) - gain * template[r, c]
            bx += gx[r, c] * e
            by += gy[r, c] * e
    return cross / np.sqrt(energy * power + 1e-9), gain, bx, by


@compiled
def _sample(image, x, y, half, out):
    """Fill out with the patch centred at (x, y); False when it leaves the image. One sub-pixel shift serves all."""
    height, width = image.shape
    if not (x - half >= 0 and y - half >= 0 and x + half < width - 1 and y + half < height - 1):
        return False
    u, v = int(np.floor(x)), int(np.floor(y))
    fu, fv = x - u, y - v
    a, b, c, d = (1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv
    for row in range(2 * half + 1):
        for col in range(2 * half + 1):
            r, s = v - half + row, u - half + col
            out[row, col] = a * image[r, s] + b * image[r, s + 1] + c * image[r + 1, s] + d * image[r + 1, s + 1]
    return True


@compiled
def _sample_warped(image, x, y, warp, half, out):
    """The same with every offset taken through the 2x2 warp."""
    height, width = image.shape
    reach_x = half * (abs(warp[0, 0]) + abs(warp[0, 1]))
    reach_y = half * (abs(warp[1, 0]) + abs(warp[1, 1]))
    if not (x - reach_x >= 0 and y - reach_y >= 0 and x + reach_x < width - 1 and y + reach_y < height - 1):
        return False
    for row in range(2 * half + 1):
        for col in range(2 * half + 1):
            px = x + warp[0, 0] * (col - half) + warp[0, 1] * (row - half)
            py = y + warp[1, 0] * (col - half) + warp[1, 1] * (row - half)
            u, v = int(np.floor(px)), int(np.floor(py))
            fu, fv = px - u, py - v
            out[row, col] = (1 - fv) * ((1 - fu) * image[v, u] + fu * image[v, u + 1]) + fv * (
                (1 - fu) * image[v + 1, u] + fu * image[v + 1, u + 1]
            )
    return True
