"""Poses and points that explain sightings best: one pose alone, or a window of key frames with its points.

Gauss-Newton with Huber weights; of the window Levenberg-Marquardt with the points eliminated (Schur complement; Triggs et
al., "Bundle adjustment - a modern synthesis", 2000). Poses are camera_from_map with left perturbation exp(delta) @ pose,
sightings are rays x/z, y/z, and residuals are pixels of a focal length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import exp_se3, orthonormal, transform


@dataclass(frozen=True, eq=False)
class Sightings:
    """Sighting k: point row[k] seen by camera of[k] (both int) along ray[k] (2,). focal: pixels; huber_px: beyond it a
    sighting pulls with constant force."""

    of: np.ndarray
    row: np.ndarray
    ray: np.ndarray
    focal: float
    huber_px: float


def residuals(pose: np.ndarray, points: np.ndarray, rays: np.ndarray, focal: float) -> np.ndarray:
    """(N, 2) pixels between where (N, 3) points are seen from a pose and (N, 2) rays; infinite behind the camera."""
    at = transform(pose, points)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = focal * (at[:, :2] / at[:, 2:] - rays)
    off[~(at[:, 2] > 1e-6)] = np.inf
    return off


def _slopes(at: np.ndarray, focal: float) -> np.ndarray:
    """(N, 2, 3) slopes of the pixel by the point in the camera frame."""
    z = at[:, 2]
    out = np.zeros((len(at), 2, 3))
    out[:, 0, 0] = out[:, 1, 1] = focal / z
    out[:, 0, 2], out[:, 1, 2] = -focal * at[:, 0] / z**2, -focal * at[:, 1] / z**2
    return out


def _by_pose(slopes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(N, 2, 6) slopes by the left perturbation (translation first)."""
    cross = np.zeros((len(at), 3, 3))
    x, y, z = at.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = z, -y, x
    cross[:, 1, 0], cross[:, 2, 0], cross[:, 2, 1] = -z, y, -x
    return np.concatenate([slopes, slopes @ cross], axis=2)


def _weights(off: np.ndarray, huber_px: float) -> np.ndarray:
    size = np.linalg.norm(off, axis=1)
    return np.minimum(1.0, huber_px / np.maximum(size, 1e-12))


def fit_pose(pose: np.ndarray, points: np.ndarray, rays: np.ndarray, *, focal: float,
             huber_px: float) -> tuple[np.ndarray, np.ndarray]:
    """(camera_from_map, its information (6, 6) at a sigma of one pixel) from a start, of points (N, 3) seen along rays."""
    information = np.eye(6)
    for _ in range(6):
        at = transform(pose, points)
        good = at[:, 2] > 1e-6
        at = at[good]
        off = focal * (at[:, :2] / at[:, 2:] - rays[good])
        slope = _by_pose(_slopes(at, focal), at)
        weighed = slope * _weights(off, huber_px)[:, None, None]
        information = np.einsum("nij,nik->jk", weighed, slope) + 1e-6 * np.eye(6)
        step = -np.linalg.solve(information, np.einsum("nij,ni->j", weighed, off))
        pose = orthonormal(exp_se3(step) @ pose)
        if np.abs(step).max() < 1e-7:
            break
    return pose, information


def adjust(poses: np.ndarray, points: np.ndarray, seen: Sightings, *, fixed: int,
           rounds: int) -> tuple[np.ndarray, np.ndarray]:
    """Better (C, 4, 4) camera_from_map and (P, 3) points. The first `fixed` poses stay."""
    damping, cost = 1e-4, _cost(poses, points, seen)
    for _ in range(rounds):
        for _ in range(4):
            new = _step(poses, points, seen, fixed=fixed, damping=damping)
            there = _cost(*new, seen)
            if there < cost:
                break
            damping *= 10.0
        else:
            break
        gained, (poses, points), cost, damping = cost - there, new, there, max(damping / 10.0, 1e-8)
        if gained < 1e-4 * cost:
            break
    return poses, points


