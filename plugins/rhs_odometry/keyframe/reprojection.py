"""Camera pose from points of known position and uncertain depth: robust Gauss-Newton on pixels and inverse depth.

A point stands in the map as its anchor camera saw it: on a ray, at inverse depth rho with deviation sigma_rho. Seen
again from the pose camera_from_map = (R, t) it should appear at Q = R P + t. The residual of one sighting is

    r = [ f (Qx/Qz - x') , f (Qy/Qz - y') , 1/Qz - 1/z' ]            pixels, pixels, 1/m

with covariance diag(s_px^2, s_px^2, s_rho^2) + a a' sigma_rho^2, where a = dr/drho of the anchor: a point of unknown
depth still says where the camera turned, and nothing about how far it moved along that ray. Deviation of a disparity
camera's inverse depth is constant, so near points weigh more (Khoshelham and Elberink, Sensors 2012). Weights of
Student's t (Kerl et al., ICRA 2013) bound what a wrong match can do.

Most cameras read an image row by row while they move (rolling shutter; Hedborg et al., CVPR 2012). Row v, counted from
the middle in image heights (s = -0.5 .. 0.5), is seen from exp(s xi) camera_from_map; the twist xi of a frame is
estimated with its pose under a prior. On TUM freiburg1 this removes most of the residual that is not blur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dgesv

from rhs.api.geometry import orthonormal
from rhs.api.jit import compiled, inner

MEDIAN_CHI2 = 2.366  # of three degrees of freedom
_STILL = np.eye(3)


@dataclass(frozen=True)
class Noise:
    """Deviations of one sighting: of a pixel (px) and of inverse depth (1/m); a sighting off by more than gate
    deviations (Mahalanobis, 3 degrees of freedom) is no inlier. shutter_m, shutter_rad: how far a camera moves and
    turns while one image is read (0: all rows at once). student_dof: degrees of freedom of Student's t (Kerl et al.)"""

    pixel: float = 1.0
    inverse_depth: float = 0.003
    gate: float = 5.0
    shutter_m: float = 0.0
    shutter_rad: float = 0.0
    student_dof: float = 5.0


@dataclass(frozen=True, eq=False)
class Sightings:
    """What one image says of map points, N rows each.

    points (N, 3) in the map; centres (N, 3): where their anchor cameras stood; rho (N,), sigma_rho (N,): inverse depth
    in the anchor and its deviation, 1/m; rays (N, 2): x/z, y/z seen now; inverse_depth (N,): 1/m seen now, NaN unknown;
    rows (N,): image row from the middle, -0.5 top .. 0.5 bottom.
    """

    points: np.ndarray
    centres: np.ndarray
    rho: np.ndarray
    sigma_rho: np.ndarray
    rays: np.ndarray
    inverse_depth: np.ndarray
    rows: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, eq=False)
class PoseFit:
    """camera_from_map (4x4) of the middle row, shutter twist (6,) over one image height, inlier mask (N,), information
    (6x6) of a left perturbation exp(d) @ camera_from_map, root mean square of the inliers' pixel residuals. misfit:
    variance of unit weight (Koch 1999), robust, 1 or more: the residuals are so much larger than the noise told explains,
    and information / misfit is that of the noise that they show."""

    camera_from_map: np.ndarray
    inliers: np.ndarray
    information: np.ndarray
    pixel_rms: float
    shutter: np.ndarray = field(default_factory=lambda: np.zeros(6))
    misfit: float = 1.0

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) of map_from_camera's right perturbation: exp(d) camera_from_map has the inverse ... exp(-d)."""
        covariance = np.linalg.inv(self.information + 1e-3 * np.eye(6))
        return 0.5 * (covariance + covariance.T)


