"""Thinned point clouds from depth images, and what their shape tells about a motion.

The Hessian of point-to-plane alignment is H = sum J'J / s^2 with J = [n, p x n] of a point p with normal n: its small
eigenvalues are the directions in which the scene can slide along itself (Gelfand et al., 3DIM 2003; Zhang, Kaess and
Singh, ICRA 2016). Noise tilts normals, so a flat corridor would seem to have a little of every direction; and small
relief has no normals of its own in a thinned cloud. So a direction is called held by the share of the points that
either lean into it by far more than noise tilts them, or leave the surface by far more than noise when the whole view
is slid along it (points on walls stay on walls; points on a pilaster do not).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, inverse, log_se3, orthonormal
from rhs.api.records import Motion, Tracking
from rhs.estimation.views.rigid import KINECT

from .config import CloudAdvanced

USUAL = CloudAdvanced()


@dataclass(frozen=True, eq=False)
class Cloud:
    """points (N, 3) in the body frame; normals (N, 3), NaN where the surface is not smooth; sigma (N,) metres.
    depth (H, W): the image they are from, unusable values NaN."""

    points: np.ndarray
    normals: np.ndarray
    sigma: np.ndarray
    depth: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


class CloudMaker:
    """Turns depth images of one camera into clouds of one point per cell of `stride` pixels."""

    def __init__(self, camera: Camera, *, stride: int, min_range_m: float, max_range_m: float) -> None:
        rows = np.arange(stride // 2, camera.height, stride)
        columns = np.arange(stride // 2, camera.width, stride)
        u, v = np.meshgrid(columns.astype(float), rows.astype(float))
        self._stride = stride
        self.camera = camera
        self._rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(*u.shape, 3)
        self._pose = camera.body_from_camera
        self._limits = (min_range_m, max_range_m)

    def cloud(self, depth: np.ndarray) -> Cloud:
        """The cloud of an (H, W) depth image in metres; unknown, negative and far depths are left out."""
        with np.errstate(invalid="ignore"):
            depth = np.where((depth >= self._limits[0]) & (depth <= self._limits[1]), depth, np.nan)
        z = self._thinned(depth)
        points = self._rays * z[:, :, None]
        normals = _normals(points, z)
        known = np.isfinite(z)
        rotation, centre = self._pose[:3, :3], self._pose[:3, 3]
        return Cloud(points[known] @ rotation.T + centre, normals[known] @ rotation.T, KINECT.depth(z[known]), depth)

    def supports(self, cloud: Cloud, axes: np.ndarray, s: CloudAdvanced = USUAL) -> np.ndarray:
        """(K,) share of the points that hold each of the directions, the columns of `axes` (3, K), in the body frame."""
        with np.errstate(invalid="ignore"):
            leaning = np.abs(cloud.normals @ axes) > s.lean
        off = np.stack([self._leaving(cloud, s.slide_m * axis, s.sure_sigmas) for axis in axes.T], axis=1)
        return (leaning | off).mean(axis=0)

    def _leaving(self, cloud: Cloud, slide: np.ndarray, sure_sigmas: float) -> np.ndarray:
        """(N,) bool: slid by (3,) metres, the point is off the surface seen there by far more than noise.

        Compared in inverse depth, which is linear between the pixels of a plane."""
        local = (cloud.points + slide - self._pose[:3, 3]) @ self._pose[:3, :3]
        pixels = self.camera.project(local)
        seen = bilinear(1.0 / cloud.depth, pixels)
        sigma = KINECT.depth(local[:, 2]) / local[:, 2] ** 2
        with np.errstate(invalid="ignore"):
            return np.abs(seen - 1.0 / local[:, 2]) > sure_sigmas * np.sqrt(2.0) * sigma

    def _thinned(self, depth: np.ndarray) -> np.ndarray:
        """(h, w) median of five pixels in each cell: noise shrinks, edges do not smear."""
        half, step = self._stride // 2, max(self._stride // 4, 1)
        height, width = depth.shape
        picks = []
        for dv, du in ((0, 0), (-step, 0), (step, 0), (0, -step), (0, step)):
            rows = np.clip(np.arange(half, height, self._stride) + dv, 0, height - 1)
            columns = np.clip(np.arange(half, width, self._stride) + du, 0, width - 1)
            picks.append(depth[np.ix_(rows, columns)])
        stack = np.sort(np.stack(picks).astype(float), axis=0)  # NaN sorts last
        count = np.isfinite(stack).sum(axis=0)
        middle = np.take_along_axis(stack, (np.maximum(count, 1)[None] - 1) // 2, axis=0)[0]
        return np.where(count >= 3, middle, np.nan)


def bilinear(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N,) values of an (H, W) image between pixels (N, 2); NaN outside and beside unknown values."""
    height, width = image.shape
    with np.errstate(invalid="ignore"):
        inside = (pixels[:, 0] >= 0) & (pixels[:, 1] >= 0) & (pixels[:, 0] < width - 1) & (pixels[:, 1] < height - 1)
    at = np.where(inside[:, None], pixels, 0.0)
    u, v = np.floor(at).astype(int).T
    fu, fv = (at - np.floor(at)).T
    out = (1 - fv) * ((1 - fu) * image[v, u] + fu * image[v, u + 1]) + fv * (
        (1 - fu) * image[v + 1, u] + fu * image[v + 1, u + 1]
    )
    return np.where(inside, out, np.nan)


