"""Rigid motion between two views whose key-points have depth: RANSAC, weighted Procrustes, reprojection refinement.

Everywhere `p` (N, 3) are points in the camera frame of view b, `q` (N, 3) the same points in the camera frame of view
a, and the result is a_from_b with the covariance of its right perturbation (see rhs.api.geometry).
Used by the odometry, by the check of a recognised place and by loop closing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rhs.api.geometry import align, exp_se3, orthonormal, transform
from rhs.estimation.filters.kalman import symmetric

from .settings import RansacSettings

PRIOR_PAIRS = 10.0  # pairs that the noise expected beforehand is worth against the noise that the pairs show
MEDIAN_TO_SIGMA = 1.4826  # of a normal distribution
HUBER = 2.0  # sigmas beyond which a pair pulls no harder


@dataclass(frozen=True)
class PointNoise:
    """How well a key-point with depth is known: sigma_z = constant + quadratic * (z - nearest)^2 along the optical axis
    (Nguyen, Izadi and Lovell 2012, section 4.1, for the Kinect), and pixel_px pixels across it at focal_px. share: of the
    depth, by which it is wrong as well where it was read off pictures."""

    focal_px: float
    pixel_px: float = 1.0
    constant_m: float = 0.0012
    quadratic_per_m: float = 0.0019
    nearest_m: float = 0.4
    share: float = 0.0

    def depth(self, z_m: np.ndarray) -> np.ndarray:
        """(N,) standard deviation of depth in metres at depths z_m."""
        return self.constant_m + self.quadratic_per_m * np.maximum(z_m - self.nearest_m, 0.0) ** 2 + self.share * z_m

    @property
    def numbers(self) -> np.ndarray:
        """(4,) as rhs.estimation.views.rigid_kernels takes them."""
        return np.array([self.pixel_px / self.focal_px, self.constant_m, self.quadratic_per_m, self.nearest_m, self.share])

    def isotropic(self, points: np.ndarray) -> np.ndarray:
        """(N,) one number per (N, 3) point, in metres: depth and pixel noise together."""
        sigma: np.ndarray = np.hypot(self.depth(points[:, 2]), self.pixel_px / self.focal_px * points[:, 2])
        return sigma

    def covariances(self, points: np.ndarray) -> np.ndarray:
        """(N, 3, 3) covariance of (N, 3) points: long along the ray, short across it."""
        z = points[:, 2]
        ray = points / z[:, None]
        out: np.ndarray = ray[:, :, None] * ray[:, None, :] * (self.depth(z) ** 2)[:, None, None]
        across = (self.pixel_px / self.focal_px * z) ** 2
        out[:, 0, 0] += across
        out[:, 1, 1] += across
        return out


KINECT = PointNoise(295.0)  # of a Kinect whose picture is 320 pixels wide


@dataclass(frozen=True, eq=False)
class Rigid:
    """a_from_b: 4x4. covariance: 6x6 of its right perturbation. inliers (N,) bool: the pairs that agree with it.
    misfit: mean squared residual in sigmas, about 1 when the noise is as assumed."""

    a_from_b: np.ndarray
    covariance: np.ndarray
    inliers: np.ndarray
    misfit: float = 1.0

    @property
    def count(self) -> int:
        return int(self.inliers.sum())


def ransac_rigid(
    p: np.ndarray, q: np.ndarray, *, noise: PointNoise, rng: np.random.Generator, settings: RansacSettings
) -> Rigid | None:
    """The motion most pairs agree with (Fischler and Bolles 1981), then weighted Procrustes on those pairs.

    Every hypothesis is the Procrustes motion of three pairs, all solved and scored at once by the truncated squared
    residual (MSAC, Torr and Zisserman 2000) in units of each pair's own sigma, which grows with depth.
    None when there are fewer than three pairs or no hypothesis gathers three.
    """
    if len(p) < 3:
        return None
    sigma = np.hypot(noise.isotropic(p), noise.isotropic(q))
    triples = rng.integers(0, len(p), (settings.hypotheses, 3))
    triples.sort(axis=1)
    triples = triples[(triples[:, 0] < triples[:, 1]) & (triples[:, 1] < triples[:, 2])]
    if len(triples) == 0:
        return None
    rotations, translations = _procrustes_of_triples(p[triples], q[triples])
    off = np.matmul(p, np.swapaxes(rotations, 1, 2)) + translations[:, None, :]
    off -= q
    off *= off
    squared = (off[..., 0] + off[..., 1] + off[..., 2]) / sigma**2  # five times as fast as sum() over three, the same bits
    best = int(np.minimum(squared, settings.gate_sigma**2).sum(axis=1).argmin())
    return procrustes(p, q, noise=noise, inliers=squared[best] < settings.gate_sigma**2, gate_sigma=settings.gate_sigma)


def procrustes(
    p: np.ndarray, q: np.ndarray, *, noise: PointNoise, inliers: np.ndarray, gate_sigma: float = 3.0, rounds: int = 3
) -> Rigid | None:
    """Weighted Procrustes on `inliers`, gated anew after each round. Weights are inverse variances of the pairs.

    The covariance is that of the weighted estimate under the full (ray-shaped) noise of the points, widened where the
    residuals are larger than that noise explains. None when fewer than three pairs remain.
    """
    sigma = np.hypot(noise.isotropic(p), noise.isotropic(q))
    for _ in range(rounds):
        if inliers.sum() < 3:
            return None
        pose, _ = align(p[inliers], q[inliers], 1.0 / sigma[inliers] ** 2)
        squared = ((transform(pose, p) - q) ** 2).sum(axis=1) / sigma**2
        agreed, inliers = inliers, squared < gate_sigma**2
    covariance, misfit = _procrustes_covariance(pose, p[agreed], q[agreed], noise)
    return Rigid(pose, covariance, agreed, misfit)


def refine_reprojection(
    start: Rigid, p: np.ndarray, q: np.ndarray, *, noise: PointNoise, gate_sigma: float = 3.0, iterations: int = 6
) -> Rigid:
    """Gauss-Newton on where `p` lands in view a: two pixel residuals and one of inverse depth per pair, Huber weights.

    The residual of a pair is whitened by the noise of *both* its ends carried into the image (so the estimate is the
    maximum-likelihood one to first order).
    `start` is returned unchanged if the pairs do not fix a motion.
    """
    from .rigid_kernels import normal_equations

    p, q, pose = np.ascontiguousarray(p, float), np.ascontiguousarray(q, float), np.ascontiguousarray(start.a_from_b)
    limits = np.array([3.0 * gate_sigma**2 / 2.0, HUBER])
    for _ in range(iterations):
        information, gradient, squared, inliers = normal_equations(pose, p, q, noise.numbers, limits)
        strength = np.linalg.eigvalsh(information)
        if inliers.sum() < 3 or strength[0] <= 1e-12 * strength[-1]:
            return start
        step = -np.linalg.solve(information, gradient)
        pose = pose @ exp_se3(step)
        if np.abs(step).max() < 1e-7:
            break
    misfit = float(squared[inliers].mean() / 3.0)
    return Rigid(orthonormal(pose), symmetric(np.linalg.inv(information)) * max(1.0, misfit), inliers, misfit)


def refine_measured(
    start: Rigid, p: np.ndarray, q: np.ndarray, *, noise: PointNoise, gate_sigma: float = 3.0, rounds: int = 2
) -> Rigid:
    """refine_reprojection with the noise that these pairs show: pixels and depths each have a deviation of their own, read
    off their residuals (variance components, Koch 1999, by medians), so that blur makes pixels count less and a good depth
    camera depths more. `noise` is what to expect before, worth PRIOR_PAIRS pairs. Its covariance stays that of the
    larger noise."""
    found, known = refine_reprojection(start, p, q, noise=noise, gate_sigma=gate_sigma), noise
    for _ in range(rounds):
        shown = _noise_shown(found, p, q, noise)
        found = refine_reprojection(start, p, q, noise=shown, gate_sigma=gate_sigma)
        known = replace(noise, pixel_px=max(noise.pixel_px, shown.pixel_px),
                        constant_m=max(noise.constant_m, shown.constant_m),
                        quadratic_per_m=max(noise.quadratic_per_m, shown.quadratic_per_m),
                        share=max(noise.share, shown.share))
    cautious = refine_reprojection(found, p, q, noise=known, gate_sigma=gate_sigma, iterations=1)
    return replace(found, covariance=cautious.covariance)


def _noise_shown(found: Rigid, p: np.ndarray, q: np.ndarray, noise: PointNoise) -> PointNoise:
    """The noise with its pixel and its depth part scaled to the residuals of the inliers."""
    if not found.inliers.any():
        return noise
    p, q = p[found.inliers], q[found.inliers]
    moved = transform(found.a_from_b, p)
    across_px = noise.focal_px * (moved[:, :2] / moved[:, 2:] - q[:, :2] / q[:, 2:]) / np.sqrt(2.0)
    expected = np.hypot(noise.depth(p[:, 2]) / p[:, 2] ** 2, noise.depth(q[:, 2]) / q[:, 2] ** 2)
    along = (1.0 / moved[:, 2] - 1.0 / q[:, 2]) / expected
    pixel, depth = (_shrunk(values, prior) for values, prior in ((across_px, noise.pixel_px), (along, 1.0)))
    return replace(noise, pixel_px=pixel, constant_m=depth * noise.constant_m, quadratic_per_m=depth * noise.quadratic_per_m,
                   share=depth * noise.share)


def _shrunk(residuals: np.ndarray, prior: float) -> float:
    """Deviation of residuals (N, ...) by their median size, drawn towards what was expected."""
    shown = MEDIAN_TO_SIGMA * float(np.median(np.abs(residuals)))
    count = len(residuals)
    return float(np.sqrt((count * shown**2 + PRIOR_PAIRS * prior**2) / (count + PRIOR_PAIRS)))


def _procrustes_of_triples(p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (K, 3, 3) and translations (K, 3) carrying triples p (K, 3, 3) onto q (K, 3, 3)."""
    mean_p, mean_q = p.mean(axis=1), q.mean(axis=1)
    cross = np.swapaxes(q - mean_q[:, None], 1, 2) @ (p - mean_p[:, None])
    u, _, vt = np.linalg.svd(cross)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    rotations = u @ vt
    return rotations, mean_q - (rotations @ mean_p[:, :, None])[:, :, 0]


