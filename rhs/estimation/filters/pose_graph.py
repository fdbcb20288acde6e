"""Poses held together by relative measurements: sparse robust least squares on SE(3).

Minimises sum rho(|e_k|^2) with e_k = W_k log(Z_k^-1 X_i^-1 X_j), W_k' W_k the information of edge k, over poses moved by
right perturbations X exp(delta); the first pose is held. Levenberg-Marquardt with the normal equations factorised by
SuperLU (scipy); edges marked robust carry the Cauchy kernel by iterative reweighting.
Source: Grisetti, Kuemmerle, Stachniss, Burgard, A Tutorial on Graph-Based SLAM (2010), with SE(3) Jacobians after Sola,
Deray, Atchuthan, A micro Lie theory (2018), eqs 179-182. The tests compare with gtsam.
Planar surveys need nothing special: their odometry says by its covariance that z, roll and pitch hardly change.

One number may be solved along with the poses: by what share the metres of some edges are too short (CommonScale), such as
those of wheels whose radius is not quite known. It borders the normal equations by one row and column.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from rhs.api.geometry import inverse

from .settings import Effort

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

_Border = tuple[np.ndarray, float, float]
"""of the normal equations, what a common scale adds: its column (6N,), its own entry, its part of the gradient"""


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
    iterations: steps taken. share: of which the metres of a CommonScale are too short (0 without one)."""

    poses: np.ndarray
    chi2: np.ndarray
    iterations: int
    share: float = 0.0


@dataclass(frozen=True, eq=False)
class CommonScale:
    """edges (M,) bool: whose translations are all too short by one unknown share; sigma: what is expected of that share;
    share: as believed now."""

    edges: np.ndarray
    sigma: float
    share: float = 0.0


def optimise(
    poses: np.ndarray, edges: Edges, *, kernel: float = 3.0, scale: CommonScale | None = None, effort: Effort | None = None
) -> Solution:
    """The poses (N, 4, 4) that the edges agree on best, starting from `poses`. kernel: Cauchy scale in sigmas.
    scale: edges whose metres may be wrong by a common share."""
    effort = effort or Effort()
    scale = scale or CommonScale(np.zeros(len(edges), bool), 1.0)
    whitening = np.linalg.inv(np.linalg.cholesky(edges.covariances))
    damping, tried = 1e-6, 0
    residual, pattern = _residual(poses, edges), _Pattern(edges, len(poses))
    cost = _cost(residual, whitening, edges, kernel)
    while tried < effort.iterations:
        tried += 1
        information = _weighted(residual, whitening, edges, kernel)
        blocks, gradient, border = _normal_equations(poses, residual, information, _stretched(edges, scale), scale)
        steps, more = _solved(pattern, pattern.filled(blocks), gradient, damping, border)
        candidate, longer = _moved(poses, steps), replace(scale, share=scale.share + more)
        fresh = _residual(candidate, _stretched(edges, longer))
        fresh_cost = _cost(fresh, whitening, edges, kernel) + (longer.share / longer.sigma) ** 2
        if fresh_cost > cost:
            damping = max(damping, 1e-6) * 10.0
            if damping > 1e6:
                break
            continue
        last = cost - fresh_cost < effort.settled * (1.0 + cost)
        poses, scale, residual, cost, damping = candidate, longer, fresh, fresh_cost, damping / 10.0
        if last:
            break
    return Solution(poses, _squared(residual, whitening), tried, scale.share)


