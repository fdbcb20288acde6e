"""Does the camera that was told fit what it saw? Self-calibration as a diagnosis, from matched key-points with depth.

A point seen at pixel u with depth z lies (u - cx) z / f across. Where f is told too long the world is too narrow while
depths stay true, and a view that was turned aside disagrees: what lay across lies along now. Unknown together are a rigid
motion for each of many pairs of views turned apart, and for all of them: the share of the told focal length that fits, the
principal point, an offset of inverse depth (of a Kinect: of its disparities), and how depth lies on the picture, magnified
about the middle and shifted (a depth camera of its own, not registered), read along the slope of the inverse depth, which
is constant on a plane. Least squares by Gauss-Newton with weights of Student's t, the motions eliminated (Schur
complement); standard errors by the sandwich over stretches of the way, since errors of neighbouring views are alike (blur,
rolling shutter). The scale of depth cannot be told: with it the whole world grows alike.

Compare Zhang and Zhang, "Calibration between depth and color sensors for commodity depth cameras", ICME 2011, and Herrera,
Kannala and Heikkila, "Joint depth and color camera calibration with distortion correction", PAMI 2012, who use a board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, exp_se3
from rhs.api.records import Features, View

from .features import match
from .rigid import MEDIAN_TO_SIGMA, PointNoise, ransac_rigid
from .settings import CameraFitSettings, RansacSettings, scaled_px

SHARED = 7  # log of the focal ratio, principal point (2), offset of inverse depth, depth magnified, depth shifted (2)
STEP = 1e-6  # of numeric derivatives
PIXEL_PX, INVERSE_DEPTH = 1.0, 0.003  # noise to begin with: pixels, and 1/m (Kinect)
LEAST_PX, LEAST_INVERSE_DEPTH = 0.2, 5e-4  # and how small it may show itself
BENT_PER_M = 0.03  # inverse depth that bends by more between the blocks of a thumbnail is no plane


@dataclass(frozen=True)
class CameraFit:
    """focal_ratio: the focal length that fits over the one told. depth_magnified: size of the depth image on the picture
    over that of a registered one. Each with its standard error. pairs of views and of key-points that say so."""

    focal_ratio: float
    focal_ratio_sigma: float
    depth_magnified: float
    depth_magnified_sigma: float
    pairs: int
    points: int


@dataclass(frozen=True, eq=False)
class Sights:
    """Key-points of one end of the pairs: rays (M, 2) at depth one, inverse depths (M,), their slopes (M, 2) along these."""

    rays: np.ndarray
    inverse_depth: np.ndarray
    slopes: np.ndarray

    @property
    def measured(self) -> np.ndarray:
        """(M,) not finite where anything is unknown."""
        return np.asarray(self.inverse_depth + self.slopes.sum(axis=1))


@dataclass(frozen=True, eq=False)
class Pairs:
    """now, then: both ends of M matched key-points. of (M,): which of the K pairs of views; stretch (K,): of the way.
    motions (K, 4, 4) then_from_now; agreed (M,) bool: with that motion."""

    now: Sights
    then: Sights
    of: np.ndarray
    stretch: np.ndarray
    motions: np.ndarray
    agreed: np.ndarray


def fit_camera(views: Sequence[View], *, rng: np.random.Generator, settings: CameraFitSettings | None = None,
               ) -> CameraFit | None:
    """What the stored views of a survey, at the poses they are believed at, say of their camera; None where too few pairs
    of views turned apart show the same points with depth."""
    s = CameraFitSettings() if settings is None else settings
    pairs = _matched(views, s, rng)
    if pairs is None:
        return None
    solved = _solved(pairs, float(views[0].camera.fx), s)
    if solved is None:
        return None
    shared, sigma, agreed = solved
    ratio = float(np.exp(shared[0]))
    return CameraFit(ratio, ratio * float(sigma[0]), 1.0 + float(shared[4]), float(sigma[4]), len(pairs.motions),
                     int(agreed.sum()))


def contradictions_of(fit: CameraFit, camera: Camera, settings: CameraFitSettings) -> list[str]:
    """What is clearly wrong with the camera, and what to type, one line each; depth that lies beside the picture first."""
    lines, of = [], f"({fit.pairs} pairs of views)"
    if _clearly(fit.depth_magnified - 1.0, fit.depth_magnified_sigma, settings):
        lines.append("the depth images do not lie on the pictures: they are as of a camera beside the one of colour, "
                     f"about {fit.depth_magnified:.2f} times as large {of}; type source.depth_camera=[fx,fy,cx,cy] of it, "
                     "or of 7-Scenes source.camera=seven_scenes")
    if _clearly(fit.focal_ratio - 1.0, fit.focal_ratio_sigma, settings):
        fx, fy, sigma = camera.fx * fit.focal_ratio, camera.fy * fit.focal_ratio, camera.fx * fit.focal_ratio_sigma
        numbers = (round(fx, 1), round(fy, 1), camera.cx, camera.cy, *camera.distortion)
        words = ",".join(f"{number:.6g}" for number in numbers)
        lines.append(f"the pictures fit a focal length of {fx:.0f} +- {sigma:.0f} pixels, and the "
                     f"camera that was told has {camera.fx:.0f} {of}: what lies across is {_wrong(fit.focal_ratio)}, and "
                     f"loops may not fit; type source.camera=[{words}], or its calibration")
    return lines


def _wrong(ratio: float) -> str:
    return f"{100 * abs(ratio - 1.0):.0f} % too {'short' if ratio < 1.0 else 'long'}"


def _clearly(off: float, sigma: float, s: CameraFitSettings) -> bool:
    return abs(off) > max(s.least_off, s.sure_sigma * sigma)


def _matched(views: Sequence[View], s: CameraFitSettings, rng: np.random.Generator) -> Pairs | None:
    """Pairs of views turned apart whose key-points one motion explains."""
    found: list[tuple[int, np.ndarray, Sights, Sights, np.ndarray]] = []
    for earlier, later in turned_apart(views, s):
        one = _pair(views[earlier], views[later], s, rng)
        if one is not None:
            found.append((earlier, *one))
    if len(found) < s.least_pairs:
        return None
    rows, motions, now, then, agreed = zip(*found, strict=True)
    at = np.array(rows)
    stretch = np.minimum((at - at[0]) * s.stretches // max(int(at[-1] - at[0]), 1), s.stretches - 1)
    return Pairs(_joined(now), _joined(then), np.repeat(np.arange(len(found)), [len(a) for a in agreed]), stretch,
                 np.stack(motions), np.concatenate(agreed))


def turned_apart(views: Sequence[View], s: CameraFitSettings) -> list[tuple[int, int]]:
    """(earlier, later) rows of stored views, evenly spaced along the way: the later one is the first that looks aside from
    the earlier one by turn_deg. At most most_pairs."""
    at = [k for k, view in enumerate(views) if view.features is not None and len(view.features.pixels) > s.least_points]
    poses = np.stack([views[k].map_from_body[:3, :3] @ views[k].camera.body_from_camera[:3, :3] for k in at]) if at else None
    pairs: list[tuple[int, int]] = []
    for n in range(len(at)):
        assert poses is not None
        apart = np.degrees(np.arccos(np.clip(poses[n + 1 :, :, 2] @ poses[n, :, 2], -1.0, 1.0)))
        aside = np.flatnonzero(apart > s.turn_deg)
        if len(aside) and apart[aside[0]] < s.most_turn_deg:
            pairs.append((at[n], at[n + 1 + int(aside[0])]))
    if not pairs:
        return []
    return [pairs[k] for k in np.unique(np.linspace(0, len(pairs) - 1, min(s.most_pairs, len(pairs))).astype(int))]


def _pair(then: View, now: View, s: CameraFitSettings, rng: np.random.Generator,
          ) -> tuple[np.ndarray, Sights, Sights, np.ndarray] | None:
    """then_from_now of two views, both ends of their matches, and which of these agree; None where too few do."""
    a, b = then.features, now.features
    assert a is not None and b is not None
    rows = match(b, a, s.ratio)
    if len(rows) < s.least_points:
        return None
    f = float(then.camera.fx)
    ends = [_sights(features, then.camera.width, f, row) for features, row in ((b, rows[:, 0]), (a, rows[:, 1]))]
    known = np.flatnonzero(np.isfinite(ends[0].measured) & np.isfinite(ends[1].measured))
    if len(known) > s.most_points:
        known = rng.choice(known, s.most_points, replace=False)
    if len(known) < s.least_points:
        return None
    b_end, a_end = (Sights(end.rays[known], end.inverse_depth[known], end.slopes[known]) for end in ends)
    p, q = (np.column_stack([end.rays, np.ones(len(known))]) / end.inverse_depth[:, None] for end in (b_end, a_end))
    noise = PointNoise(f, scaled_px(s.ransac_px, then.camera.width))
    found = ransac_rigid(p, q, noise=noise, rng=rng, settings=RansacSettings(s.hypotheses, s.gate_sigma))
    if found is None or found.count < s.least_points:
        return None
    return found.a_from_b, b_end, a_end, found.inliers


def _sights(features: Features, width: int, focal_px: float, rows: np.ndarray) -> Sights:
    points = features.points[rows].astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        rays, inverse_depth = points[:, :2] / points[:, 2:], 1.0 / points[:, 2]
    return Sights(rays, inverse_depth, focal_px * _slopes(features, width, rows))


def _slopes(features: Features, width: int, rows: np.ndarray) -> np.ndarray:
    """(M, 2) slopes of the inverse depth round key-points, 1/m per pixel, read off the thumbnail; NaN where it bends."""
    if features.thumbnail is None:
        return np.full((len(rows), 2), np.nan)
    depth = features.thumbnail.depth
    block = width / depth.shape[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = np.pad(1.0 / depth.astype(float), 1, constant_values=np.nan)
        bent = np.maximum(np.abs(rho[1:-1, 2:] + rho[1:-1, :-2] - 2.0 * rho[1:-1, 1:-1]),
                          np.abs(rho[2:, 1:-1] + rho[:-2, 1:-1] - 2.0 * rho[1:-1, 1:-1]))
        along = np.stack([rho[1:-1, 2:] - rho[1:-1, :-2], rho[2:, 1:-1] - rho[:-2, 1:-1]], axis=2) / (2.0 * block)
        along[~(bent < BENT_PER_M)] = np.nan  # false for NaN
    at = np.clip(((features.pixels[rows] + 0.5) / block).astype(int), 0, np.array(depth.shape[::-1]) - 1)
    slopes: np.ndarray = along[at[:, 1], at[:, 0]]
    return slopes


def _joined(parts: Sequence[Sights]) -> Sights:
    return Sights(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("rays", "inverse_depth", "slopes")))


def _residuals(pairs: Pairs, motions: np.ndarray, shared: np.ndarray, focal_px: float, more: float = 0.0) -> np.ndarray:
    """(M, 3) where the points of `now` fall in the other view, less where they are: pixels, pixels, 1/m of inverse depth.
    more: is added to the inverse depths of `now`."""
    smaller, middle = np.exp(-shared[0]), shared[1:3]
    rho_now, rho_then = (end.inverse_depth + shared[3] + (end.slopes * (shared[4] * end.rays + shared[5:7])).sum(axis=1)
                         for end in (pairs.now, pairs.then))
    rays = np.column_stack([pairs.now.rays * smaller - middle, np.ones(len(rho_now))])
    pose = motions[pairs.of]
    seen = ((pose[:, :3, :3] @ rays[:, :, None])[:, :, 0] / (rho_now + more)[:, None]) + pose[:, :3, 3]
    across = (seen[:, :2] / seen[:, 2:] + middle) / smaller - pairs.then.rays
    return np.column_stack([focal_px * across, 1.0 / seen[:, 2] - rho_then])


def _solved(pairs: Pairs, focal_px: float, s: CameraFitSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """(SHARED,) unknowns, their standard errors, which points agree; None where it does not settle."""
    shared, motions = np.zeros(SHARED), pairs.motions.copy()
    noise, prior = (PIXEL_PX, INVERSE_DEPTH), np.diag(_expected(s) ** -2.0)
    for round_ in range(s.rounds):
        off, slopes = _linearised(pairs, motions, shared, focal_px)
        squared, weights = _weights(off, slopes[:, :, -1], noise)
        agreed = pairs.agreed if round_ < 3 else squared < s.outlier_sigma**2
        weights = weights * np.where(agreed, (s.student_dof + 3.0) / (s.student_dof + squared), 0.0)[:, None, None]
        system = _Reduced(slopes[:, :, :-1], weights, off, pairs.of)
        step = -np.linalg.solve(system.information.sum(axis=0) + prior, system.gradient.sum(axis=0) + prior @ shared)
        shared, moves = shared + step, system.moves(step)
        if not np.isfinite(shared).all():
            return None
        motions = np.stack([motion @ exp_se3(move) for motion, move in zip(motions, moves, strict=True)])
        if round_ > 3 and np.abs(step).max() < s.settled:
            break
        noise = _shown(off[agreed]) if round_ > 1 else noise
    spread = np.linalg.inv(system.information.sum(axis=0) + prior)
    scores = np.zeros((s.stretches, SHARED))
    np.add.at(scores, pairs.stretch, system.gradient)
    sandwich = spread @ (scores.T @ scores) @ spread * s.stretches / (s.stretches - 1)
    return shared, np.sqrt(np.maximum(np.diag(sandwich), np.diag(spread))), agreed


def _expected(s: CameraFitSettings) -> np.ndarray:
    """(SHARED,) 1 sigma of what is shared; of the focal length nothing is believed."""
    return np.array([1.0, *[s.principal_sigma] * 2, s.inverse_depth_sigma, s.magnified_sigma, *[s.shifted_sigma] * 2])


def _linearised(pairs: Pairs, motions: np.ndarray, shared: np.ndarray, focal_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (M, 3) and their slopes (M, 3, 6 + SHARED + 1) along each pair's motion, what is shared, and the inverse
    depth of `now`."""
    off = _residuals(pairs, motions, shared, focal_px)
    moved = [_residuals(pairs, motions @ exp_se3(STEP * axis), shared, focal_px) for axis in np.eye(6)]
    moved += [_residuals(pairs, motions, shared + STEP * axis, focal_px) for axis in np.eye(SHARED)]
    moved.append(_residuals(pairs, motions, shared, focal_px, STEP))
    return off, (np.stack(moved, axis=2) - off[:, :, None]) / STEP