def _normals(points: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(h, w, 3) unit normals towards the camera from neighbours two cells away; NaN at borders, edges and creases.

    A surface is smooth where inverse depth bends no more than noise makes it bend: on a plane it does not bend."""
    normals = np.full(points.shape, np.nan)
    inner = (slice(2, -2), slice(2, -2))
    cross = np.cross(points[4:, 2:-2] - points[:-4, 2:-2], points[2:-2, 4:] - points[2:-2, :-4])
    length = np.linalg.norm(cross, axis=2)
    rho = 1.0 / z
    allowed = 4.0 * np.sqrt(6.0) * 0.6 * KINECT.depth(z[inner]) / z[inner] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        flat = np.abs(rho[2:-2, 4:] + rho[2:-2, :-4] - 2 * rho[inner]) < allowed
        flat &= np.abs(rho[4:, 2:-2] + rho[:-4, 2:-2] - 2 * rho[inner]) < allowed
        unit = cross / length[:, :, None]
        unit *= -np.sign((unit * points[inner]).sum(axis=2))[:, :, None]
    normals[inner] = np.where((flat & (length > 1e-9))[:, :, None], unit, np.nan)
    return normals


@dataclass(frozen=True, eq=False)
class Observability:
    """information (6, 6) of a motion of the body from the shape alone. weakest (3,): the direction of translation that
    the shape holds least. support: share of the points that hold it."""

    information: np.ndarray
    weakest: np.ndarray
    support: float


def observability(
    cloud: Cloud, maker: CloudMaker, *, on_floor: bool = False, settings: CloudAdvanced = USUAL
) -> Observability:
    """How well an alignment can know a motion in each direction of the body frame; of a robot on a floor, which is held
    up by it, in each horizontal direction."""
    known = np.isfinite(cloud.normals).all(axis=1)
    n, p, s = cloud.normals[known], cloud.points[known], cloud.sigma[known]
    if len(n) < 6:
        return Observability(np.zeros((6, 6)), np.array([1.0, 0.0, 0.0]), 0.0)
    j = np.hstack([n, np.cross(p, n)]) / s[:, None]
    free = 2 if on_floor else 3
    axes = np.zeros((3, free))
    axes[:free] = np.linalg.eigh((n.T @ n)[:free, :free])[1]
    support = maker.supports(cloud, axes, settings)
    weakest = int(np.argmin(support))
    return Observability(j.T @ j, axes[:, weakest], float(support[weakest]))


def judged(pose: np.ndarray, seen: Observability, settings, details: dict[str, float]) -> Motion:
    """An alignment's pose (4x4) as a motion, as sure as its `seen` says: `degenerate` and wide along the direction that too
    small a share of the points holds. settings: min_support, and thresholds in `advanced`."""
    a = settings.advanced
    information = seen.information / a.correlated + 1e-3 * np.eye(6)
    covariance = np.linalg.inv(information) + np.diag([a.least_m] * 3 + [a.least_rad] * 3) ** 2
    status, reason = Tracking.OK, ""
    if seen.support < settings.min_support:
        axis = np.concatenate([seen.weakest, np.zeros(3)])
        covariance = covariance + a.slipped_m**2 * np.outer(axis, axis)
        where = ", ".join(f"{v:+.2f}" for v in seen.weakest)
        status = Tracking.DEGENERATE
        reason = f"{100 * seen.support:.2f} % of the points hold the direction ({where}) of the body"
    covariance = 0.5 * (covariance + covariance.T)
    sure = np.sqrt(np.diag(np.linalg.inv(covariance)))
    return Motion(orthonormal(pose), covariance, status, reason, sure, details=details | {"support": seen.support})


def within_reach(pose: np.ndarray, guess: np.ndarray, a) -> bool:
    """Whether an alignment stayed near its guess: a scan matcher that leaps has locked on to something else. a: leap_m and
    leap_rad."""
    off = log_se3(inverse(guess) @ pose)
    return bool(np.linalg.norm(off[:3]) <= a.leap_m and np.linalg.norm(off[3:]) <= a.leap_rad)