def marginals(
    poses: np.ndarray, edges: Edges, rows: np.ndarray, *, kernel: float = 3.0, scale: CommonScale | None = None
) -> np.ndarray:
    """(R, 6, 6) covariances of the solved poses at `rows` (R,), none of them the first, which is held: of their right
    perturbations, all edges heard (blocks of the inverse of the normal equations). kernel, scale: as for `optimise`."""
    scale = scale or CommonScale(np.zeros(len(edges), bool), 1.0)
    longer = _stretched(edges, scale)
    residual, pattern = _residual(poses, longer), _Pattern(edges, len(poses))
    information = _weighted(residual, np.linalg.inv(np.linalg.cholesky(edges.covariances)), edges, kernel)
    blocks, _, (column, own, _) = _normal_equations(poses, residual, information, longer, scale)
    factor = _factored(pattern.damped(pattern.filled(blocks), 1e-12))
    at = (6 * (rows - 1)[:, None] + np.arange(6)).ravel()
    asked = np.zeros((6 * (len(poses) - 1), len(at)))
    asked[at, np.arange(len(at))] = 1.0
    found = factor.solve(asked)[at]
    if column.any():
        tied = factor.solve(column[6:])
        found += np.outer(tied[at], tied[at]) / (own - column[6:] @ tied)
    each = np.arange(len(rows))
    out: np.ndarray = found.reshape(len(rows), 6, len(rows), 6)[each, :, each]
    out = 0.5 * (out + np.swapaxes(out, 1, 2))
    return out


def chain(poses: np.ndarray, covariances: np.ndarray) -> Edges:
    """The odometry edges of a trajectory: each pose (N, 4, 4) seen from the one before; covariances (N - 1, 6, 6)."""
    count = max(len(poses) - 1, 0)
    steps = inverse(poses[:-1]) @ poses[1:]
    return Edges(np.arange(count), np.arange(1, count + 1), steps, covariances, np.zeros(count, bool))


def joined(first: Edges, second: Edges) -> Edges:
    """Both sets of edges, in order."""
    return Edges(*(np.concatenate([getattr(first, f.name), getattr(second, f.name)]) for f in fields(Edges)))


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
    squared: np.ndarray = (np.einsum("nij,nj->ni", whitening, residual) ** 2).sum(axis=1)
    return squared


def _cost(residual: np.ndarray, whitening: np.ndarray, edges: Edges, kernel: float) -> float:
    squared = _squared(residual, whitening)
    return float(np.where(edges.robust, kernel**2 * np.log1p(squared / kernel**2), squared).sum())


def _stretched(edges: Edges, scale: CommonScale) -> Edges:
    """The edges with the metres of those of the common scale made longer by its share."""
    if scale.share == 0.0:
        return edges
    longer = edges.from_from_to.copy()
    longer[scale.edges, :3, 3] *= 1.0 + scale.share
    return replace(edges, from_from_to=longer)


def _weighted(residual: np.ndarray, whitening: np.ndarray, edges: Edges, kernel: float) -> np.ndarray:
    """(M, 6, 6) information of the edges, less where the kernel doubts them."""
    weight = np.where(edges.robust, 1.0 / (1.0 + _squared(residual, whitening) / kernel**2), 1.0)
    information: np.ndarray = np.einsum("nki,nkj,n->nij", whitening, whitening, weight)
    return information


def _normal_equations(
    poses: np.ndarray, residual: np.ndarray, information: np.ndarray, edges: Edges, scale: CommonScale
) -> tuple[np.ndarray, np.ndarray, _Border]:
    """Of A delta = -b: the blocks (4, M, 6, 6) that A sums, of from-from, from-to, to-from and to-to, the vector b (6N,),
    and what the common scale adds to them: its column (6N,), its own entry and its part of b."""
    by_to = _right_jacobian_inverse(residual)
    by_from = -by_to @ adjoints(inverse(poses[edges.to_at]) @ poses[edges.from_at])
    by_scale = _by_scale(edges, scale)
    gradient, column, blocks = np.zeros((len(poses), 6)), np.zeros((len(poses), 6)), np.empty((2, 2, *by_to.shape))
    for some, at_a, jac_a in zip(blocks, (edges.from_at, edges.to_at), (by_from, by_to), strict=True):
        left = np.swapaxes(jac_a, 1, 2) @ information
        np.add.at(gradient, at_a, np.einsum("nij,nj->ni", left, residual))
        if scale.edges.any():
            np.add.at(column, at_a, np.einsum("nij,nj->ni", left, by_scale))
        for room, jac_b in zip(some, (by_from, by_to), strict=True):
            np.matmul(left, jac_b, out=room)
    pull = np.einsum("nij,nj->ni", information, by_scale)
    own, along = (pull * by_scale).sum() + scale.sigma**-2, (pull * residual).sum() + scale.share / scale.sigma**2
    return blocks.reshape(4, *by_to.shape), gradient.ravel(), (column.ravel(), float(own), float(along))


