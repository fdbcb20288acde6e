"""Is this the same place, and from where is it seen? The geometric check of one view against another.

With depth in both views the motion between them is rigid (thesis eqs 3.1-3.7 with RANSAC); with depth in one of them it
is the camera pose from points and pixels (PnP). Without any depth nothing can be checked in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, adjoint, exp_so3, inverse, se3, transform
from rhs.api.records import Features

from .features import match
from .rigid import PointNoise, _motion_of_points, ransac_rigid, refine_reprojection
from .settings import SightingSettings

_CameraMotion = tuple[np.ndarray, np.ndarray, np.ndarray]
"""4x4 between two cameras, its covariance 6x6, which pairs agree (M,) bool"""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Key-points of one view and the camera that saw them."""

    features: Features
    camera: Camera


@dataclass(frozen=True, eq=False)
class Sighting:
    """stored_from_query: 4x4 pose of the querying body in the body frame of the stored view; covariance 6x6 of its
    right perturbation. inliers: agreeing key-points; matched: matched ones; coverage: share of those stored key-points
    that should be visible from there which were found again (0..1)."""

    stored_from_query: np.ndarray
    covariance: np.ndarray
    inliers: int
    matched: int
    coverage: float


def sight(
    stored: Snapshot, query: Snapshot, *, settings: SightingSettings, rng: np.random.Generator,
    pairs: np.ndarray | None = None
) -> Sighting | None:
    """The query seen from the stored view, or None when too few key-points agree. pairs: matches (M, 2) if known."""
    if pairs is None:
        pairs = match(query.features, stored.features, settings.ratio)
    if len(pairs) < settings.min_inliers:
        return None
    found = _camera_motion(stored, query, pairs, settings, rng)
    if found is None or found[2].sum() < settings.min_inliers:
        return None
    stored_from_query, covariance, agreed = found
    coverage = _coverage(stored, query, stored_from_query, pairs[agreed])
    if coverage < settings.min_coverage:
        return None
    move = adjoint(query.camera.body_from_camera)
    bodies = stored.camera.body_from_camera @ stored_from_query @ inverse(query.camera.body_from_camera)
    return Sighting(bodies, move @ covariance @ move.T, int(agreed.sum()), len(pairs), coverage)


def _camera_motion(stored: Snapshot, query: Snapshot, pairs: np.ndarray, settings: SightingSettings,
                   rng: np.random.Generator) -> _CameraMotion | None:
    """(stored_from_query 4x4, covariance 6x6, which pairs agree (M,) bool) between the cameras, or None."""
    p, q = query.features.points[pairs[:, 0]], stored.features.points[pairs[:, 1]]
    lifted_p, lifted_q = np.isfinite(p[:, 2]), np.isfinite(q[:, 2])
    both = lifted_p & lifted_q
    if both.sum() >= settings.min_inliers:
        return _rigid(p, q, both, query, settings, rng)
    if lifted_q.sum() >= settings.min_inliers:
        found = _pnp(q, query.features.pixels[pairs[:, 0]], lifted_q, query.camera)
        if found is None:
            return None
        query_from_stored, covariance, agreed = found
        move = adjoint(query_from_stored)
        return inverse(query_from_stored), move @ covariance @ move.T, agreed
    if lifted_p.sum() >= settings.min_inliers:
        return _pnp(p, stored.features.pixels[pairs[:, 1]], lifted_p, stored.camera)
    return None


def _rigid(p: np.ndarray, q: np.ndarray, both: np.ndarray, query: Snapshot, settings: SightingSettings,
           rng: np.random.Generator) -> _CameraMotion | None:
    noise = PointNoise(query.camera.fx, share=settings.depth_share)
    p, q = p[both].astype(float), q[both].astype(float)
    found = ransac_rigid(p, q, noise=noise, rng=rng, settings=settings.ransac)
    if found is None:
        return None
    found = refine_reprojection(found, p, q, noise=noise, gate_sigma=settings.ransac.gate_sigma)
    agreed = np.zeros(len(both), bool)
    agreed[np.nonzero(both)[0][found.inliers]] = True
    return found.a_from_b, found.covariance, agreed


def _pnp(points: np.ndarray, pixels: np.ndarray, lifted: np.ndarray, camera: Camera) -> _CameraMotion | None:
    """viewer_from_points by PnP with RANSAC; points (M, 3) in their own camera frame, pixels (M, 2) in the viewer."""
    import cv2

    cv2.setNumThreads(1)
    p, u = points[lifted].astype(float), camera.project(camera.rays(pixels[lifted].astype(float)))
    distortion = np.asarray(camera.distortion, float) if camera.distortion else None
    try:
        ok, turn, shift, inliers = cv2.solvePnPRansac(
            p, u, camera.matrix, distortion, iterationsCount=200, reprojectionError=2.0, flags=cv2.SOLVEPNP_SQPNP
        )
        if not ok or inliers is None or len(inliers) < 6:
            return None
        chosen = inliers.ravel()
        turn, shift = cv2.solvePnPRefineLM(p[chosen], u[chosen], camera.matrix, distortion, turn, shift)
    except cv2.error:  # points on one spot or line fix no pose, and OpenCV says so by failing
        return None
    pose = se3(exp_so3(turn.ravel()), shift.ravel())
    covariance = _pnp_covariance(pose, p[chosen], camera)
    agreed = np.zeros(len(lifted), bool)
    agreed[np.nonzero(lifted)[0][chosen]] = True
    return pose, covariance, agreed


def _pnp_covariance(pose: np.ndarray, points: np.ndarray, camera: Camera) -> np.ndarray:
    """6x6 covariance of the right perturbation of `pose`, from pixel noise; the noise of the points is left out."""
    moved = transform(pose, points)
    x, y, z = moved.T
    by_point = np.zeros((len(points), 2, 3))
    by_point[:, 0, 0], by_point[:, 0, 2] = camera.fx / z, -camera.fx * x / z**2
    by_point[:, 1, 1], by_point[:, 1, 2] = camera.fy / z, -camera.fy * y / z**2
    jacobian = by_point @ pose[:3, :3] @ _motion_of_points(points)
    information = np.einsum("nai,naj->ij", jacobian, jacobian)
    return np.linalg.pinv(information) + 1e-10 * np.eye(6)


def _coverage(stored: Snapshot, query: Snapshot, stored_from_query: np.ndarray, agreed: np.ndarray) -> float:
    """Share of the key-points that both views should show which were found again.

    Taken over the stored key-points that fall into the query's image, or the other way round, whichever side has
    depth; the smaller of the two shares: a painting that hangs in two places covers little of the rest of the view.
    """
    shares = []
    sides = ((stored, query, inverse(stored_from_query), 1), (query, stored, stored_from_query, 0))
    for here, there, there_from_here, column in sides:
        points = here.features.points.astype(float)
        lifted = np.isfinite(points[:, 2])
        pixels = there.camera.project(transform(there_from_here, np.where(lifted[:, None], points, np.nan)))
        with np.errstate(invalid="ignore"):
            inside = np.all((pixels >= 0) & (pixels < [there.camera.width, there.camera.height]), axis=1)
        inside[agreed[:, column]] = True
        if lifted.sum() > 0:
            shares.append(len(agreed) / max(int(inside.sum()), 1))
    return float(min(shares)) if shares else 0.0
