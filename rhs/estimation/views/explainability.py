"""How much of a view does the memory explain, if it was taken from this pose?

The check of one stored view against another counts what those two share; a painting that hangs in two places passes it.
Here the key-points of all stored views near a pose are drawn into the query: at the right place most of the query is
explained and most of what should be there is found; at a look-alike only the repeated painting is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, inverse, planar, transform, wrap
from rhs.api.records import Features

from .place_memory import Memory
from .settings import ExplainSettings, scaled_px

USUAL = ExplainSettings()


@dataclass(frozen=True)
class Explainability:
    """explained: share of the query's key-points that the memory accounts for. found: share of the memory's key-points
    drawn into the query that are seen there. Both 0..1; `score` is their product."""

    explained: float
    found: float

    @property
    def score(self) -> float:
        return self.explained * self.found


def explainability(
    memory: Memory, query: Features, camera: Camera, map_from_body: np.ndarray, *, settings: ExplainSettings = USUAL
) -> Explainability:
    """What the stored views nearest to a pose (4x4) explain of a query taken there."""
    near = nearest_views(memory, map_from_body, settings.views, settings)
    return _explained(memory, near, query, camera, map_from_body, settings)


def _explained(memory: Memory, near: np.ndarray, query: Features, camera: Camera, map_from_body: np.ndarray,
               settings: ExplainSettings) -> Explainability:
    """What these stored views explain of the query."""
    drawn, rows = _drawn(memory, near, camera, map_from_body)
    if len(rows) == 0 or len(query.pixels) == 0:
        return Explainability(0.0, 0.0)
    pixels = camera.project(drawn)
    across, down = (query.pixels[:, None, k] - pixels[None, :, k] for k in (0, 1))
    close = across * across + down * down < scaled_px(settings.pixels_px, camera.width) ** 2
    ours, theirs = np.nonzero(close)
    alike = np.einsum("nd,nd->n", query.descriptors[ours], memory.rootsift(rows[theirs])) > settings.likeness
    depth = query.points[ours, 2]
    with np.errstate(invalid="ignore"):
        level = ~(np.abs(drawn[theirs, 2] - depth) > settings.depth_share * depth + settings.depth_m)
    hit = alike & level
    return Explainability(len(np.unique(ours[hit])) / len(query.pixels), len(np.unique(theirs[hit])) / len(rows))


def nearest_views(
    memory: Memory, map_from_body: np.ndarray, count: int, settings: ExplainSettings = USUAL
) -> np.ndarray:
    """Up to `count` stored views that look the same way from near a pose, nearest first."""
    if len(memory) == 0:
        return np.empty(0, int)
    x_m, y_m, yaw_rad = planar(map_from_body)
    stands = memory.stands
    gap = np.hypot(stands[:, 0] - x_m, stands[:, 1] - y_m)
    turn = np.abs(wrap(stands[:, 2] - yaw_rad))
    cost = np.where((gap <= settings.near_m) & (turn <= np.radians(settings.near_deg)), gap + 2.0 * turn, np.inf)
    order = np.argsort(cost, kind="stable")[:count]
    return order[np.isfinite(cost[order])]


def expected(memory: Memory, query: Features, map_from_body: np.ndarray, settings: ExplainSettings = USUAL) -> bool:
    """Whether a view with so many key-points, taken from this pose (4x4), ought to be recognised: a stored view stands near
    with as many that tell where they are (`Memory.placed`), which its neighbours explain: of plain walls many are noise, and
    seen once. That it is not recognised is evidence too (`silence`)."""
    if len(query.pixels) < settings.telling or len(memory) == 0:
        return False
    x_m, y_m, yaw_rad = planar(map_from_body)
    gap = np.hypot(memory.stands[:, 0] - x_m, memory.stands[:, 1] - y_m)
    turn = np.abs(wrap(memory.stands[:, 2] - yaw_rad))
    near = (gap < settings.expected_m) & (turn < np.radians(settings.expected_deg))
    stored = np.flatnonzero(near & (memory.placed >= settings.telling)).tolist()
    return any(by_neighbours(memory, view, settings) >= settings.expected_score for view in stored)


def by_neighbours(memory: Memory, view: int, settings: ExplainSettings = USUAL) -> float:
    """What the stored views nearest to this one explain of it (`score`); 1 of one camera, whose key-points have no depth."""
    if not np.isfinite(memory.points[:, 2]).any():
        return 1.0
    if view not in memory.explained:
        pose = memory.poses[view]
        near = nearest_views(memory, pose, settings.views + 1, settings)
        others = near[near != view][: settings.views]
        memory.explained[view] = _explained(memory, others, memory.features(view), memory.camera, pose, settings).score
    return memory.explained[view]


def in_view(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) of points (N, 3) of a camera's frame, and (N,) which of them it sees."""
    with np.errstate(invalid="ignore"):
        pixels = camera.project(points)
        inside = (points[:, 2] > 0.3) & np.all((pixels >= 0) & (pixels < [camera.width, camera.height]), axis=1)
    return pixels, inside


def _drawn(memory: Memory, near: np.ndarray, camera: Camera, map_from_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Key-points of the stored views that fall into the picture from this pose: (M, 3) in its camera frame, rows (M,)."""
    camera_from_map = inverse(map_from_body @ camera.body_from_camera)
    points, rows = [np.empty((0, 3))], [np.empty(0, int)]
    for view in near:
        at = np.arange(memory.starts[view], memory.starts[view + 1])
        stored_camera = memory.poses[view] @ memory.camera.body_from_camera
        points.append(transform(camera_from_map @ stored_camera, memory.points[at].astype(float)))
        rows.append(at)
    drawn, index = np.concatenate(points), np.concatenate(rows)
    _, inside = in_view(drawn, camera)
    return drawn[inside], index[inside]
