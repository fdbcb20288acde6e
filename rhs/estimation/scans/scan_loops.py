"""Loops that only scans can close: a corridor walked back the other way, where no camera recognises anything.

The walls seen on the way there (several scans in one small map) and those seen on the way back (several scans in one
cloud) are laid onto one another (rhs.estimation.scans.scan_match). Along a plain corridor the result says nothing, by
its covariance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.geometry import inverse, planar, se2, wrap
from rhs.api.grid import OccupancyGrid
from rhs.api.records import LoopEdge, View

from .scan_match import ScanMatcher, ends, wall_lines_of
from .settings import MatchSettings, ScanLoopSettings


def scan_edges(
    views: Sequence[View], poses: np.ndarray, way_m: np.ndarray, settings: ScanLoopSettings, *, every_m: float = 1.0
) -> list[LoopEdge]:
    """Edges between views (at the believed poses (N, 4, 4), way_m (N,)) that stand close and look the other way. every_m:
    metres of way between two tries."""
    states = np.array([planar(pose) for pose in poses]).reshape(-1, 3)
    walls = _Walls(views, poses, settings.match)
    out, tried_m = [], -np.inf
    for later, view in enumerate(views):
        if view.scan is None or way_m[later] < tried_m + every_m:
            continue
        gap = np.hypot(*(states[:, :2] - states[later, :2]).T)
        turned = np.abs(wrap(states[:, 2] - states[later, 2])) > np.radians(settings.turned_deg)
        possible = turned & (gap < settings.within_m) & (way_m < way_m[later] - settings.min_way_m)
        if not possible.any():
            continue
        tried_m = way_m[later]
        edge = _edge(walls, way_m, (int(np.where(possible, gap, np.inf).argmin()), later), settings)
        out += [edge] if edge is not None else []
    return out


class _Walls:
    """Wall points of views and the eyes that saw them, each scan looked at once. poses (N, 4, 4)."""

    def __init__(self, views: Sequence[View], poses: np.ndarray, match: MatchSettings) -> None:
        self._views, self.poses, self._match = views, poses, match
        self._points: dict[int, np.ndarray] = {}

    def cloud(self, chosen: np.ndarray, at: int) -> np.ndarray:
        """(2, M, 2) wall points of the chosen views (N,) and where each was seen from, in the frame of view `at`, metres."""
        views = np.nonzero(chosen)[0]
        at_from_view = inverse(self.poses[at]) @ self.poses[views]
        yaw = np.arctan2(at_from_view[:, 1, 0], at_from_view[:, 0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        turned = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)
        parts = zip(views.tolist(), turned, at_from_view[:, :2, 3], strict=True)
        return np.concatenate([np.empty((2, 0, 2)), *(self._of(k) @ turn + shift for k, turn, shift in parts)], axis=1)

    def _of(self, view: int) -> np.ndarray:
        if view not in self._points:
            scan = self._views[view].scan
            points = ends(scan, self._match) if scan is not None else np.empty((0, 2))
            eyes = np.zeros_like(points) + (scan.origin_xy_m if scan is not None else 0.0)
            self._points[view] = np.stack([points, eyes])
        return self._points[view]


def _edge(walls: _Walls, way_m: np.ndarray, pair: tuple[int, int], settings: ScanLoopSettings) -> LoopEdge | None:
    """The edge between one pair of views, or None when their walls do not fit."""
    earlier, later = pair
    earlier_from_later = inverse(walls.poses[earlier]) @ walls.poses[later]
    chart = walls.cloud(np.abs(way_m - way_m[earlier]) <= settings.there_m, earlier)
    chart = _facing(chart[0], chart[1], earlier_from_later[:2, 3], settings)
    cloud = _thinned(walls.cloud(np.abs(way_m - way_m[later]) <= settings.back_m, later)[0], settings.cell_m)
    if min(len(chart), len(cloud)) < settings.least_points:
        return None
    prior = np.diag([settings.sigma_m**2, settings.sigma_m**2, settings.sigma_rad**2])
    state = planar(earlier_from_later)
    found = ScanMatcher(_drawn(chart, settings.cell_m), settings.match).match_points(cloud, state, prior)
    if found is None:
        return None
    covariance = np.eye(6)
    plane = np.ix_([0, 1, 5], [0, 1, 5])
    covariance[plane] = np.linalg.inv(found.information + 0.01 * np.eye(3))  # unseen: ten metres, ten radians
    # the match moves the pose in the plane; what the belief says of height and tilt stays
    edge = earlier_from_later @ inverse(se2(*state)) @ se2(*found.state)
    return LoopEdge(earlier, later, edge, covariance, len(cloud))


def _facing(points: np.ndarray, eyes: np.ndarray, looks_from: np.ndarray, settings: ScanLoopSettings) -> np.ndarray:
    """The wall points (M, 2), seen from eyes (M, 2), without those whose wall looks away from looks_from (2,): a thin wall
    has two faces, and who looks back sees the other one."""
    if len(points) == 0:
        return points
    grid = _drawn(points, settings.cell_m)
    normals, _ = wall_lines_of(np.where(grid.occupied(), grid.probability, 0.0))
    columns, rows = np.floor((points - grid.origin_m) / grid.resolution_m).astype(int).T
    normal = normals[rows, columns]
    seen_from, looked_from = (((eye - points) * normal).sum(axis=1) for eye in (eyes, looks_from))
    facing: np.ndarray = points[np.sign(seen_from) * looked_from >= -settings.behind_m]
    return facing


def _thinned(points: np.ndarray, cell_m: float) -> np.ndarray:
    """One point (their mean) per cell: walls seen often count no more than walls seen once."""
    if len(points) == 0:
        return points
    _, at = np.unique(np.floor(points / cell_m).astype(int), axis=0, return_inverse=True)
    count = np.bincount(at)
    return np.stack([np.bincount(at, points[:, axis]) / count for axis in (0, 1)], axis=1)


def _drawn(points: np.ndarray, cell_m: float) -> OccupancyGrid:
    """A map whose cells are occupied where at least two wall points lie."""
    low = points.min(axis=0) - 1.0
    at = np.floor((points - low) / cell_m).astype(int)
    columns, rows = at.max(axis=0) + int(1.0 / cell_m)
    counts = np.zeros((rows, columns))
    np.add.at(counts, (at[:, 1], at[:, 0]), 1.0)
    return OccupancyGrid(np.where(counts >= 2, 0.95, 0.05).astype(np.float32), cell_m, (float(low[0]), float(low[1])))
