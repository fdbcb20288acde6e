"""Compiled: which face is seen at which pixel, and the planes of its inverse depth and its texture.

Homogeneous rasterisation (Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates", Graphics Hardware
1997): edge functions are cross products of homogeneous corners, right also for corners behind the lens, so nothing is
clipped. Other than there, the pixels of a row are found as one span and not tested one by one. Pixel centres are whole
numbers. A plane (a, b, c) stands for a x + b y + c at pixel (x, y).
"""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import INNER, typed

NEAR_M = 0.01  # what is nearer to the plane of the lens is not seen
SLACK_PX = 1e-9  # faces reach over their edges by this much: a corner in the middle of another's edge leaves no crack
IN_FRONT_M = 1e-6  # corners nearer to the plane of the lens than this are not divided by their depth

LIKE_NUMPY = {"error_model": "numpy"}  # no check for a division by zero
I64, F64 = nb.int64, nb.float64
TABLE = nb.types.Array(F64, 2, "C")
SIDES = nb.types.Array(nb.uint8, 1, "C")
CORNERS = nb.types.Array(F64, 3, "C")
FACES = nb.types.Array(nb.int32, 2, "C")
DEPTHS = nb.types.Array(nb.float32, 2, "C")
NUMBERS = nb.types.Array(nb.int32, 1, "C")


@typed(nb.void(TABLE, TABLE, I64, I64, TABLE, SIDES), **LIKE_NUMPY)
def project(pixels_from_world, vertices_m, width, height, out, beyond):
    """out (V, 3) = pixels_from_world (3, 4) applied to vertices_m (V, 3): homogeneous pixels (x z, y z, z), z in metres.
    beyond (V,): a bit for each side of the view that a vertex lies beyond (Cohen and Sutherland)."""
    for i in range(len(vertices_m)):
        x, y, z = vertices_m[i, 0], vertices_m[i, 1], vertices_m[i, 2]
        for k in range(3):
            out[i, k] = (pixels_from_world[k, 0] * x + pixels_from_world[k, 1] * y + pixels_from_world[k, 2] * z
                         + pixels_from_world[k, 3])
        x, y, z = out[i, 0], out[i, 1], out[i, 2]
        beyond[i] = ((z < NEAR_M) | ((x < 0.0) << 1) | ((x > (width - 1) * z) << 2) | ((y < 0.0) << 3)
                     | ((y > (height - 1) * z) << 4))