def _weights(off: np.ndarray, by_depth: np.ndarray, noise: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Squared residuals (M,) in units of the noise of both ends, and the inverse of its covariance (M, 3, 3)."""
    spread = noise[1] ** 2 * by_depth[:, :, None] * by_depth[:, None, :]
    spread[:, range(3), range(3)] += np.array([2.0 * noise[0] ** 2, 2.0 * noise[0] ** 2, noise[1] ** 2])
    weights = np.linalg.inv(spread)
    return np.einsum("ni,nij,nj->n", off, weights, off), weights


def _shown(off: np.ndarray) -> tuple[float, float]:
    """Noise of one end that residuals (M, 3) of both show: pixels, 1/m."""
    sizes = [MEDIAN_TO_SIGMA * float(np.median(np.abs(part))) / np.sqrt(2.0) for part in (off[:, :2], off[:, 2])]
    return max(sizes[0], LEAST_PX), max(sizes[1], LEAST_INVERSE_DEPTH)


class _Reduced:
    """Normal equations of each pair, its motion eliminated: information (K, SHARED, SHARED), gradient (K, SHARED)."""

    def __init__(self, slopes: np.ndarray, weights: np.ndarray, off: np.ndarray, of: np.ndarray) -> None:
        weighted = weights @ slopes
        first = np.flatnonzero(np.diff(of, prepend=-1))  # key-points lie pair by pair
        full = np.add.reduceat(np.swapaxes(slopes, 1, 2) @ weighted, first)
        pull = np.add.reduceat(np.einsum("nik,ni->nk", weighted, off), first)
        own, cross = full[:, :6, :6] + 1e-6 * np.eye(6), full[:, :6, 6:]
        self._by_shared = np.linalg.solve(own, cross)
        self._by_own = np.linalg.solve(own, pull[:, :6, None])[:, :, 0]
        self.information = full[:, 6:, 6:] - np.swapaxes(cross, 1, 2) @ self._by_shared
        self.gradient = pull[:, 6:] - np.einsum("kij,ki->kj", self._by_shared, pull[:, :6])

    def moves(self, step: np.ndarray) -> np.ndarray:
        """(K, 6) by how much each motion moves when what is shared does by step."""
        moves: np.ndarray = -self._by_own - self._by_shared @ step
        return moves
