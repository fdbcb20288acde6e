"""One depth picture laid on another by its surfaces: projective point-to-plane ICP on the floor.

Blais and Levine 1995 for the pairing (each point with what the other picture shows where it lands), Chen and Medioni 1992
for the distance along the normal. Here with three degrees of freedom, the belief as a prior, so that a lone wall leaves the
place along it as it was believed, and Huber weights, so that what changed pulls little.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.geometry import inverse, se2, transform

from .changes import Sight

ROUNDS = 12
STRIDE = 4  # every so many pixels, across and down
PAIRED_M = (0.3, 0.08)  # surfaces further apart are not the same: in the first round, in the last
HUBER_M = 0.02
PRIOR_M, PRIOR_RAD = 0.05, np.radians(2.0)  # 1 sigma of the belief about where one picture was taken beside the other
LEAST_PAIRS = 30


def aligned(moved: Sight, fixed: Sight) -> Sight:
    """`moved` at the pose on the floor where its surfaces lie on those of `fixed` best."""
    points = moved.some_points_m(STRIDE)
    points = points[np.isfinite(points[:, 2])]
    target, camera_from_map = fixed.points_m.reshape(*fixed.depth.shape, 3), inverse(fixed.map_from_camera)
    origin = moved.map_from_body[:2, 3]
    step = np.zeros(3)
    for paired_m in np.geomspace(*PAIRED_M, ROUNDS):
        shifted = transform(_about(origin, step), points)
        found = _pairs(shifted, transform(camera_from_map, shifted), fixed, target, paired_m=paired_m)
        if found is None:
            return moved
        at, distance_m, normal = found
        arm = at[:, :2] - origin
        jacobian = np.column_stack([normal[:, :2], normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]])
        weight = 1.0 / np.maximum(np.abs(distance_m), HUBER_M) / HUBER_M
        prior = np.diag([PRIOR_M**-2, PRIOR_M**-2, PRIOR_RAD**-2]) * len(at) ** 0.5
        information = (jacobian * weight[:, None]).T @ jacobian + prior
        step = step - np.linalg.solve(information, (jacobian * weight[:, None]).T @ distance_m + prior @ step)
    return replace(moved, map_from_body=_about(origin, step) @ moved.map_from_body)


def _about(origin: np.ndarray, step: np.ndarray) -> np.ndarray:
    """4x4: turn by step[2] about the origin (2,), then shift by step[:2]."""
    there, back = se2(origin[0] + step[0], origin[1] + step[1], step[2]), se2(-origin[0], -origin[1], 0.0)
    pose: np.ndarray = there @ back
    return pose


def _pairs(points: np.ndarray, seen: np.ndarray, fixed: Sight, target: np.ndarray, *, paired_m: float,
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """(points (N, 3), how far each lies before the surface it lands on (N,), that surface's normal (N, 3)). seen: the same
    points in the fixed camera."""
    x, y = fixed.camera.project(seen).T
    height, width = fixed.depth.shape
    with np.errstate(invalid="ignore"):
        inside = np.flatnonzero((x >= -0.5) & (x < width - 0.5) & (y >= -0.5) & (y < height - 0.5))
    points = points[inside]
    columns, rows = np.rint(x[inside]).astype(int), np.rint(y[inside]).astype(int)
    normal = fixed.normals[rows, columns]
    distance_m = np.einsum("ni,ni->n", points - target[rows, columns], normal)
    with np.errstate(invalid="ignore"):
        good = np.flatnonzero(np.abs(distance_m) < paired_m)
    return (points[good], distance_m[good], normal[good]) if len(good) >= LEAST_PAIRS else None
