"""Loops in a survey: which views show the same place, and is that believable?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.geometry import inverse
from rhs.api.records import LoopEdge, View

from .features import match
from .settings import SightingSettings
from .view_pose import Snapshot, sight


def stored(views: Sequence[View]) -> list[View]:
    """The views kept as places: those with key-points."""
    return [view for view in views if view.features is not None and len(view.features.pixels) > 1]


def poses_of(views: Sequence[View]) -> np.ndarray:
    """(N, 4, 4) map_from_body of the views."""
    poses = np.empty((len(views), 4, 4))
    for k, view in enumerate(views):
        poses[k] = view.map_from_body
    return poses


def in_a_hand(views: Sequence[View]) -> bool:
    """Whether a camera took these views that stands on no floor: it hangs at no height over the origin of its body."""
    return any(view.features is not None and view.camera.height_m == 0.0 for view in views)


def covariances_of(views: Sequence[View]) -> np.ndarray:
    """(N, 6, 6) of the poses of the views by the odometry alone, against the first."""
    return np.array([view.covariance for view in views]).reshape(-1, 6, 6)


def travelled_m(poses: np.ndarray, *, solid: bool = False) -> np.ndarray:
    """(N,) metres travelled up to each of (N, 4, 4) poses, on the floor; solid: in space."""
    steps = np.linalg.norm(np.diff(poses[:, : 3 if solid else 2, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def edge_between(
    views: Sequence[View], earlier: int, later: int, *, settings: SightingSettings, rng: np.random.Generator
) -> LoopEdge | None:
    """The later view (position in `views`) seen from the earlier one, or None when they do not show the same place."""
    a, b = views[earlier], views[later]
    if a.features is None or b.features is None:
        return None
    seen = sight(Snapshot(a.features, a.camera), Snapshot(b.features, b.camera), settings=settings, rng=rng)
    if seen is None:
        return None
    return LoopEdge(earlier, later, seen.stored_from_query, seen.covariance, seen.inliers)


def closing_gap(poses: np.ndarray, edge: LoopEdge) -> np.ndarray:
    """4x4 `believed_from_closed`: where the edge puts the later view, seen from where the poses (N, 4, 4) put it."""
    gap: np.ndarray = inverse(poses[edge.later]) @ poses[edge.earlier] @ edge.earlier_from_later
    return gap


def ends_meet(
    views: Sequence[View], *, reach: int, checks: int, settings: SightingSettings, rng: np.random.Generator
) -> list[LoopEdge]:
    """Verified edges between the last and the first `reach` stored views, most inliers first.

    All pairs are ranked by their number of matched key-points; the best `checks` of them are verified by geometry.
    """
    at = [k for k, view in enumerate(views) if view.features is not None and len(view.features.pixels) > 1]
    first, last = at[:reach], at[reach:][-reach:]
    ranked = sorted(
        ((-_matches(views[i], views[j], settings.ratio), j, i) for i in first for j in last), key=lambda item: item[0]
    )
    edges = [edge_between(views, i, j, settings=settings, rng=rng) for _, j, i in ranked[:checks]]
    return sorted((edge for edge in edges if edge is not None), key=lambda edge: -edge.inliers)


def _matches(a: View, b: View, ratio: float) -> int:
    assert a.features is not None and b.features is not None
    return len(match(b.features, a.features, ratio))
