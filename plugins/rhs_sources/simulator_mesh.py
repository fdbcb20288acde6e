"""Faces of walls, boxes, floor and ceiling, cut into pieces, and written as Wavefront OBJ.

A face is a quad: (4, 3) corners, counter-clockwise as seen, with (4, 2) texture corners (u right, v up, both 0..1).
"""

from __future__ import annotations

import numpy as np

from rhs.api.floorplan import Box, Wall

# PyBullet's software renderer divides by the depth of a triangle's corners, also of those beside or behind the camera.
# Pieces this small are out of view before one of their corners comes level with the lens.
WALL_PIECE_M, FLOOR_PIECE_M = 0.5, 1.0
OVERLAP_M = 0.02  # walls reach a little below the floor and above the ceiling, so that no gap of a pixel shows

Quad = tuple[np.ndarray, np.ndarray]
WHOLE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def cut(corners: np.ndarray, uv: np.ndarray, columns: int, rows: int) -> list[Quad]:
    """A quad cut into columns x rows quads."""
    quads = []
    for j in range(rows):
        for i in range(columns):
            st = np.array([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]]) / (columns, rows)
            s, t = st[:, :1], st[:, 1:]
            weights = np.hstack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])
            quads.append((weights @ corners, weights @ uv))
    return quads


def wall_faces(wall: Wall, number: int) -> list[Quad]:
    """Both sides of one straight piece of a wall: the texture on the left-hand one, its mirror image on the other."""
    a, b = wall.segments_m[number]
    low, high = -OVERLAP_M, wall.height_m + OVERLAP_M
    uv = WHOLE.copy()
    uv[:, 1] = np.array([low, low, high, high]) / wall.height_m
    columns = max(1, round(float(np.hypot(*(b - a))) / WALL_PIECE_M))
    from_left = np.array([[*b, low], [*a, low], [*a, high], [*b, high]], float)
    from_right, mirrored = from_left[[1, 0, 3, 2]], uv[[1, 0, 3, 2]]
    return cut(from_left, uv, columns, 1) + cut(from_right, mirrored, columns, 1)


def box_sides(box: Box) -> list[Quad]:
    """The four upright faces of a box, sharing one strip of texture in proportion to their widths."""
    low, high = box.bottom_m, box.bottom_m + box.size_m[2]
    widths = np.array([box.size_m[0], box.size_m[1]] * 2)
    edges = np.concatenate([[0.0], np.cumsum(widths)]) / widths.sum()
    corners = box.corners_m
    quads = []
    for i in range(4):
        p, q = corners[i], corners[(i + 1) % 4]
        face = np.array([[*p, low], [*q, low], [*q, high], [*p, high]])
        uv = np.array([[edges[i], 0.0], [edges[i + 1], 0.0], [edges[i + 1], 1.0], [edges[i], 1.0]])
        quads += cut(face, uv, max(1, round(widths[i] / WALL_PIECE_M)), 1)
    return quads


def box_lids(box: Box) -> list[Quad]:
    """Top and underside of a box."""
    top = np.column_stack([box.corners_m, np.full(4, box.bottom_m + box.size_m[2])])
    return [(top, WHOLE), (top[::-1] - [0.0, 0.0, box.size_m[2]], WHOLE[::-1])]


def floor_and_ceiling(bounds_m: tuple[float, float, float, float], height_m: float) -> tuple[list[Quad], list[Quad]]:
    """The floor seen from above and the ceiling seen from below."""
    x0, y0, x1, y1 = bounds_m
    floor = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]], float)
    ceiling = floor[[1, 0, 3, 2]] + [0.0, 0.0, height_m]
    columns, rows = max(1, round((x1 - x0) / FLOOR_PIECE_M)), max(1, round((y1 - y0) / FLOOR_PIECE_M))
    return cut(floor, WHOLE, columns, rows), cut(ceiling, WHOLE, columns, rows)


def obj_text(quads: list[Quad]) -> str:
    """A Wavefront OBJ of quads, two triangles each, with texture corners and normals and without a material."""
    lines = []
    for number, (face, uv) in enumerate(quads):
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in face]
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in uv]
        lines.append("vn {:.9g} {:.9g} {:.9g}".format(*(normal / np.linalg.norm(normal))))
        for corners in ((1, 2, 3), (1, 3, 4)):
            lines.append("f " + " ".join(f"{4 * number + c}/{4 * number + c}/{number + 1}" for c in corners))
    return "\n".join(lines) + "\n"