def fit_pose(
    sightings: Sightings, start: np.ndarray, *, focal: float, noise: Noise, iterations: int = 10, shutter=None
) -> PoseFit:
    """The pose that explains the sightings best, from a start within reach. Degenerate input gives small information.

    shutter (6,): the expected twist, the mean of its prior; None is zero."""
    s = sightings
    expected = np.zeros(6) if shutter is None else shutter
    if len(s) < 3:
        return PoseFit(start.copy(), np.zeros(len(s), bool), np.zeros((6, 6)), np.nan, expected)
    weak = [noise.shutter_m] * 3 + [noise.shutter_rad] * 3
    prior = np.array([1.0 / max(w, 1e-7) ** 2 for w in weak])
    pose, twist, information, distance, pixels = _gauss_newton(
        np.ascontiguousarray(s.points, float), np.ascontiguousarray(s.centres, float), s.rho.astype(float),
        s.sigma_rho.astype(float), np.ascontiguousarray(s.rays, float), s.inverse_depth.astype(float),
        s.rows.astype(float), np.ascontiguousarray(start, float), expected.astype(float), prior,
        np.array([focal, noise.pixel, noise.inverse_depth, noise.student_dof]), iterations,
    )
    inliers = distance < noise.gate
    rms = float(np.sqrt(np.mean(pixels[inliers] ** 2))) if inliers.any() else np.nan
    misfit = max(1.0, float(np.median(distance[inliers])) ** 2 / MEDIAN_CHI2) if inliers.any() else 1.0
    return PoseFit(orthonormal(pose), inliers, information, rms, twist, misfit)


def at_middle(points: np.ndarray, rows: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """(N, 3) points in the camera of their row, carried into the camera of the middle row (first order)."""
    return points - rows[:, None] * (twist[:3] + np.cross(twist[3:], points))


def _gauss_newton(points, centres, rho, sigma_rho, rays, inverse_depth, rows, start, expected, prior, scales, iterations):
    """Student-weighted Gauss-Newton over pose and shutter twist (12 unknowns).

    Returns pose, twist, information of the pose alone, Mahalanobis distance and pixel residual per sighting. Only the sums
    over sightings are compiled: numba takes 10 s over linear algebra that NumPy and SciPy have ready.
    """
    pose, twist = start, expected
    distance, pixels = np.empty(len(points)), np.empty(len(points))
    h, g = np.zeros((12, 12)), np.zeros(12)
    diagonal = h.ravel()[::13]
    last = False
    for iteration in range(iterations + 1):
        _normal_equations(points, centres, rho, sigma_rho, rays, inverse_depth, rows, pose, twist, scales, h, g, distance,
                          pixels)
        diagonal[6:] += prior
        g[6:] += prior * (twist - expected)
        if last or iteration == iterations:
            break
        damped = h.copy()
        damped.ravel()[::13] += 1e-6 * (1.0 + diagonal)
        step = -_solved(damped, g)
        length = np.sqrt((step[:6] * step[:6]).sum())
        if length > 0.5:
            step *= 0.5 / length
        pose = _moved(step[:6], pose)
        twist = twist + step[6:]
        last = length < 1e-7
    cross = h[:6, 6:]
    return pose, twist, h[:6, :6] - dgemm(1.0, cross, _solved(h[6:, 6:], cross.T)), distance, pixels


def _solved(matrix, right):
    """numpy.linalg.solve for matrices as small as these, without its 10 us of checks."""
    *_, solution, singular = dgesv(matrix, right)
    if singular or not np.isfinite(solution).all():
        raise np.linalg.LinAlgError("Matrix is singular to machine precision, or not finite.")
    return solution


@compiled
def _normal_equations(points, centres, rho, sigma_rho, rays, inverse_depth, rows, pose, twist, scales, h, g, distance,
                      pixels):
    """Fill h (12, 12) and g (12,) from all sightings, and distance and pixels (N,) of each."""
    jacobian, wj, w, r = np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 3)), np.zeros(3)
    h[:] = 0.0
    g[:] = 0.0
    for i in range(points.shape[0]):
        squared = _residual(points[i], centres[i], rho[i], sigma_rho[i], rays[i], inverse_depth[i], rows[i], pose, twist,
                            scales, r, w, jacobian)
        distance[i] = np.sqrt(squared)
        pixels[i] = np.sqrt(r[0] * r[0] + r[1] * r[1])
        if not np.isfinite(squared):
            continue
        student = (scales[3] + 3.0) / (scales[3] + squared)
        s = rows[i]
        for k in range(3):
            for j in range(6):
                wj[k, j] = student * (w[k, 0] * jacobian[0, j] + w[k, 1] * jacobian[1, j] + w[k, 2] * jacobian[2, j])
        for j in range(6):
            slope = wj[0, j] * r[0] + wj[1, j] * r[1] + wj[2, j] * r[2]
            g[j] += slope
            g[6 + j] += s * slope
            for k in range(j, 6):
                value = jacobian[0, j] * wj[0, k] + jacobian[1, j] * wj[1, k] + jacobian[2, j] * wj[2, k]
                h[j, k] += value
                h[j, 6 + k] += s * value
                h[6 + j, 6 + k] += s * s * value
    for j in range(6):
        for k in range(j):
            h[j, k] = h[k, j]
            h[j, 6 + k] = h[k, 6 + j]
            h[6 + j, 6 + k] = h[6 + k, 6 + j]
    for j in range(6):
        for k in range(6):
            h[6 + j, k] = h[k, 6 + j]


