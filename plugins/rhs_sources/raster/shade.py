"""Compiled: the colour and the depth of each pixel, once the face seen there is known.

Textures are uint32 texels (red in the lowest byte, then green, blue) in pyramids, each level with a border of one texel
(see textures.py). Anisotropic sampling after Schilling, Knittel and Strasser, "Texram", IEEE CG&A 16(3), 1996: probes are
spread along the longer axis of a pixel's footprint, each a bilinear one from the level that suits the shorter axis.
Deviation: level and number of probes are worked out once per block of pixels; the level is the nearest one.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import INNER, typed

from .visible import DEPTHS, F64, FACES, I64, LIKE_NUMPY, NUMBERS, TABLE

BLOCK = 8  # pixels of a row that share a level and a number of probes
ONE, TWO, NEXT = np.uint64(1), np.uint64(2), np.uint64(3)  # unsigned: no index counts from the end
TEXELS = nb.types.Array(nb.uint32, 1, "C")
LEVELS = nb.types.Array(I64, 3, "C")
LINE = nb.types.Array(F64, 1, "C")
WHOLE = nb.types.Array(I64, 1, "C")
SIZE = nb.types.UniTuple(I64, 3)  # of a level: its offset, width and height
BYTES = nb.types.Array(nb.uint8, 1, "C")
FLAGS = nb.types.Array(nb.boolean, 1, "C")
PICTURE = nb.types.Array(nb.uint8, 3, "C")


@typed(I64(TEXELS, I64, I64, I64, I64), **LIKE_NUMPY, **INNER)
def tap(texels, offset, stride, iu, iv):
    """Four neighbours weighed, each channel times 256: red from bit 0, blue from 16, green from 40.

    iu, iv: place in texels, times 256, plus 128; never negative. The weights are of 1/256 and add to one."""
    a, b = iu & 255, iv & 255
    p, below = np.uint64(offset + ((iv >> 8) - 1) * stride + (iu >> 8) - 1), np.uint64(stride)
    c00, c10 = np.int64(texels[p]), np.int64(texels[p + ONE])  # with unsigned ones numba would go on in floats
    c01, c11 = np.int64(texels[p + below]), np.int64(texels[p + below + ONE])
    c00 = (c00 & 0xFF00FF) | ((c00 & 0xFF00) << 32)
    c10 = (c10 & 0xFF00FF) | ((c10 & 0xFF00) << 32)
    c01 = (c01 & 0xFF00FF) | ((c01 & 0xFF00) << 32)
    c11 = (c11 & 0xFF00FF) | ((c11 & 0xFF00) << 32)
    w11 = (a * b + 128) >> 8
    return c00 * (256 - a - b + w11) + c10 * (a - w11) + c01 * (b - w11) + c11 * w11


@typed(nb.types.Tuple((I64, I64, F64, F64))(TABLE, I64, F64, F64, I64, I64), **LIKE_NUMPY, **INNER)
def footprint(planes, n, x, y, most, coarsest):
    """(level, probes, step u, step v) that suit pixel (x, y): steps in texels of level 0 from probe to probe."""
    w0, w1, u0, u1, v0, v1 = planes[n, 0], planes[n, 1], planes[n, 3], planes[n, 4], planes[n, 6], planes[n, 7]
    z = 1.0 / (w0 * x + w1 * y + planes[n, 2])
    u, v = (u0 * x + u1 * y + planes[n, 5]) * z, (v0 * x + v1 * y + planes[n, 8]) * z
    ux, uy, vx, vy = (u0 - u * w0) * z, (u1 - u * w1) * z, (v0 - v * w0) * z, (v1 - v * w1) * z  # texels a pixel
    across, down = ux * ux + vx * vx, uy * uy + vy * vy
    longer = max(across, down)
    if longer <= 1.0:
        return 0, 1, 0.0, 0.0
    shorter = max(min(across, down), max(1.0, longer / (most * most)))
    probes = min(max(int(np.ceil(np.sqrt(longer / shorter) - 0.25)), 1), most)
    level, beyond = 0, 2.0
    while shorter >= beyond and level < coarsest:  # log2 of its root, rounded
        level, beyond = level + 1, 4.0 * beyond
    return (level, probes, ux / probes, vx / probes) if across >= down else (level, probes, uy / probes, vy / probes)


@typed(nb.void(PICTURE, I64, I64, LINE, LINE, I64, TEXELS, LEVELS, I64), **LIKE_NUMPY, **INNER)
def paint_nearest(image, y, x, us, vs, count, texels, levels, texture):
    """Pixels of row y from x on wear the texels that hold the places us, vs."""
    offset, width, height = levels[texture, 0, 0], levels[texture, 0, 1], levels[texture, 0, 2]
    for k in range(count):
        c = np.int64(texels[offset + min(int(vs[k]), height - 1) * (width + 2) + min(int(us[k]), width - 1)])
        image[y, x + k, 0], image[y, x + k, 1], image[y, x + k, 2] = c & 255, (c >> 8) & 255, (c >> 16) & 255


@typed(nb.void(BYTES, I64, WHOLE, WHOLE, I64, TEXELS, SIZE, I64, I64, I64), **LIKE_NUMPY, **INNER)
def paint_filtered(flat, begin, us, vs, count, texels, size, probes, step_u, step_v):
    """Pixels from byte `begin` of a picture on wear the mean of probes from the places us, vs on, in texels of a level times
    256, plus 128. size: the level's offset, width and height."""
    at = np.uint64(begin)
    offset, stride, most_u, most_v = size[0], size[1] + 2, size[1] * 256 + 128, size[2] * 256 + 128
    share = 65536 // probes
    for k in range(count):
        iu, iv = us[k], vs[k]
        total, red = np.int64(0), np.int64(0)
        for _ in range(probes):
            c = tap(texels, offset, stride, min(max(iu, 128), most_u), min(max(iv, 128), most_v))
            total += c
            red += c & 0xFFFF
            iu += step_u
            iv += step_v
        total -= red
        flat[at] = (red * share + 0x800000) >> 24
        flat[at + ONE] = ((total >> 40) * share + 0x800000) >> 24
        flat[at + TWO] = (((total >> 16) & 0xFFFFFF) * share + 0x800000) >> 24
        at += NEXT


