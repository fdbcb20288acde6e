"""The loop over pairs of points in the refinement of a rigid motion. Loads numba: import it when it is needed."""

from __future__ import annotations

import numpy as np

from rhs.api.jit import compiled, inner

NEAREST_M, BEHIND_M = 1e-3, 0.05  # depths are cut off below the first; a point nearer than the second is no inlier


@compiled
def normal_equations(
    pose: np.ndarray, p: np.ndarray, q: np.ndarray, noise: np.ndarray, limits: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Gauss-Newton's matrix (6, 6) and vector (6,) of where points p (N, 3) land beside q (N, 3) in view a, by the right
    perturbation of the pose (4, 4) a_from_b; squared residuals in sigmas (N,), and which pairs agree (N,) bool.

    Residuals are of (x/z, y/z, 1/z), whitened by the noise of both ends carried there. noise: pixels over focal length,
    constant (m) and quadratic (1/m) part of the depth noise, nearest depth (m), part that is a share of the depth. limits:
    greatest squared residual of an inlier, and where Huber's weight begins, in sigmas."""
    matrix, vector = np.zeros((6, 6)), np.zeros(6)
    squared, agree = np.empty(len(p)), np.empty(len(p), np.bool_)
    by_p, jacobian, moved = np.empty((3, 3)), np.empty((3, 6)), np.empty(3)
    residual, weight, pulled = np.empty(3), np.empty((3, 3)), np.empty((3, 6))
    for k in range(len(p)):
        for i in range(3):
            moved[i] = pose[i, 0] * p[k, 0] + pose[i, 1] * p[k, 1] + pose[i, 2] * p[k, 2] + pose[i, 3]
        depth = moved[2]
        moved[2] = max(depth, NEAREST_M)
        for i in range(2):
            residual[i] = moved[i] / moved[2] - q[k, i] / q[k, 2]
        residual[2] = 1.0 / moved[2] - 1.0 / q[k, 2]
        _projected(pose, moved, by_p)
        _weight(by_p, p[k], q[k], noise, weight)
        total = 0.0
        for i in range(3):
            for j in range(3):
                total += residual[i] * weight[i, j] * residual[j]
        squared[k], agree[k] = total, total < limits[0] and depth > BEHIND_M
        if agree[k]:
            _by_motion(by_p, p[k], jacobian)
            robust = min(1.0, limits[1] / np.sqrt(max(total, 1e-12)))
            _add(matrix, vector, jacobian, weight, residual, robust, pulled)
    return matrix, vector, squared, agree


@inner
def _projected(pose: np.ndarray, moved: np.ndarray, by_p: np.ndarray) -> None:
    """by_p (3, 3): derivative of (x/z, y/z, 1/z) of the moved point by the point before the motion."""
    x, y, z = moved
    for j in range(3):
        by_p[0, j] = pose[0, j] / z - pose[2, j] * x / z**2
        by_p[1, j] = pose[1, j] / z - pose[2, j] * y / z**2
        by_p[2, j] = -pose[2, j] / z**2


@inner
def _weight(by_p: np.ndarray, p: np.ndarray, q: np.ndarray, noise: np.ndarray, weight: np.ndarray) -> None:
    """weight (3, 3): inverse of the covariance of the residual. Either end is uncertain along its ray and across it
    (rhs.estimation.views.rigid.PointNoise); of q only the inverse depth feels the former."""
    u, v, z = p[0] / p[2], p[1] / p[2], q[2]
    along, across = _variances(p, noise)
    c = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            ray_i, ray_j = by_p[i, 0] * u + by_p[i, 1] * v + by_p[i, 2], by_p[j, 0] * u + by_p[j, 1] * v + by_p[j, 2]
            c[i, j] = along * ray_i * ray_j + across * (by_p[i, 0] * by_p[j, 0] + by_p[i, 1] * by_p[j, 1])
    along, across = _variances(q, noise)
    c[0, 0] += across / z**2
    c[1, 1] += across / z**2
    c[2, 2] += along / z**4
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            d, e = (j + 1) % 3, (j + 2) % 3
            weight[j, i] = c[a, d] * c[b, e] - c[a, e] * c[b, d]
    determinant = c[0, 0] * weight[0, 0] + c[0, 1] * weight[1, 0] + c[0, 2] * weight[2, 0]
    for i in range(3):
        for j in range(3):
            weight[i, j] /= determinant


@inner
def _variances(point: np.ndarray, noise: np.ndarray) -> tuple[float, float]:
    """Along the ray, per unit of depth, and across it, square metres."""
    deviation = noise[1] + noise[2] * max(point[2] - noise[3], 0.0) ** 2 + noise[4] * point[2]
    return deviation**2, (noise[0] * point[2]) ** 2


@inner
def _by_motion(by_p: np.ndarray, p: np.ndarray, jacobian: np.ndarray) -> None:
    """jacobian (3, 6): by_p times the derivative of exp(delta) p at zero, [I | -hat(p)]."""
    x, y, z = p
    for i in range(3):
        for j in range(3):
            jacobian[i, j] = by_p[i, j]
        jacobian[i, 3] = by_p[i, 2] * y - by_p[i, 1] * z
        jacobian[i, 4] = by_p[i, 0] * z - by_p[i, 2] * x
        jacobian[i, 5] = by_p[i, 1] * x - by_p[i, 0] * y


@inner
def _add(matrix: np.ndarray, vector: np.ndarray, jacobian: np.ndarray, weight: np.ndarray, residual: np.ndarray,
         robust: float, pulled: np.ndarray) -> None:
    """Add one pair: robust J' W J and robust J' W r. pulled (3, 6) is room for W J."""
    for i in range(3):
        for j in range(6):
            pulled[i, j] = weight[i, 0] * jacobian[0, j] + weight[i, 1] * jacobian[1, j] + weight[i, 2] * jacobian[2, j]
    for j in range(6):
        for i in range(3):
            vector[j] += robust * pulled[i, j] * residual[i]
            for n in range(6):
                matrix[j, n] += robust * jacobian[i, j] * pulled[i, n]
