"""Does the picture of a view look as it must from this pose, also where it has no key-points?

The blocks of a query (`rhs.api.records.Thumbnail`) are lifted by their depth, drawn into the stored views nearest to
the pose and compared with what those saw there: direct comparison (Irani and Anandan 1999) instead of key-points. A
repeated painting fits at both places where it hangs; the plaster round it, three grey levels of a pattern as wide as a
hand, fits at one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, inverse, transform
from rhs.api.records import Thumbnail

from .explainability import nearest_views
from .place_memory import Memory
from .settings import ThumbnailSettings

USUAL = ThumbnailSettings()


@dataclass(frozen=True, eq=False)
class ThumbnailFit:
    """residual (N,) and sigma (N,): how much each block of a view differs from what was stored, and what that may be, in
    grey levels; NaN where no stored view saw it. settings: what they were compared by."""

    residual: np.ndarray
    sigma: np.ndarray
    settings: ThumbnailSettings = USUAL

    @property
    def misfit(self) -> float:
        """Mean squared residual in sigmas: below one where the pose is right; NaN when too little can be compared."""
        return _mean_square(self.residual, self.sigma, self.settings)


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of a view: points (N, 3) in its camera's frame, NaN without depth; grey (N,); slope (N,) of grey per block."""

    points: np.ndarray
    grey: np.ndarray
    slope: np.ndarray
    camera: Camera


def blocks(thumbnail: Thumbnail | None, camera: Camera) -> Blocks | None:
    """The blocks of a thumbnail, lifted by their depth; None when there is nothing to lift."""
    if thumbnail is None or min(thumbnail.grey.shape) < 2 or not np.isfinite(thumbnail.depth).any():
        return None
    height, width = thumbnail.grey.shape
    grey = thumbnail.grey.astype(float)
    rows, columns = np.indices(grey.shape)
    centres = np.column_stack([columns.ravel() + 0.5, rows.ravel() + 0.5])
    pixels = centres * [camera.width / width, camera.height / height] - 0.5
    down, across = np.gradient(grey)
    points = camera.points(pixels, thumbnail.depth.ravel().astype(float))
    return Blocks(points, grey.ravel(), np.hypot(down, across).ravel(), camera)


def fit(
    memory: Memory, query: Blocks | None, map_from_body: np.ndarray, s: ThumbnailSettings = USUAL
) -> ThumbnailFit | None:
    """The blocks of a view laid over the stored ones nearest to a pose (4x4); a further one counts only where a
    nearer one does not reach. None when either side keeps no pictures."""
    if query is None or memory.greys.size == 0:
        return None
    from .thumbnail_kernels import sampled

    camera, (height, width) = memory.camera, memory.greys.shape[1:]
    scale = np.array([width / camera.width, height / camera.height])
    residual, sigma = np.full(len(query.grey), np.nan), np.full(len(query.grey), np.nan)
    for view in nearest_views(memory, map_from_body, s.views):
        stored_from_map = inverse(memory.poses[view] @ camera.body_from_camera)
        drawn = transform(stored_from_map @ map_from_body @ query.camera.body_from_camera, query.points)
        drawn[~(drawn[:, 2] > s.nearest_m)] = np.nan
        seen, slope = sampled(memory.greys[view], (camera.project(drawn) + 0.5) * scale - 0.5)
        fresh = np.isnan(residual) & np.isfinite(seen)
        brighter = query.grey[fresh].sum() / max(seen[fresh].sum(), 1.0)
        residual[fresh] = query.grey[fresh] - np.clip(brighter, 1.0 / s.exposure, s.exposure) * seen[fresh]
        sigma[fresh] = np.sqrt(s.grey**2 + s.slope_share**2 * (query.slope[fresh] ** 2 + slope[fresh] ** 2))
    return ThumbnailFit(residual, sigma, s)


def outdoes(better: ThumbnailFit | None, worse: ThumbnailFit | None) -> float:
    """How significantly one pose fits better than another, over the blocks both explain: Fisher's z of the two mean squares
    (Fisher 1924), in sigmas of chance and of where views stand. Above 3.1 once in a thousand times. NaN: nothing to compare.
    """
    if better is None or worse is None:
        return float("nan")
    sigma = np.minimum(better.sigma, worse.sigma)  # NaN where either has nothing
    s = better.settings
    ours, theirs = _mean_square(better.residual, sigma, s), _mean_square(worse.residual, sigma, s)
    freedom = np.isfinite(sigma).sum() / s.together
    spread = np.hypot(1.0 / np.sqrt(max(freedom, 1.0)), s.standing)
    return float(0.5 * np.log(max(theirs, 1e-9) / max(ours, 1e-9)) / spread)


def _mean_square(residual: np.ndarray, sigma: np.ndarray, s: ThumbnailSettings) -> float:
    both = np.isfinite(sigma)
    if both.sum() < s.enough * len(sigma):
        return float("nan")
    return float(np.minimum((residual[both] / sigma[both]) ** 2, s.outlier**2).mean())
