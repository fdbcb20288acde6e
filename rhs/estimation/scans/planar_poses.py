"""Poses of the floor as (3,) or (N, 3): x and y in metres, yaw in radians."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import wrap


def composed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Pose b, given in the frame of pose a, in the frame that a is in; many at once, (N, 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = a[..., 0] + c * b[..., 0] - s * b[..., 1], a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.ascontiguousarray(np.array([x, y, wrap(a[..., 2] + b[..., 2])]).T)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Pose b as seen from pose a, both in one frame; many at once, (N, 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.ascontiguousarray(np.array([c * dx + s * dy, c * dy - s * dx, wrap(b[..., 2] - a[..., 2])]).T)


def flat(poses: np.ndarray) -> np.ndarray:
    """(N, 3) of 4x4 poses (N, 4, 4)."""
    return np.column_stack([poses[:, 0, 3], poses[:, 1, 3], np.arctan2(poses[:, 1, 0], poses[:, 0, 0])])


def lifted(states: np.ndarray) -> np.ndarray:
    """(N, 4, 4) of (N, 3)."""
    out = np.tile(np.eye(4), (len(states), 1, 1))
    c, s = np.cos(states[:, 2]), np.sin(states[:, 2])
    out[:, 0, 0], out[:, 0, 1], out[:, 1, 0], out[:, 1, 1] = c, -s, s, c
    out[:, :2, 3] = states[:, :2]
    return out