@typed(nb.void(FACES, TABLE, NUMBERS, TEXELS, LEVELS, FLAGS, I64, PICTURE, DEPTHS, I64, I64), **LIKE_NUMPY)
def shade(seen, planes, textures, texels, levels, repeats, most, image, depth_m, top, bottom):
    """Image (H, W, 3) and depth_m (H, W) of the faces seen in rows top to bottom - 1; white and NaN where there is none.

    seen, planes: of `find_visible`. textures (N,): the texture of each row of planes. levels (T, L, 3): where each level
    of a texture begins in texels, its width and height. repeats (T,): whether it goes on in copies of itself.
    most: probes at most; 0: the nearest texel, unfiltered."""
    width = seen.shape[1]
    us, vs, iu, iv = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK, np.int64), np.empty(BLOCK, np.int64)
    flat = image.reshape(-1)
    for y in range(top, bottom):
        x = 0
        while x < width:
            n, end = seen[y, x], x + 1
            while end < width and end < x + BLOCK and seen[y, end] == n:
                end += 1
            if n >= 0:
                t = textures[n]
                w, u, v = planes[n, 1] * y + planes[n, 2], planes[n, 4] * y + planes[n, 5], planes[n, 7] * y + planes[n, 8]
                w0, u0, v0, most_u, most_v = planes[n, 0], planes[n, 3], planes[n, 6], levels[t, 0, 1], levels[t, 0, 2]
                for k in range(end - x):
                    z = 1.0 / (w + w0 * (x + k))
                    us[k], vs[k] = (u + u0 * (x + k)) * z, (v + v0 * (x + k)) * z
                    depth_m[y, x + k] = z
                if repeats[t]:
                    for k in range(end - x):
                        us[k] -= np.floor(us[k] / most_u) * most_u
                        vs[k] -= np.floor(vs[k] / most_v) * most_v
                for k in range(end - x):
                    us[k], vs[k] = min(max(us[k], 0.0), float(most_u)), min(max(vs[k], 0.0), float(most_v))
                if most == 0:
                    paint_nearest(image, y, x, us, vs, end - x, texels, levels, t)
                else:
                    level, probes, du, dv = footprint(planes, n, 0.5 * (x + end - 1), y, most, levels.shape[1] - 1)
                    size, scale = (levels[t, level, 0], levels[t, level, 1], levels[t, level, 2]), 256.0 / (1 << level)
                    first = 0.5 * (1 - probes) * scale
                    first_u, first_v = int(first * du) + 128, int(first * dv) + 128
                    for k in range(end - x):
                        iu[k], iv[k] = int(us[k] * scale) + first_u, int(vs[k] * scale) + first_v
                    paint_filtered(flat, 3 * (y * width + x), iu, iv, end - x, texels, size, probes,
                                   int(du * scale), int(dv * scale))
            else:
                for i in range(x, end):
                    image[y, i, 0], image[y, i, 1], image[y, i, 2], depth_m[y, i] = 255, 255, 255, np.nan
            x = end