@inner
def _residual(point, centre, rho, sigma_rho, ray, inverse_depth, row, pose, twist, scales, r, w, jacobian):
    """Fill residual r (3,), weight w (3, 3) and Jacobian by a left perturbation (3, 6); returns r' w r."""
    x0 = pose[0, 0] * point[0] + pose[0, 1] * point[1] + pose[0, 2] * point[2] + pose[0, 3]
    y0 = pose[1, 0] * point[0] + pose[1, 1] * point[1] + pose[1, 2] * point[2] + pose[1, 3]
    z0 = pose[2, 0] * point[0] + pose[2, 1] * point[1] + pose[2, 2] * point[2] + pose[2, 3]
    qx = x0 + row * (twist[0] + twist[4] * z0 - twist[5] * y0)
    qy = y0 + row * (twist[1] + twist[5] * x0 - twist[3] * z0)
    qz = z0 + row * (twist[2] + twist[3] * y0 - twist[4] * x0)
    if not qz > 0.05:
        return np.inf
    f, iz = scales[0], 1.0 / qz
    x, y = qx * iz, qy * iz
    has_depth = np.isfinite(inverse_depth)
    r[0], r[1] = f * (x - ray[0]), f * (y - ray[1])
    r[2] = iz - inverse_depth if has_depth else 0.0
    # how the residual moves with the anchor's inverse depth: along the line from the anchor's centre
    cx = pose[0, 0] * centre[0] + pose[0, 1] * centre[1] + pose[0, 2] * centre[2] + pose[0, 3]
    cy = pose[1, 0] * centre[0] + pose[1, 1] * centre[1] + pose[1, 2] * centre[2] + pose[1, 3]
    cz = pose[2, 0] * centre[0] + pose[2, 1] * centre[1] + pose[2, 2] * centre[2] + pose[2, 3]
    share = -sigma_rho / rho
    ax, ay, az = share * (qx - cx), share * (qy - cy), share * (qz - cz)
    a0, a1 = f * iz * (ax - x * az), f * iz * (ay - y * az)
    a2 = -iz * iz * az if has_depth else 0.0
    d0 = 1.0 / (scales[1] * scales[1])
    d2 = 1.0 / (scales[2] * scales[2]) if has_depth else 0.0
    # inverse of diag + a a' (Sherman-Morrison)
    b0, b1, b2 = a0 * d0, a1 * d0, a2 * d2
    c = 1.0 / (1.0 + a0 * b0 + a1 * b1 + a2 * b2)
    w[0, 0], w[1, 1], w[2, 2] = d0 - c * b0 * b0, d0 - c * b1 * b1, d2 - c * b2 * b2
    w[0, 1] = w[1, 0] = -c * b0 * b1
    w[0, 2] = w[2, 0] = -c * b0 * b2
    w[1, 2] = w[2, 1] = -c * b1 * b2
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = f * iz, 0.0, -f * x * iz
    jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = 0.0, f * iz, -f * y * iz
    jacobian[2, 0], jacobian[2, 1], jacobian[2, 2] = 0.0, 0.0, -iz * iz if has_depth else 0.0
    for k in range(3):
        u0, u1, u2 = jacobian[k, 0], jacobian[k, 1], jacobian[k, 2]
        jacobian[k, 3], jacobian[k, 4], jacobian[k, 5] = u2 * qy - u1 * qz, u0 * qz - u2 * qx, u1 * qx - u0 * qy
    total = 0.0
    for j in range(3):
        for k in range(3):
            total += r[j] * w[j, k] * r[k]
    return max(total, 0.0)


def _moved(step, pose):
    """exp(step) @ pose, translation to first order; steps are small near the optimum."""
    x, y, z = step[3:].tolist()
    theta = math.sqrt(x * x + y * y + z * z)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation = _STILL + k
    if theta >= 1e-8:
        rotation = _STILL + math.sin(theta) / theta * k + (1.0 - math.cos(theta)) / (theta * theta) * (k @ k)
    out = pose.copy()
    out[:3, :3] = rotation @ pose[:3, :3]
    out[:3, 3] = rotation @ pose[:3, 3] + step[:3]
    return out