@typed(nb.void(TABLE, I64, I64, TABLE, I64), **LIKE_NUMPY, **INNER)
def cross(corners, i, j, out, k):
    """Row k of out: corner i times corner j. The other way round it is exactly the negative."""
    ax, ay, az = corners[i, 0], corners[i, 1], corners[i, 2]
    bx, by, bz = corners[j, 0], corners[j, 1], corners[j, 2]
    out[k, 0], out[k, 1], out[k, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@typed(nb.types.UniTuple(I64, 2)(TABLE, I64, I64, I64), **LIKE_NUMPY, **INNER)
def extent(corners, count, axis, size):
    """First and last pixel along an axis (0: columns, 1: rows) the face may touch; all if it reaches behind the lens."""
    low, high = np.inf, -np.inf
    for k in range(count):
        if corners[k, 2] <= IN_FRONT_M:
            return 0, size - 1
        at = corners[k, axis] / corners[k, 2]
        low, high = min(low, at), max(high, at)
    low, high = max(low - SLACK_PX, 0.0), min(high + SLACK_PX, size - 1.0)
    return int(np.ceil(low)), int(np.floor(high))


@typed(nb.boolean(TABLE, I64, TABLE, I64), **LIKE_NUMPY, **INNER)
def inverse_depth(corners, count, planes, n):
    """Planes[n, :3] = the plane of 1/z through the first three corners. False for a face seen from behind or edge on."""
    ax, ay, az = corners[0, 0], corners[0, 1], corners[0, 2]
    bx, by, bz = corners[1, 0], corners[1, 1], corners[1, 2]
    cx, cy, cz = corners[2, 0], corners[2, 1], corners[2, 2]
    det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    if det >= 0.0:  # pixels have y down: counter-clockwise corners have a negative one
        return False
    bx, by, bz, cx, cy, cz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    planes[n, 0], planes[n, 1], planes[n, 2] = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    for k in range(3):
        planes[n, k] /= det
    planes[n, 9] = det
    return True


@typed(I64(TABLE, I64, TABLE, I64, TABLE), **LIKE_NUMPY, **INNER)
def find_edges(corners, count, planes, n, edges):
    """The lines that bound the face, written to edges; how many. The inside of a line has a x + b y + c > 0.

    A row of edges is (a, -b/a, -c/a), so that the line meets row y at -b/a y - c/a, or (0, b, c) for a level one."""
    nearest = np.inf
    for k in range(count):
        cross(corners, (k + 1) % count, k, edges, k)
        nearest = min(nearest, corners[k, 2])
    if nearest < NEAR_M:  # the near plane is one more edge: 1/near - 1/z >= 0
        edges[count, 0], edges[count, 1] = -planes[n, 0], -planes[n, 1]
        edges[count, 2] = 1.0 / NEAR_M - planes[n, 2]
        count += 1
    for k in range(count):
        a, b = edges[k, 0], edges[k, 1]
        edges[k, 2] += SLACK_PX * (abs(a) + abs(b))
        if a != 0.0:
            edges[k, 1], edges[k, 2] = -b / a, -edges[k, 2] / a
    return count


@typed(nb.types.UniTuple(I64, 2)(TABLE, I64, I64, I64), **LIKE_NUMPY, **INNER)
def span(edges, count, y, width):
    """First pixel of row y inside all edges, and the first one after them: left ends belong to the face, right ends not."""
    left, right = 0.0, float(width)
    for k in range(count):
        a, b, c = edges[k, 0], edges[k, 1], edges[k, 2]
        if a == 0.0:
            inside = b * y + c
            if inside < 0.0 or (inside == 0.0 and b <= 0.0):
                return 0, 0
        elif a > 0.0:
            left = max(left, c + b * y)
        else:
            right = min(right, c + b * y)
    return (int(np.ceil(left)), int(np.ceil(right))) if left < right else (0, 0)


@typed(nb.void(TABLE, CORNERS, I64, TABLE, I64), **LIKE_NUMPY, **INNER)
def texture_planes(corners, uv, f, planes, n):
    """Planes[n, 3:9] = the planes of u/z and v/z, from uv[f] (3, 2) at the first three corners in texels."""
    det = planes[n, 9]
    sides = np.empty((2, 3))
    cross(corners, 2, 0, sides, 0)
    cross(corners, 0, 1, sides, 1)
    for k in range(2):
        along, across = (uv[f, 1, k] - uv[f, 0, k]) / det, (uv[f, 2, k] - uv[f, 0, k]) / det
        for i in range(3):
            planes[n, 3 + 3 * k + i] = uv[f, 0, k] * planes[n, i] + along * sides[0, i] + across * sides[1, i]


@typed(I64(TABLE, SIDES, FACES, CORNERS, DEPTHS, FACES, TABLE, NUMBERS), **LIKE_NUMPY)
def find_visible(vertices_px, beyond, faces, uv, inverse_m, seen, planes, shown):
    """Which face is nearest at each pixel: the z-buffer, on 1/z, which is linear over the picture.

    vertices_px (V, 3), beyond (V,): of `project`. faces (F, 5): three or four vertices counter-clockwise as seen (the
    fourth -1: a triangle), in one plane and convex, and the texture. uv (F, 3, 2): texels at the first three. Written over
    zeros and -1: inverse_m (H, W), 1/z; seen (H, W), the row of planes. Written: planes (N, 10), 1/z, u/z, v/z and the
    determinant; shown (N,), the face of each row. Returns how many rows there are. Of faces equally near the first is
    seen."""
    height, width = inverse_m.shape
    corners, edges, n = np.empty((4, 3)), np.empty((5, 3)), 0
    for f in range(len(faces)):
        count = 4 if faces[f, 3] >= 0 else 3
        if beyond[faces[f, 0]] & beyond[faces[f, 1]] & beyond[faces[f, 2]] & beyond[faces[f, count - 1]]:
            continue  # all corners lie beyond one side
        for k in range(count):
            for i in range(3):
                corners[k, i] = vertices_px[faces[f, k], i]
        first, last = extent(corners, count, 0, width)
        top, bottom = extent(corners, count, 1, height)
        if first > last or top > bottom or not inverse_depth(corners, count, planes, n):
            continue
        lines = find_edges(corners, count, planes, n, edges)
        nearer = False
        for y in range(top, bottom + 1):
            begin, end = span(edges, lines, y, width)
            row = planes[n, 1] * y + planes[n, 2]
            for x in range(begin, end):
                inverse = np.float32(row + planes[n, 0] * x)
                if inverse > inverse_m[y, x]:
                    inverse_m[y, x], seen[y, x], nearer = inverse, n, True
        if nearer:
            texture_planes(corners, uv, f, planes, n)
            shown[n], n = f, n + 1
    return n
