"""Two RGB-D views laid on each other by all their pixels, where few have a corner to follow: brightness, inverse depth.

Direct alignment, coarse to fine, with weights of Student's t (Kerl, Sturm and Cremers, "Robust odometry estimation for RGB-D
cameras", ICRA 2013, and "Dense visual SLAM for RGB-D cameras", IROS 2013). Brightness may change by gain and offset. On a
plane inverse depth is linear in the pixel, so its residual is the distance of point and plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rhs.api.geometry import Camera, exp_se3, inverse, log_se3, orthonormal
from rhs.api.jit import compiled

from ..advanced import DirectSettings

LEAST_SEEN, NEAREST_M = 100, 0.2
SMOOTH = 5  # blocks: slopes of inverse depth are those of surfaces, not of its noise


@dataclass(frozen=True, eq=False)
class Aligned:
    """then_from_now (4, 4) and the covariance (6, 6) of its right perturbation; shared: part of the pixels that both see."""

    then_from_now: np.ndarray
    covariance: np.ndarray
    shared: float


@dataclass(frozen=True, eq=False)
class Level:
    """A view in blocks: points (N, 3), NaN without depth; grey (N,); planes (2, H, W, 3) float32: brightness, inverse depth,
    each with its slopes along u and v per block; scale: pixels per block; contrast: deviation of grey; known: blocks with
    depth."""

    points: np.ndarray
    grey: np.ndarray
    planes: np.ndarray
    scale: float
    contrast: float
    known: int


def levels(picture: np.ndarray, depth: np.ndarray, camera: Camera, s: DirectSettings) -> list[Level]:
    """A gray image (H, W) uint8 and its depth in metres in ever smaller blocks. An edge has no depth."""
    known = (np.isfinite(depth) & (depth > 0.0)).astype(np.float32)
    rho = np.where(known > 0.0, 1.0 / np.where(known > 0.0, depth, 1.0), 0.0).astype(np.float32)
    wide, out = min(s.columns, camera.width), []
    parts = [picture.astype(np.float32), known, rho, rho * rho]
    for halved in range(s.levels):
        columns = max(wide >> halved, 2)
        scale = camera.width / columns
        size = (columns, max(round(camera.height / scale), 2))
        parts = [cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in parts]
        grey, share, mean, square = parts[0], parts[1], parts[2].copy(), parts[3]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean /= share
            mean[~((share > s.least_known) & (square / share - mean * mean < (s.rough_per_m * scale) ** 2))] = np.nan
            rows, columns_at = np.indices(grey.shape)
            pixels = (np.column_stack([columns_at.ravel(), rows.ravel()]) + 0.5) * scale - 0.5
            points = camera.points(pixels, 1.0 / mean.ravel().astype(float))
        smooth = np.gradient(cv2.blur(mean, (SMOOTH, SMOOTH)))  # unknown where any of its blocks is: there, as it stands
        slopes = [np.where(np.isfinite(even), even, own) for even, own in zip(smooth, np.gradient(mean), strict=True)]
        if s.bent_per_m:
            slopes = [np.where(_bent(mean) > s.bent_per_m, np.nan, slope) for slope in slopes]
        planes = np.stack([np.dstack([a, along, down]) for a, (down, along) in
                           ((grey, np.gradient(grey)), (mean, slopes))]).astype(np.float32)
        contrast, seen = 1.4826 * float(np.median(np.abs(grey - np.median(grey)))), int(np.isfinite(mean).sum())
        out.append(Level(points, grey.ravel().astype(float), planes, scale, contrast, seen))
    return out[::-1]


def _bent(rho: np.ndarray) -> np.ndarray:
    """(H, W) by how much inverse depth (H, W) is no plane within what a slope is smoothed over, 1/m; 0 where unknown, and
    without end along the rim, of which it is smoothed over one side alone."""
    reach, out = SMOOTH // 2 + 1, np.zeros(rho.shape, rho.dtype)
    for middle, value in ((rho, out), (rho.T, out.T)):
        second = np.abs(middle[2 * reach:] - 2.0 * middle[reach:-reach] + middle[: -2 * reach])
        np.fmax(value[reach:-reach], second, out=value[reach:-reach])
        value[:reach] = value[-reach:] = np.inf
    return out


def align(then: list[Level], now: list[Level], camera: Camera, guess: np.ndarray, wide: np.ndarray, s: DirectSettings,
          start: np.ndarray | None = None) -> Aligned | None:
    """Lay view `now` on view `then` from a guess of then_from_now (4, 4) with the covariance `wide` (6, 6) of its right
    perturbation, which stands where the views say nothing; start (4, 4): where to begin, if elsewhere. None when they do not
    lie on each other."""
    prior = np.zeros((8, 8))
    prior[:6, :6] = np.linalg.inv(wide)
    prior[6, 6], prior[7, 7] = 1.0 / s.gain_sigma**2, 1.0 / s.offset_sigma**2
    pose, light = inverse(guess if start is None else start), np.array([_brighter(then[0], now[0]), 0.0])
    for a, b in zip(then, now, strict=True):
        for _ in range(s.iterations):
            sums = _normal_equations(a, b, camera, pose, light, s)
            if sums is None:
                return None
            information, gradient, shared = sums
            off = np.concatenate([log_se3(pose @ guess), light - [1.0, 0.0]])  # left perturbation from the guess
            step = -np.linalg.solve(information / s.correlated + prior, gradient / s.correlated + prior @ off)
            pose, light = exp_se3(step[:6]) @ pose, light + step[6:]
            if np.abs(step[:6]).max() < s.still * a.scale:
                break
    if shared < s.least_shared:
        return None
    covariance = np.linalg.inv(information / s.correlated + prior)[:6, :6]
    return Aligned(orthonormal(inverse(pose)), 0.5 * (covariance + covariance.T), shared)


def _brighter(then: Level, now: Level) -> float:
    """Gain to begin with, by the medians: a first step that has the light to find, too, leaves the few blocks that tell of
    the motion far off, and what is far off counts for little."""
    return float(np.clip(np.median(now.grey) / max(np.median(then.grey), 1.0), 0.5, 2.0))


def _normal_equations(a: Level, b: Level, camera: Camera, pose: np.ndarray, light: np.ndarray, s: DirectSettings):
    """Information (8, 8), gradient (8,) of six of the pose and two of the light, and the part of points that land; 0 where
    they land on something else."""
    q = a.points @ pose[:3, :3].T + pose[:3, 3]
    with np.errstate(invalid="ignore"):
        q[~(q[:, 2] > NEAREST_M)] = np.nan
    at = (camera.project(q) + 0.5) / b.scale - 0.5
    information, gradient = np.zeros((8, 8)), np.zeros(8)
    rules = np.array([s.grey_sigma, s.inverse_depth_sigma, s.student_dof, camera.fx / b.scale, camera.fy / b.scale,
                      s.clear_sigmas])
    seen, grey_off, depth_off = _sums(q, at, a.grey, b.planes, light, rules, information, gradient)
    if seen < LEAST_SEEN:
        return None
    same = grey_off < max(s.grey_off, s.grey_off_share * a.contrast) and depth_off < s.depth_off_per_m
    return information, gradient, seen / max(a.known, 1) if same else 0.0


@compiled
def _at(plane, u, v, k):
    """Value k of a (H, W, 3) plane between pixels; NaN outside."""
    height, width = plane.shape[:2]
    if not (u >= 0.0 and v >= 0.0 and u < width - 1.0 and v < height - 1.0):
        return np.nan
    x, y = int(u), int(v)
    fx, fy = u - x, v - y
    upper = (1.0 - fx) * plane[y, x, k] + fx * plane[y, x + 1, k]
    lower = (1.0 - fx) * plane[y + 1, x, k] + fx * plane[y + 1, x + 1, k]
    return (1.0 - fy) * upper + fy * lower


@compiled
def _add(q, at, before, plane, off, lit, sigma, rules, information, gradient):
    """Add the sums of one kind of residual, weighted by Student's t."""
    j, dof, clear = np.zeros(8), rules[2], rules[5]
    for i in range(q.shape[0]):
        gu, gv = _at(plane, at[i, 0], at[i, 1], 1), _at(plane, at[i, 0], at[i, 1], 2)
        if not (np.isfinite(off[i]) and np.isfinite(gu) and np.isfinite(gv)):
            continue
        if lit and gu * gu + gv * gv < clear * clear * sigma * sigma:
            gu = gv = 0.0  # what is all of one brightness tells of the light alone
        x, y, z = q[i, 0], q[i, 1], q[i, 2]
        iz = 1.0 / z
        j[0], j[1] = gu * rules[3] * iz, gv * rules[4] * iz
        j[2] = -(j[0] * x + j[1] * y) * iz
        if lit:
            j[6], j[7] = -before[i], -1.0
        else:
            j[2] += iz * iz
        j[3], j[4], j[5] = j[2] * y - j[1] * z, j[0] * z - j[2] * x, j[1] * x - j[0] * y
        weight = (dof + 1.0) / (dof + (off[i] / sigma) ** 2) / (sigma * sigma)
        for m in range(8):
            gradient[m] += weight * j[m] * off[i]
            for n in range(8):
                information[m, n] += weight * j[m] * j[n]


@compiled
def _sums(q, at, before, planes, light, rules, information, gradient):
    """Fill information and gradient; how many points are seen, and the deviations of their brightness and inverse depth from
    those expected."""
    off, apart, spread = np.empty(len(q)), np.empty(len(q)), np.zeros(2)
    seen = 0
    for kind in range(2):
        n = 0
        for i in range(len(q)):
            expected = light[0] * before[i] + light[1] if kind == 0 else 1.0 / q[i, 2]
            off[i] = _at(planes[kind], at[i, 0], at[i, 1], 0) - expected
            if np.isfinite(off[i]):
                apart[n] = abs(off[i])
                n += 1
        spread[kind] = 1.4826 * np.median(apart[:n]) if n > 0 else np.inf
        _add(q, at, before, planes[kind], off, kind == 0, max(spread[kind], rules[kind]), rules, information, gradient)
        seen = n if kind == 0 else seen
    return seen, spread[0], spread[1]
