"""Compiled loops of the triangulation in corridor_fit: one track after the other instead of all in step.

Lengths of residuals are in units of rays; a point is azimuth, elevation and inverse distance from its anchor.
"""

from __future__ import annotations

import numpy as np

from rhs.api.jit import compiled

BEHIND = 1e-3  # metres: points nearer to the image plane than this are taken to be there
NEAREST_RHO = 5.0  # 1/m: nothing is nearer than 0.2 m


@compiled
def _bearing(azimuth, elevation, out):
    """Rows of out (3, 3): unit vector, its derivative by azimuth, by elevation."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    out[0, 0], out[0, 1], out[0, 2] = ce * ca, ce * sa, se
    out[1, 0], out[1, 1], out[1, 2] = -ce * sa, ce * ca, 0.0
    out[2, 0], out[2, 1], out[2, 2] = -se * ca, -se * sa, ce


@compiled
def _view(rotation, arm, bearing, rho, ray, out):
    """Residual of one view in out[:, 3], its prediction's derivative by azimuth, elevation, rho in out[:, :3]."""
    p = np.zeros(3)
    for k in range(3):
        for j in range(3):
            p[k] += rotation[j, k] * (rho * arm[j] + bearing[0, j])
    z = max(p[2], BEHIND)
    for axis in range(2):
        out[axis, 3] = ray[axis] - p[axis] / z
    for m in range(3):
        turned = np.zeros(3)
        for k in range(3):
            for j in range(3):
                turned[k] += rotation[j, k] * (bearing[m + 1, j] if m < 2 else arm[j])
        for axis in range(2):
            out[axis, m] = turned[axis] / z - p[axis] * turned[2] / (z * z)


@compiled
def _cost(rotation, centre, anchor, x, rays, seen):
    """Sum of squared residuals of one track at x = (azimuth, elevation, rho)."""
    bearing = np.zeros((3, 3))
    _bearing(x[0], x[1], bearing)
    total = 0.0
    for i in range(len(seen)):
        if seen[i]:
            p0 = p1 = p2 = 0.0
            for j in range(3):
                q = x[2] * (anchor[j] - centre[i, j]) + bearing[0, j]
                p0 += rotation[i, j, 0] * q
                p1 += rotation[i, j, 1] * q
                p2 += rotation[i, j, 2] * q
            z = max(p2, BEHIND)
            total += (rays[i, 0] - p0 / z) ** 2 + (rays[i, 1] - p1 / z) ** 2
    return total


@compiled
def _normal(rotation, centre, anchor, x, rays, seen):
    """Normal matrix (3, 3) and slope (3,) of one track at x."""
    bearing, one = np.zeros((3, 3)), np.zeros((2, 4))
    _bearing(x[0], x[1], bearing)
    matrix, slope = np.zeros((3, 3)), np.zeros(3)
    for i in range(len(seen)):
        if seen[i]:
            _view(rotation[i], anchor - centre[i], bearing, x[2], rays[i], one)
            for a in range(3):
                for axis in range(2):
                    slope[a] += one[axis, a] * one[axis, 3]
                    for b in range(3):
                        matrix[a, b] += one[axis, a] * one[axis, b]
    return matrix, slope


@compiled
def free_points(rotation, centre, rays, seen, anchor, angles, guesses, iterations):
    """Levenberg-Marquardt from the best guess of rho along each start angle.

    rotation (N, 3, 3) map_from_camera, centre (N, 3), rays (T, N, 2), seen (T, N), anchor (T, 3), angles (T, 2),
    guesses (G,). Returns x (T, 3), cost (T,), and the variance of rho per squared noise of a ray (T,)."""
    t = len(rays)
    found, costs, spread = np.zeros((t, 3)), np.zeros(t), np.zeros(t)
    for k in range(t):
        x, cost = np.array([angles[k, 0], angles[k, 1], guesses[0]]), np.inf
        for guess in guesses:
            trial = np.array([angles[k, 0], angles[k, 1], guess])
            new = _cost(rotation, centre, anchor[k], trial, rays[k], seen[k])
            if new < cost:
                x, cost = trial, new
        damping, matrix = 1e-3, np.eye(3)
        for _ in range(iterations):
            matrix, slope = _normal(rotation, centre, anchor[k], x, rays[k], seen[k])
            ridged = matrix.copy()
            for a in range(3):
                ridged[a, a] += damping * matrix[a, a] + 1e-12
            trial = x + np.linalg.solve(ridged, slope)
            trial[2] = min(max(trial[2], -0.05), NEAREST_RHO)
            new = _cost(rotation, centre, anchor[k], trial, rays[k], seen[k])
            if new < cost:
                x, cost, damping = trial, new, 0.2 * damping
            else:
                damping *= 10.0
        found[k], costs[k] = x, cost
        spread[k] = np.linalg.inv(matrix + 1e-12 * np.eye(3))[2, 2]
    return found, costs, spread


@compiled
def points_on_planes(rotation, centre, rays, seen, anchor, angles, normals, levels, iterations):
    """Gauss-Newton in azimuth and elevation for points with normals[k] . p = levels[k]. Returns x (T, 3), cost (T,)."""
    t = len(rays)
    found, costs = np.zeros((t, 3)), np.zeros(t)
    bearing = np.zeros((3, 3))
    for k in range(t):
        gap = levels[k] - np.dot(normals[k], anchor[k])
        if abs(gap) < 1e-6:
            gap = 1e-6
        x = np.array([angles[k, 0], angles[k, 1], 0.0])
        for step in range(iterations + 1):
            _bearing(x[0], x[1], bearing)
            x[2] = np.dot(normals[k], bearing[0]) / gap
            if step == iterations:
                break
            matrix, slope = _normal(rotation, centre, anchor[k], x, rays[k], seen[k])
            u, v = np.dot(normals[k], bearing[1]) / gap, np.dot(normals[k], bearing[2]) / gap
            a = matrix[0, 0] + 2.0 * u * matrix[0, 2] + u * u * matrix[2, 2] + 1e-12
            b = matrix[0, 1] + u * matrix[1, 2] + v * matrix[0, 2] + u * v * matrix[2, 2]
            d = matrix[1, 1] + 2.0 * v * matrix[1, 2] + v * v * matrix[2, 2] + 1e-12
            p, q = slope[0] + u * slope[2], slope[1] + v * slope[2]
            det = a * d - b * b
            x[0] += min(max((d * p - b * q) / det, -0.1), 0.1)
            x[1] += min(max((a * q - b * p) / det, -0.1), 0.1)
        found[k] = x
        costs[k] = _cost(rotation, centre, anchor[k], x, rays[k], seen[k])
    return found, costs
