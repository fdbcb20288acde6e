"""A second look at an alignment: do the surfaces of two views lie on each other?

A library aligns a cloud with its own map by the nearest points; where a narrow view turns, the new points at its rim have
no partners and pull the others along, and the result is as smooth as a right one. The view before was measured, too: its
surface under each point of this view gives the point-to-plane distance (Chen and Medioni 1992, with the partner along the
ray, Blais and Levine 1995), and Gauss-Newton on it says which other motion would fit, and how much better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import exp_se3, transform
from rhs.estimation.views.rigid import KINECT

from .clouds import Cloud, CloudMaker, bilinear

ITERATIONS = 5


@dataclass(frozen=True, eq=False)
class SecondLook:
    """better (6,): right perturbation after which the surfaces lie on each other best. cost: mean truncated squared distance
    in sigmas as aligned, and best: after that perturbation; nan when too little of the two views overlaps."""

    better: np.ndarray
    cost: float
    best: float


def second_look(previous: Cloud, cloud: Cloud, maker: CloudMaker, motion: np.ndarray, cut: float) -> SecondLook:
    """The cloud, moved by a motion (4x4, previous_from_body), on the surface of the previous one. cut: sigmas beyond which a
    distance pulls no harder."""
    known = np.isfinite(cloud.normals).all(axis=1)
    points, normals = cloud.points[known], cloud.normals[known]
    jacobian, better = np.hstack([normals, np.cross(points, normals)]), np.zeros(6)
    first = _distances(previous, maker, motion, points, normals)
    if np.isfinite(first).sum() < 0.3 * max(len(points), 1):
        return SecondLook(better, float("nan"), float("nan"))
    at = motion
    for _ in range(ITERATIONS):
        left = _distances(previous, maker, at, points, normals)
        weight = np.where(np.isfinite(left), 1.0 / (1.0 + (np.nan_to_num(left) / cut) ** 2) ** 2, 0.0)
        scaled = jacobian / cloud.sigma[known][:, None]
        weighted = scaled * weight[:, None]
        step = np.linalg.solve(weighted.T @ scaled + 1e-3 * np.eye(6), weighted.T @ np.nan_to_num(left))
        at, better = at @ exp_se3(step), better + step
    best = _distances(previous, maker, at, points, normals)
    both = np.isfinite(first) & np.isfinite(best)
    return SecondLook(better, _cost(first[both], cut), _cost(best[both], cut))


def _cost(left: np.ndarray, cut: float) -> float:
    return float(np.minimum(left**2, cut**2).mean()) if len(left) else float("nan")


def _distances(
    previous: Cloud, maker: CloudMaker, motion: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """(N,) distance of each point to the surface that the previous view saw on its ray, along its normal, in sigmas."""
    pose = maker.camera.body_from_camera
    local = (transform(motion, points) - pose[:3, 3]) @ pose[:3, :3]
    z = local[:, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        seen = 1.0 / bilinear(1.0 / previous.depth, maker.camera.project(np.where(z[:, None] > 0.05, local, np.nan)))
        gap = (local * (seen / z - 1.0)[:, None]) @ pose[:3, :3].T  # from the point to the surface, previous body axes
        turned = normals @ motion[:3, :3].T
        distance: np.ndarray = (gap * turned).sum(axis=1) / KINECT.depth(z)
    return distance
