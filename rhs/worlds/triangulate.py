"""Triangles of polygons in space, by cutting ears (Meisters, "Polygons have ears", 1975)."""

from __future__ import annotations

import numpy as np


def triangulated(points: np.ndarray, index: np.ndarray, *, convex: bool) -> tuple[np.ndarray, np.ndarray]:
    """points (N, 3); index: corners of polygons, each followed by -1. Returns (slots (T, 3) in index, polygon of each (T,)).

    convex: all polygons are, a fan does. Polygons with fewer than three corners are none."""
    ends = np.flatnonzero(index < 0)
    if not len(ends) or ends[-1] != len(index) - 1:
        ends = np.append(ends, len(index))
    starts = np.concatenate([[0], ends[:-1] + 1])
    slots: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    sizes = ends - starts
    for size in np.unique(sizes[sizes >= 3]).tolist():
        which = np.flatnonzero(sizes == size)
        if convex or size == 3:
            fan = np.stack([np.zeros(size - 2, int), np.arange(1, size - 1), np.arange(2, size)], axis=1)
            slots.append((starts[which, None, None] + fan).reshape(-1, 3))
            faces.append(np.repeat(which, size - 2))
            continue
        for one in which.tolist():
            ears = _ears(points[index[starts[one]:ends[one]]])
            slots.append(starts[one] + ears)
            faces.append(np.full(len(ears), one))
    if not slots:
        return np.zeros((0, 3), int), np.zeros(0, int)
    return np.concatenate(slots), np.concatenate(faces)


def _ears(corners: np.ndarray) -> np.ndarray:
    """(K - 2, 3) corners of the triangles of a plane polygon (K, 3) without holes."""
    after = np.roll(corners, -1, axis=0)
    normal = np.cross(corners, after).sum(axis=0)  # Newell's
    axis = int(np.argmax(np.abs(normal)))
    flat = np.delete(corners, axis, axis=1) * (1.0, -1.0 if (normal[axis] < 0) != (axis == 1) else 1.0)
    left = list(range(len(corners)))
    ears = []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(flat, left, k)), 0)  # 0: crosses itself; any corner will do
        ears.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    return np.array([*ears, left])


def _is_ear(flat: np.ndarray, left: list[int], k: int) -> bool:
    """Whether the triangle of a corner and its neighbours turns left and holds no other corner."""
    a, b, c = flat[left[k - 1]], flat[left[k]], flat[left[(k + 1) % len(left)]]
    if _turn(a, b, c) <= 0.0:
        return False
    others = flat[[one for one in left if one not in (left[k - 1], left[k], left[(k + 1) % len(left)])]]
    inside = (_turn(a, b, others) >= 0.0) & (_turn(b, c, others) >= 0.0) & (_turn(c, a, others) >= 0.0)
    return not bool(inside.any())


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the area of a, b, c, positive where they turn left; c may be many (N, 2)."""
    area: np.ndarray = (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
    return area
