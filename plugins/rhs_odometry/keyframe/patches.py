"""Find a point again by its patch: a template warped as the pose and the surface say, then matched to sub-pixels.

Forster et al., "SVO: fast semi-direct monocular visual odometry", ICRA 2014, section IV-B: the template always comes
from the key frame that anchors the point, so that errors do not add up from view to view. Here the warp also knows the
slope of the surface, and brightness may change by gain and offset. Inverse compositional Gauss-Newton (Baker and
Matthews, IJCV 2004).

Sums run by column of the patch first: the columns of a row side by side in the processor, whose width does not change them.
How large a patch is the compiler knows (`size`: two tuples, as long as the patch is high and as its rows are wide with
columns that stay zero), so that no loop over it has to ask. Another `half_px` is compiled anew, once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rhs.api.jit import compiled, inner

from ..advanced import PatchSearch

USUAL = PatchSearch()


def find_patches(
    then, now, *, pixels: np.ndarray, warps: np.ndarray, guess: np.ndarray, s: PatchSearch = USUAL
) -> tuple[np.ndarray, np.ndarray]:
    """Where (N, 2) pixels of image pyramid `then` are in image pyramid `now`: (pixels (N, 2) float64, found (N,) bool).

    Pyramids are [full, half, ...] (H, W) uint8, coarse first used. warps (N, 2, 2): d pixel then / d pixel now.
    guess (N, 2): start; to be within a patch of the truth."""
    return find_patches_in(lambda _: then, np.zeros(len(pixels), int), now, pixels=pixels, warps=warps, guess=guess, s=s)


def find_patches_in(
    picture: Callable[[int], Sequence[np.ndarray]], of: np.ndarray, now, *, pixels: np.ndarray, warps: np.ndarray,
    guess: np.ndarray, s: PatchSearch = USUAL
) -> tuple[np.ndarray, np.ndarray]:
    """The same for points of many pictures: picture(k) is the pyramid of picture k, of (N,) says whose each point is."""
    where = np.array(guess, float)
    found = np.isfinite(where).all(axis=1) & np.isfinite(warps).all(axis=(1, 2))
    where[~found] = -1e3
    pixels, warps = np.ascontiguousarray(pixels, float), np.ascontiguousarray(warps, float)
    side = 2 * s.half_px + 1
    size = (0,) * side, (0,) * ((side + 7) // 8 * 8)
    rules = s.iterations, s.longest_step_px, s.least_likeness
    known = np.flatnonzero(found)
    known = known[np.argsort(of[known], kind="stable")]
    for rows in np.split(known, np.flatnonzero(np.diff(of[known])) + 1) if len(known) else ():
        then = picture(int(of[rows[0]]))
        for level in reversed(range(len(now))):
            # pyrDown keeps pixel (0, 0) on (0, 0): coordinates scale without an offset
            _align(then[level], now[level], rows, pixels, warps, where, found, 0.5**level, (size, rules))
    return where, found


@compiled
def _align(then, now, rows, pixels, warps, where, found, scale, how):
    """Move those points whose patches are found to where they are, and say which are."""
    size, (iterations, longest_px, least) = how
    side, wide = len(size[0]), len(size[1])
    warped = np.empty((side + 2, side + 2), np.float32)
    seen, sums, five = np.empty((side, wide), np.float32), np.empty(wide, np.float32), np.empty((5, wide), np.float32)
    learnt = np.zeros((3, side, wide), np.float32)
    template, gx, gy = learnt[0], learnt[1], learnt[2]
    for i in rows:
        found[i] = False
        if not _sample_warped(then, pixels[i, 0] * scale, pixels[i, 1] * scale, warps[i], warped):
            continue
        mean = _learn(warped, template, gx, gy, sums, size)
        _, _, energy, tx, ty = _compared(template, learnt, five, size)
        _, _, hxx, _, hxy = _compared(gx, learnt, five, size)
        hyy = _dot(gy, gy, sums, size)
        determinant = hxx * hyy - hxy * hxy
        if energy < side * side * 9.0 or determinant < 1e-4 * (hxx + hyy) ** 2:
            continue
        likeness, x0, y0 = 0.0, where[i, 0] * scale, where[i, 1] * scale
        x, y = x0, y0
        for _ in range(iterations):
            inside = _sample(now, x, y, mean, seen, size)
            cross, total, square, sx, sy = _compared(seen, learnt, five, size) if inside else (0.0, 0.0, 0.0, 0.0, 0.0)
            if cross <= 0.0:
                likeness = 0.0
                break
            power = square - total * total / (side * side)
            likeness = cross / np.sqrt(energy * power + 1e-9)
            gain = cross / energy
            bx, by = sx - gain * tx, sy - gain * ty
            dx = (hyy * bx - hxy * by) / (determinant * gain)
            dy = (hxx * by - hxy * bx) / (determinant * gain)
            step = np.sqrt(dx * dx + dy * dy)
            if step > longest_px:
                dx, dy = dx * longest_px / step, dy * longest_px / step
            x -= dx
            y -= dy
            if step < 0.01:
                break
        if likeness > least and (x - x0) ** 2 + (y - y0) ** 2 <= side * side:
            found[i] = True
            where[i, 0], where[i, 1] = x / scale, y / scale


@inner
def _dot(a, b, sums, size):
    """Sum of the products of two (side, wide) patches, by column first (sums (wide,) is room for that)."""
    sums[:] = np.float32(0.0)
    for r in range(len(size[0])):
        for c in range(len(size[1])):
            sums[c] += a[r, c] * b[r, c]
    total = 0.0
    for c in range(len(size[1])):
        total += sums[c]
    return total


@inner
def _compared(seen, learnt, sums, size):
    """Of a patch that is seen, in one go (sums (5, wide) is room for that): its products with the template, its sum, its
    square, its products with both slopes."""
    cross, total, square, sx, sy = sums[0], sums[1], sums[2], sums[3], sums[4]
    for c in range(len(size[1])):
        cross[c] = total[c] = square[c] = sx[c] = sy[c] = np.float32(0.0)
    for r in range(len(size[0])):
        row, template, gx, gy = seen[r], learnt[0, r], learnt[1, r], learnt[2, r]
        for c in range(len(size[1])):
            value = row[c]
            cross[c] += value * template[c]
            total[c] += value
            square[c] += value * value
            sx[c] += value * gx[c]
            sy[c] += value * gy[c]
    a = b = d = e = f = 0.0
    for c in range(len(size[1])):
        a += cross[c]
        b += total[c]
        d += square[c]
        e += sx[c]
        f += sy[c]
    return a, b, d, e, f


@inner
def _sum(a, sums, size):
    """The same of one patch."""
    sums[:] = np.float32(0.0)
    for r in range(len(size[0])):
        for c in range(len(size[1])):
            sums[c] += a[r, c]
    total = 0.0
    for c in range(len(size[1])):
        total += sums[c]
    return total


@inner
def _learn(warped, template, gx, gy, sums, size):
    """Fill template and slopes, each less its mean since brightness may be offset, from a patch with a rim of one pixel.
    Returns the template's mean."""
    side = len(size[0])
    half = np.float32(0.5)
    for r in range(side):
        for c in range(side):
            template[r, c] = warped[r + 1, c + 1]
        for c in range(side):
            gx[r, c] = half * (warped[r + 1, c + 2] - warped[r + 1, c])
        for c in range(side):
            gy[r, c] = half * (warped[r + 2, c + 1] - warped[r, c + 1])
    count = side * side
    mean = np.float32(_sum(template, sums, size) / count)
    sx, sy = np.float32(_sum(gx, sums, size) / count), np.float32(_sum(gy, sums, size) / count)
    for r in range(side):
        for c in range(side):
            template[r, c] -= mean
        for c in range(side):
            gx[r, c] -= sx
        for c in range(side):
            gy[r, c] -= sy
    return mean