def _procrustes_covariance(pose: np.ndarray, p: np.ndarray, q: np.ndarray, noise: PointNoise) -> tuple[np.ndarray, float]:
    """6x6 sandwich covariance of the weighted estimate, and the mean squared residual in sigmas."""
    sigma = np.hypot(noise.isotropic(p), noise.isotropic(q))
    rotation = pose[:3, :3]
    jacobian = rotation @ _motion_of_points(p)
    spread = noise.covariances(q) + rotation @ noise.covariances(p) @ rotation.T
    weighted = jacobian / (sigma**2)[:, None, None]
    bread = np.linalg.pinv(np.einsum("nai,naj->ij", weighted, jacobian))
    meat = np.einsum("nai,nab,nbj->ij", weighted, spread, weighted)
    residual = transform(pose, p) - q
    squared = np.einsum("ni,ni->n", residual, np.linalg.solve(spread, residual[:, :, None])[:, :, 0])
    misfit = float(squared.mean() / 3.0)
    return symmetric(bread @ meat @ bread) * max(1.0, misfit) + 1e-12 * np.eye(6), misfit


def _motion_of_points(p: np.ndarray) -> np.ndarray:
    """(N, 3, 6) derivative of exp(delta) p by delta at zero: [I | -hat(p)]."""
    x, y, z = p.T
    out = np.zeros((len(p), 3, 6))
    out[:, 0, 0] = out[:, 1, 1] = out[:, 2, 2] = 1.0
    out[:, 0, 4], out[:, 0, 5] = z, -y
    out[:, 1, 3], out[:, 1, 5] = -z, x
    out[:, 2, 3], out[:, 2, 4] = y, -x
    return out