def _cost(poses: np.ndarray, points: np.ndarray, seen: Sightings) -> float:
    at = _seen_from(poses, points, seen)
    if not np.all(at[:, 2] > 1e-6):
        return np.inf
    size, limit = np.linalg.norm(seen.focal * (at[:, :2] / at[:, 2:] - seen.ray), axis=1), seen.huber_px
    return float(np.where(size < limit, 0.5 * size**2, limit * (size - 0.5 * limit)).sum())


def _seen_from(poses: np.ndarray, points: np.ndarray, seen: Sightings) -> np.ndarray:
    return np.einsum("nij,nj->ni", poses[seen.of, :3, :3], points[seen.row]) + poses[seen.of, :3, 3]


@dataclass(frozen=True, eq=False)
class _Normal:
    """Blocks of the normal equations: of poses (C, 6, 6) and (C, 6), of points (P, 3, 3) and (P, 3), mixed (C, P, 6, 3)."""

    of_pose: np.ndarray
    to_pose: np.ndarray
    of_point: np.ndarray
    to_point: np.ndarray
    mixed: np.ndarray


def _normal(poses: np.ndarray, points: np.ndarray, seen: Sightings) -> _Normal:
    cameras, count = len(poses), len(points)
    at = _seen_from(poses, points, seen)
    off = seen.focal * (at[:, :2] / at[:, 2:] - seen.ray)
    slope = _slopes(at, seen.focal)
    by_pose, by_point = _by_pose(slope, at), slope @ poses[seen.of, :3, :3]
    weight = _weights(off, seen.huber_px)[:, None, None]
    turned_pose, turned_point = np.swapaxes(weight * by_pose, 1, 2), np.swapaxes(weight * by_point, 1, 2)
    out = _Normal(np.zeros((cameras, 6, 6)), np.zeros((cameras, 6)), np.zeros((count, 3, 3)), np.zeros((count, 3)),
                  np.zeros((cameras, count, 6, 3)))
    np.add.at(out.of_pose, seen.of, turned_pose @ by_pose)
    np.add.at(out.of_point, seen.row, turned_point @ by_point)
    np.add.at(out.to_pose, seen.of, (turned_pose @ off[:, :, None])[:, :, 0])
    np.add.at(out.to_point, seen.row, (turned_point @ off[:, :, None])[:, :, 0])
    out.mixed[seen.of, seen.row] = turned_pose @ by_point
    return out


def _step(poses: np.ndarray, points: np.ndarray, seen: Sightings, *, fixed: int,
          damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses and points after one damped step."""
    normal = _normal(poses, points, seen)
    for block in (normal.of_pose, normal.of_point):
        diagonal = np.einsum("nii->ni", block)
        diagonal += damping * diagonal + 1e-9
    inverse_point = np.linalg.inv(normal.of_point)
    free = np.arange(fixed, len(poses))
    gained = np.einsum("cpij,pjk->cpik", normal.mixed[free], inverse_point)
    flat = gained.transpose(0, 2, 1, 3).reshape(6 * len(free), -1)
    schur = -flat @ normal.mixed[free].transpose(0, 2, 1, 3).reshape(6 * len(free), -1).T
    for n, camera in enumerate(free):
        schur[6 * n : 6 * n + 6, 6 * n : 6 * n + 6] += normal.of_pose[camera]
    d_pose = np.zeros((len(poses), 6))
    right = normal.to_pose[free].reshape(-1) - flat @ normal.to_point.reshape(-1)
    d_pose[free] = -np.linalg.solve(schur, right).reshape(-1, 6)
    back = normal.to_point + np.einsum("cpij,ci->pj", normal.mixed, d_pose)
    moved = np.array([orthonormal(exp_se3(d) @ pose) if d.any() else pose for d, pose in zip(d_pose, poses, strict=True)])
    return moved, points - np.einsum("pij,pj->pi", inverse_point, back)
