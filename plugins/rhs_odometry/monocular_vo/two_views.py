"""The first two views of a map: the motion between them and the points they show, or why they do not tell.

The five-point method (Nister 2004) and RANSAC as in OpenCV; the pose with most points in front of both cameras. A pair that
a turn alone explains, or whose points are seen under too small an angle, tells no distances and is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from rhs.api.geometry import se3

from .bundle import residuals
from .config import MonocularVo


@dataclass(frozen=True, eq=False)
class TwoViews:
    """b_from_a (4x4), points (N, 3) in camera a, in units of their median distance; good (N,) bool: which are to be
    believed; turn (3, 3): b from a by rotation alone; reason: empty, or why there is no map."""

    turn: np.ndarray
    reason: str = ""
    b_from_a: np.ndarray = field(default_factory=lambda: np.eye(4))
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    good: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))


def first_pair(a: np.ndarray, b: np.ndarray, focal: float, settings: MonocularVo) -> TwoViews:
    """a, b (N, 2): rays x/z, y/z of the same points in two views."""
    turn = turn_of(a, b)
    if len(a) < 2 * settings.min_inliers:
        return TwoViews(turn, f"{len(a)} points followed, {2 * settings.min_inliers} needed to begin a map")
    off = focal * np.linalg.norm(turned(a, turn) - b, axis=1)
    if np.percentile(off, 75) < 3.0 * settings.pixel_sigma:
        return TwoViews(turn, f"a turn alone explains the views to {np.percentile(off, 75):.1f} px: no parallax")
    essential, mask = cv2.findEssentialMat(a, b, np.eye(3), method=cv2.RANSAC, prob=0.999,
                                           threshold=2.0 * settings.pixel_sigma / focal)
    if essential is None or essential.shape != (3, 3):
        return TwoViews(turn, "no essential matrix fits the two views")
    _, rotation, way, _ = cv2.recoverPose(essential, a, b, np.eye(3), mask=mask.copy())
    pose = se3(rotation, way.ravel())
    points = triangulated(np.eye(4), pose, a, b)
    with np.errstate(invalid="ignore"):
        fits = [np.linalg.norm(residuals(p, points, rays, focal), axis=1) < settings.advanced.gate_px
                for p, rays in ((np.eye(4), a), (pose, b))]
    good = fits[0] & fits[1]
    if good.mean() < settings.advanced.start_share or good.sum() < settings.min_inliers:
        return TwoViews(turn, f"{good.sum()} of {len(a)} points fit one motion and lie in front of both views")
    angle = np.degrees(np.median(parallax(np.eye(4), pose, points[good])))
    if angle < settings.start_parallax_deg:
        needed = settings.start_parallax_deg
        return TwoViews(turn, f"points are seen under {angle:.2f} degrees, {needed:g} needed: no parallax")
    unit = float(np.median(points[good, 2]))
    return TwoViews(turn, "", se3(rotation, way.ravel() / unit), points / unit, good)


def turn_of(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """3x3 rotation that takes rays a (N, 2) best to rays b: Kabsch, three times on the nearer three quarters."""
    p, q = unit_rays(a), unit_rays(b)
    keep, rotation = np.ones(len(a), bool), np.eye(3)
    for _ in range(4):
        if keep.sum() < 3:
            return rotation
        u, _, vt = np.linalg.svd(q[keep].T @ p[keep])
        rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
        off = np.linalg.norm(p @ rotation.T - q, axis=1)
        keep = off <= np.percentile(off, 75)
    return rotation


def unit_rays(rays: np.ndarray) -> np.ndarray:
    """(N, 3) of length 1."""
    out = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def turned(rays: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(N, 2) rays seen after a turn."""
    out = unit_rays(rays) @ turn.T
    return out[:, :2] / out[:, 2:]


def triangulated(first: np.ndarray, second: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, 3) points in the map of rays a, b (N, 2) from two camera_from_map; NaN at infinity."""
    if not len(a):
        return np.zeros((0, 3))
    homogeneous = cv2.triangulatePoints(first[:3], second[:3], np.ascontiguousarray(a.T, float),
                                        np.ascontiguousarray(b.T, float))
    with np.errstate(divide="ignore", invalid="ignore"):
        points = (homogeneous[:3] / homogeneous[3]).T
    return np.where(np.isfinite(points), points, np.nan)


def parallax(first: np.ndarray, second: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) radians under which points (N, 3) see the two cameras apart."""
    eyes = [-pose[:3, :3].T @ pose[:3, 3] for pose in (first, second)]
    one, two = (points - eye for eye in eyes)
    return np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), np.sum(one * two, axis=1))
