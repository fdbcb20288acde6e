"""From triangulated tracks to one measurement update of the corridor filter.

Every track is linearised about its own fit; what it says about its own point is projected away (the null space of the
multi-state filter of Mourikis and Roumeliotis 2007), and what remains speaks about poses and planes only. Instead of
rotating into the null space the rows are projected onto it, which gives the same sums and the same gate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from rhs.estimation.filters.kalman import gate

from .fit import TrackFit, WindowCameras, by_camera_point, by_point, plane_rho, residuals, seen_from
from .state import PER_CLONE, CorridorState


@dataclass(frozen=True, eq=False)
class Rows:
    """Linearised tracks, in units of sigma: residual (T, R), jacobian (T, R, D) by the state, R = 2 N; rows of unseen
    views are zero. dof (T,): independent numbers left. gamma (T,): their normalised innovation squared;
    innovation (T, R, R): what they may differ by from the state."""

    residual: np.ndarray
    jacobian: np.ndarray
    dof: np.ndarray
    gamma: np.ndarray
    innovation: np.ndarray

    def moved_back(self, shift: np.ndarray) -> Rows:
        """The same rows as a measurement of the (D,) error of the prior, when they were linearised `shift` away from it."""
        if not shift.any():
            return self
        residual = self.residual + self.jacobian @ shift
        gamma = (residual * np.linalg.solve(self.innovation, residual[..., None])[..., 0]).sum(1)
        return replace(self, residual=residual, gamma=gamma)

    def passed(self, probability: float = 0.99) -> np.ndarray:
        """(T,) bool: the track agrees with the state."""
        return (self.dof > 0) & (self.gamma < np.array([_gate(int(d), probability) for d in self.dof]))

    def sums(self, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Information (D, D) and vector (D,) of the tracks in the (T,) mask."""
        rows = self.jacobian[keep].reshape(-1, self.jacobian.shape[2])
        return rows.T @ rows, rows.T @ self.residual[keep].ravel()


@cache
def _gate(dof: int, probability: float) -> float:
    return gate(dof, probability) if dof > 0 else 0.0


def free_rows(
    state: CorridorState, cameras: WindowCameras, rays: np.ndarray, seen: np.ndarray, fit: TrackFit, sigma: float
) -> Rows:
    """Rows of tracks used as free points: three numbers of each are spent on its position."""
    camera, p, point = _linearised(cameras, fit, seen)
    return _finish(state, (residuals(p, rays, seen), _by_clones(cameras, fit, camera), point, None), seen, sigma)


def plane_rows(
    state: CorridorState, cameras: WindowCameras, rays: np.ndarray, seen: np.ndarray, on: tuple[TrackFit, np.ndarray, float]
) -> Rows:
    """Rows of tracks used as points of planes. on: the fit, (T,) index of each track's plane, sigma."""
    fit, which, sigma = on
    camera, p, point = _linearised(cameras, fit, seen)
    _, by_angles, by_plane = plane_rho([state.planes[j] for j in which], fit.angles, fit.anchor)
    own = point[..., :2] + point[..., 2:] * by_angles[:, None, None, :]
    wall = point[..., 2:] * by_plane[:, None, None, :]
    parts = (residuals(p, rays, seen), _by_clones(cameras, fit, camera), own, (wall, which))
    return _finish(state, parts, seen, sigma)


def _linearised(cameras: WindowCameras, fit: TrackFit, seen: np.ndarray):
    """camera Jacobian (T, N, 2, 3), camera points (T, N, 3), Jacobian by azimuth, elevation, inverse distance."""
    _, p = seen_from(cameras, fit.angles, fit.rho, fit.anchor)
    camera = by_camera_point(p) * seen[..., None, None]
    return camera, p, by_point(cameras, fit.angles, fit.anchor, camera)


def _by_clones(cameras: WindowCameras, fit: TrackFit, camera: np.ndarray) -> np.ndarray:
    """(T, N, 2, 5) derivative of each view's ray by that view's own pose x, y, yaw, pitch, roll."""
    q, _ = seen_from(cameras, fit.angles, fit.rho, fit.anchor)
    rho = fit.rho[:, None, None]
    from_body = q + rho * (cameras.centre - cameras.body)[None]
    by_map = camera @ np.swapaxes(cameras.rotation, 1, 2)[None]
    ax, ay, az = (cameras.axes[None, :, k] for k in range(3))
    x, y, z = (from_body[..., k : k + 1] for k in range(3))
    arms = np.stack([ay * z - az * y, az * x - ax * z, ax * y - ay * x], axis=2)  # the axes, crossed with the arm
    shift = -rho[..., None] * by_map[..., :2]
    return np.concatenate([shift, -by_map @ arms], axis=3)


def _finish(state: CorridorState, parts, seen: np.ndarray, sigma: float) -> Rows:
    """Scatter into the state's columns, project the point away, gate."""
    r, by_clones, own, wall = parts
    t, n = seen.shape
    size, first = len(state.covariance), state.first_clone
    jacobian = np.zeros((t, n, 2, size))
    for i in range(n):
        jacobian[:, i, :, first + PER_CLONE * i : first + PER_CLONE * (i + 1)] = by_clones[:, i]
    if wall is not None:
        for k in range(t):
            jacobian[k, :, :, state.plane_slice(int(wall[1][k]))] = wall[0][k]
    rows, res = jacobian.reshape(t, 2 * n, size) / sigma, r.reshape(t, 2 * n, 1) / sigma
    basis = np.linalg.qr(own.reshape(t, 2 * n, -1))[0]
    rows = rows - basis @ (np.swapaxes(basis, 1, 2) @ rows)
    res = (res - basis @ (np.swapaxes(basis, 1, 2) @ res))[..., 0]
    innovation = rows @ state.covariance @ np.swapaxes(rows, 1, 2) + np.eye(2 * n)
    gamma = (res * np.linalg.solve(innovation, res[..., None])[..., 0]).sum(1)
    return Rows(res, rows, 2 * seen.sum(1) - own.shape[-1], gamma, innovation)