def _by_scale(edges: Edges, scale: CommonScale) -> np.ndarray:
    """(M, 6) derivative of the residuals by the common share, at small residuals: -R' t of the measured motion."""
    out = np.zeros((len(edges), 6))
    chosen = edges.from_from_to[scale.edges]
    out[scale.edges, :3] = -np.einsum("nji,nj->ni", chosen[:, :3, :3], chosen[:, :3, 3])
    return out


class _Pattern:
    """Where the blocks of the edges stand in the sparse matrix of all poses but the first, which is held: worked out once,
    filled at each step."""

    def __init__(self, edges: Edges, count: int) -> None:
        rows = np.concatenate([edges.from_at, edges.from_at, edges.to_at, edges.to_at]) - 1
        columns = np.concatenate([edges.from_at, edges.to_at, edges.from_at, edges.to_at]) - 1
        free = np.flatnonzero((rows >= 0) & (columns >= 0))
        names = columns[free] * count + rows[free]
        order = np.argsort(names, kind="stable")
        self._taken = free[order]
        places, self._begin = np.unique(names[order], return_index=True)
        column, row = np.divmod(places, count)
        deep = np.bincount(column, minlength=count - 1)  # blocks that stand in each column of blocks
        rank = np.arange(len(places)) - np.concatenate([[0], np.cumsum(deep)])[column]
        self._size, self._ends = 6 * (count - 1), np.concatenate([[0], np.cumsum(np.repeat(6 * deep, 6))])
        six = np.arange(6)
        self._at = self._ends[6 * column[:, None] + six][:, None, :] + (6 * rank[:, None] + six)[:, :, None]  # (B, 6, 6)
        self._rows = np.empty(36 * len(places), np.int32)
        self._rows[self._at] = (6 * row[:, None] + six)[:, :, None]
        self._diagonal = self._at[row == column][:, six, six].ravel()

    def filled(self, blocks: np.ndarray) -> np.ndarray:
        """The values of the matrix, which sums these blocks (4, M, 6, 6)."""
        values = np.empty(len(self._rows))
        values[self._at] = np.add.reduceat(blocks.reshape(-1, 6, 6)[self._taken], self._begin, axis=0)
        return values

    def damped(self, values: np.ndarray, damping: float) -> csc_matrix:
        """The sparse matrix of these values with a diagonal longer by a share."""
        from scipy.sparse import csc_matrix

        values = values.copy()
        values[self._diagonal] += damping * values[self._diagonal]
        return csc_matrix((values, self._rows, self._ends), (self._size, self._size))


def _solved(pattern: _Pattern, values: np.ndarray, gradient: np.ndarray, damping: float, border: _Border,
            ) -> tuple[np.ndarray, float]:
    """(N, 6) steps, of which the first is none, and the step of the common share. border: its column (6N,), its own entry
    and its part of the gradient."""
    column, own, along = border
    factor = _factored(pattern.damped(values, damping))
    step = factor.solve(-gradient[6:])
    if not column.any():
        return np.vstack([np.zeros(6), step.reshape(-1, 6)]), 0.0
    tied = factor.solve(column[6:])
    more = -(along + column[6:] @ step) / (own - column[6:] @ tied)
    return np.vstack([np.zeros(6), (step - more * tied).reshape(-1, 6)]), float(more)


def _factored(matrix: csc_matrix) -> Any:
    """The factors of a matrix."""
    from scipy.sparse import identity
    from scipy.sparse.linalg import splu

    try:
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    except RuntimeError:  # sharp and vague edges side by side: the pivots have to be chosen
        try:
            return splu(matrix)
        except RuntimeError:  # or what the edges say of some pose is nothing beside the rest, to the last bit
            return splu((matrix + 1e-9 * matrix.diagonal().max() * identity(matrix.shape[0])).tocsc())


def _moved(poses: np.ndarray, steps: np.ndarray) -> np.ndarray:
    out: np.ndarray = poses @ exp_poses(steps)
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