@inner
def _sample(image, x, y, less, out, size):
    """Fill out with the patch centred at (x, y), less an offset; False when it leaves the image. One sub-pixel shift serves
    all."""
    height, width = image.shape
    side, wide = len(size[0]), len(size[1])
    half = side // 2
    if not (x - half >= 0 and y - half >= 0 and x + half < width - 1 and y + half < height - 1):
        return False
    u, v = int(np.floor(x)), int(np.floor(y))
    fu, fv = x - u, y - v
    a, b = np.float32((1 - fu) * (1 - fv)), np.float32(fu * (1 - fv))
    c, d = np.float32((1 - fu) * fv), np.float32(fu * fv)
    across = np.uint64(wide if u - half + wide < width else side)
    pixels, filled = image.reshape(-1), out.reshape(-1)
    one, below = np.uint64(1), np.uint64(width)  # unsigned: no index counts from the end
    for row in range(side):
        first, begin = np.uint64((v - half + row) * width + u - half), np.uint64(row * wide)
        for col in range(across):
            i = first + col
            filled[begin + col] = a * np.float32(pixels[i]) + b * np.float32(pixels[i + one]) + (
                c * np.float32(pixels[i + below]) + d * np.float32(pixels[i + below + one])) - less
        for col in range(side, wide):
            out[row, col] = np.float32(0.0)
    return True


@inner
def _sample_warped(image, x, y, warp, out):
    """Fill out with the patch centred at (x, y), every offset taken through the 2x2 warp; False when it leaves the image.
    Positions are counted in whole 65536ths of a pixel."""
    height, width = image.shape
    half = out.shape[0] // 2
    reach_x = half * (abs(warp[0, 0]) + abs(warp[0, 1])) + 0.001
    reach_y = half * (abs(warp[1, 0]) + abs(warp[1, 1])) + 0.001
    if not (x - reach_x >= 0 and y - reach_y >= 0 and x + reach_x < width - 1 and y + reach_y < height - 1):
        return False
    pixels = image.reshape(-1)
    one, below = np.uint64(1), np.uint64(width)  # unsigned: no index counts from the end
    across_x, across_y = np.int64(warp[0, 0] * 65536.0), np.int64(warp[1, 0] * 65536.0)
    part = np.float32(1.0 / 65536.0)
    for row in range(2 * half + 1):
        px = np.int64((x + warp[0, 1] * (row - half) - warp[0, 0] * half) * 65536.0)
        py = np.int64((y + warp[1, 1] * (row - half) - warp[1, 0] * half) * 65536.0)
        for col in range(2 * half + 1):
            fu, fv = np.float32(np.int32(px & 65535)) * part, np.float32(np.int32(py & 65535)) * part
            i = np.uint64((py >> 16) * width + (px >> 16))
            a, b = np.float32(pixels[i]), np.float32(pixels[i + one])
            c, d = np.float32(pixels[i + below]), np.float32(pixels[i + below + one])
            upper, lower = a + fu * (b - a), c + fu * (d - c)
            out[row, col] = upper + fv * (lower - upper)
            px += across_x
            py += across_y
    return True
