"""Poses held together by relative measurements: sparse robust least squares on SE(3).

Minimises sum rho(|e_k|^2) with e_k = W_k log(Z_k^-1 X_i^-1 X_j), W_k' W_k the information of edge k, over poses moved by
right perturbations X exp(delta); the first pose is held. Levenberg-Marquardt with the normal equations factorised by
SuperLU (scipy); edges marked robust carry the Cauchy kernel by iterative reweighting.
Source: Grisetti, Kuemmerle, Stachniss, Burgard, A Tutorial on Graph-Based SLAM (2010), with SE(3) Jacobians after Sola,
Deray, Atchuthan, A micro Lie theory (2018), eqs 179-182. The tests compare with gtsam.
Planar surveys need nothing special: their odometry says by its covariance that z, roll and pitch hardly change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .geometry import inverse


@dataclass(frozen=True, eq=False)
class Edges:
    """M relative measurements: from_at, to_at (M,) positions; from_from_to (M, 4, 4); covariances (M, 6, 6) of their
    right perturbations; robust (M,) bool: may be an outlier."""

    from_at: np.ndarray
    to_at: np.ndarray
    from_from_to: np.ndarray
    covariances: np.ndarray
    robust: np.ndarray

    def __len__(self) -> int:
        return len(self.from_at)


@dataclass(frozen=True, eq=False)
class Solution:
    """poses (N, 4, 4). chi2 (M,): squared whitened residual of each edge, six degrees of freedom, before the kernel.
    iterations: steps taken."""

    poses: np.ndarray
    chi2: np.ndarray
    iterations: int


def optimise(poses: np.ndarray, edges: Edges, *, kernel: float = 3.0, iterations: int = 30) -> Solution:
    """The poses (N, 4, 4) that the edges agree on best, starting from `poses`. kernel: Cauchy scale in sigmas."""
    whitening = np.linalg.inv(np.linalg.cholesky(edges.covariances))
    damping, tried = 1e-6, 0
    residual = _residual(poses, edges)
    cost = _cost(residual, whitening, edges, kernel)
    while tried < iterations:
        tried += 1
        matrix, gradient = _normal_equations(poses, residual, whitening, edges, kernel)
        candidate = _moved(poses, _solved(matrix, gradient, damping))
        fresh = _residual(candidate, edges)
        fresh_cost = _cost(fresh, whitening, edges, kernel)
        if fresh_cost > cost:
            damping = max(damping, 1e-6) * 10.0
            if damping > 1e6:
                break
            continue
        settled = cost - fresh_cost < 1e-9 * (1.0 + cost)
        poses, residual, cost, damping = candidate, fresh, fresh_cost, damping / 10.0
        if settled:
            break
    return Solution(poses, _squared(residual, whitening), tried)


def chain(poses: np.ndarray, covariances: np.ndarray) -> Edges:
    """The odometry edges of a trajectory: each pose (N, 4, 4) seen from the one before; covariances (N - 1, 6, 6)."""
    count = len(poses) - 1
    steps = inverse(poses[:-1]) @ poses[1:]
    return Edges(np.arange(count), np.arange(1, count + 1), steps, covariances, np.zeros(count, bool))


def joined(first: Edges, second: Edges) -> Edges:
    """Both sets of edges, in order."""
    both = [np.concatenate([getattr(first, name), getattr(second, name)]) for name in _FIELDS]
    return Edges(*both)


_FIELDS = ("from_at", "to_at", "from_from_to", "covariances", "robust")


def log_poses(poses: np.ndarray) -> np.ndarray:
    """(M, 6) twists of (M, 4, 4) poses, translation first (geometry.log_se3 for many at once)."""
    omega = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()
    theta2 = np.maximum((omega**2).sum(axis=1), 1e-16)
    theta = np.sqrt(theta2)
    half = 0.5 * theta
    small = theta < 1e-4
    factor = np.where(small, 1.0 / 12.0 + theta2 / 720.0, (1.0 - half / np.tan(np.where(small, 1.0, half))) / theta2)
    k = _hats(omega)
    left_inverse = np.eye(3) - 0.5 * k + factor[:, None, None] * (k @ k)
    return np.hstack([np.einsum("nij,nj->ni", left_inverse, poses[:, :3, 3]), omega])


def exp_poses(twists: np.ndarray) -> np.ndarray:
    """(M, 4, 4) poses of (M, 6) twists; inverse of log_poses."""
    omega = twists[:, 3:]
    theta2 = np.maximum((omega**2).sum(axis=1), 1e-16)
    theta = np.sqrt(theta2)
    a = np.where(theta < 1e-4, 0.5 - theta2 / 24.0, (1.0 - np.cos(theta)) / theta2)
    b = np.where(theta < 1e-4, 1.0 / 6.0 - theta2 / 120.0, (theta - np.sin(theta)) / (theta2 * theta))
    k = _hats(omega)
    left = np.eye(3) + a[:, None, None] * k + b[:, None, None] * (k @ k)
    out = np.tile(np.eye(4), (len(twists), 1, 1))
    out[:, :3, :3] = Rotation.from_rotvec(omega).as_matrix()
    out[:, :3, 3] = np.einsum("nij,nj->ni", left, twists[:, :3])
    return out


def adjoints(poses: np.ndarray) -> np.ndarray:
    """(M, 6, 6) adjoints of (M, 4, 4) poses."""
    out = np.zeros((len(poses), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = poses[:, :3, :3]
    out[:, :3, 3:] = _hats(poses[:, :3, 3]) @ poses[:, :3, :3]
    return out


def _residual(poses: np.ndarray, edges: Edges) -> np.ndarray:
    """(M, 6) log(Z^-1 X_i^-1 X_j)."""
    return log_poses(inverse(edges.from_from_to) @ inverse(poses[edges.from_at]) @ poses[edges.to_at])


def _squared(residual: np.ndarray, whitening: np.ndarray) -> np.ndarray:
    return (np.einsum("nij,nj->ni", whitening, residual) ** 2).sum(axis=1)


def _cost(residual: np.ndarray, whitening: np.ndarray, edges: Edges, kernel: float) -> float:
    squared = _squared(residual, whitening)
    return float(np.where(edges.robust, kernel**2 * np.log1p(squared / kernel**2), squared).sum())


def _normal_equations(poses, residual, whitening, edges: Edges, kernel: float):
    """Sparse matrix A (6N, 6N) and vector b (6N,) of A delta = -b."""
    from scipy.sparse import coo_matrix

    squared = _squared(residual, whitening)
    weight = np.where(edges.robust, 1.0 / (1.0 + squared / kernel**2), 1.0)
    information = np.einsum("nki,nkj,n->nij", whitening, whitening, weight)
    right = _right_jacobian_inverse(residual)
    by_to = right
    by_from = -right @ adjoints(inverse(poses[edges.to_at]) @ poses[edges.from_at])
    size = 6 * len(poses)
    gradient = np.zeros((len(poses), 6))
    rows, columns, values = [], [], []
    for at_a, jac_a in ((edges.from_at, by_from), (edges.to_at, by_to)):
        left = np.swapaxes(jac_a, 1, 2) @ information
        np.add.at(gradient, at_a, np.einsum("nij,nj->ni", left, residual))
        for at_b, jac_b in ((edges.from_at, by_from), (edges.to_at, by_to)):
            block = left @ jac_b
            r = 6 * at_a[:, None, None] + np.arange(6)[None, :, None] + np.zeros((1, 1, 6), int)
            c = 6 * at_b[:, None, None] + np.arange(6)[None, None, :] + np.zeros((1, 6, 1), int)
            rows.append(r.ravel())
            columns.append(c.ravel())
            values.append(block.ravel())
    matrix = coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (size, size))
    return matrix.tocsc(), gradient.ravel()


def _solved(matrix, gradient: np.ndarray, damping: float) -> np.ndarray:
    """(N, 6) steps; the first pose stays."""
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    inner = matrix[6:, 6:]
    damped = (inner + damping * diags(inner.diagonal())).tocsc()
    step = splu(damped, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(-gradient[6:])
    return np.vstack([np.zeros(6), step.reshape(-1, 6)])


def _moved(poses: np.ndarray, steps: np.ndarray) -> np.ndarray:
    out = poses @ exp_poses(steps)
    out[:, :3, :3] = Rotation.from_matrix(out[:, :3, :3]).as_matrix()  # orthonormal again
    out[0] = poses[0]
    return out


def _right_jacobian_inverse(twists: np.ndarray) -> np.ndarray:
    """(M, 6, 6) inverse right Jacobian of SE(3), I + ad / 2 + ad^2 / 12: exact to fourth order, and residuals are small."""
    ad = np.zeros((len(twists), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = _hats(twists[:, 3:])
    ad[:, :3, 3:] = _hats(twists[:, :3])
    return np.eye(6) + 0.5 * ad + ad @ ad / 12.0


def _hats(v: np.ndarray) -> np.ndarray:
    """(M, 3, 3) cross-product matrices of (M, 3) vectors."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out
