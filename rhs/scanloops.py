"""Loops that only scans can close: a corridor walked back the other way, where no camera recognises anything.

The walls seen on the way there (several scans in one small map) and those seen on the way back (several scans in one
cloud) are laid onto one another (rhs.scanmatch). Along a plain corridor the result says nothing, by its covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .geometry import inverse, planar, se2, wrap
from .grid import OccupancyGrid
from .records import LoopEdge, View
from .scanmatch import MatchSettings, ScanMatcher, ends

CELL_M = 0.1


@dataclass(frozen=True)
class ScanLoopSettings:
    """every_m: metres of way between two tries. within_m: believed distance of the two views. turned_rad: least difference
    of their headings; views that look the same way are the camera's business. min_way_m: way between them. there_m,
    back_m: scans from so much of the way on both sides of a view make its map, and its cloud. sigma_m, sigma_rad: how far
    off the belief may be."""

    every_m: float = 1.0
    within_m: float = 1.5
    turned_rad: float = np.radians(120.0)
    min_way_m: float = 5.0
    there_m: float = 9.0
    back_m: float = 1.5
    sigma_m: float = 0.4
    sigma_rad: float = 0.1


def scan_edges(
    views: Sequence[View], poses: np.ndarray, way_m: np.ndarray, settings: ScanLoopSettings
) -> list[LoopEdge]:
    """Edges between views (at the believed poses (N, 4, 4), way_m (N,)) that stand close and look the other way."""
    states = np.array([planar(pose) for pose in poses]).reshape(-1, 3)
    out, tried_m = [], -np.inf
    for later, view in enumerate(views):
        if view.scan is None or way_m[later] < tried_m + settings.every_m:
            continue
        gap = np.hypot(*(states[:, :2] - states[later, :2]).T)
        turned = np.abs(wrap(states[:, 2] - states[later, 2])) > settings.turned_rad
        possible = turned & (gap < settings.within_m) & (way_m < way_m[later] - settings.min_way_m)
        if not possible.any():
            continue
        tried_m = way_m[later]
        edge = _edge(views, poses, way_m, (int(np.where(possible, gap, np.inf).argmin()), later), settings)
        out += [edge] if edge is not None else []
    return out


def _edge(views, poses, way_m, pair: tuple[int, int], settings: ScanLoopSettings) -> LoopEdge | None:
    """The edge between one pair of views, or None when their walls do not fit."""
    earlier, later = pair
    chart = _cloud(views, poses, np.abs(way_m - way_m[earlier]) <= settings.there_m, earlier)
    cloud = _thinned(_cloud(views, poses, np.abs(way_m - way_m[later]) <= settings.back_m, later), CELL_M)
    if len(chart) < 50 or len(cloud) < 50:
        return None
    prior = np.diag([settings.sigma_m**2, settings.sigma_m**2, settings.sigma_rad**2])
    state = planar(inverse(poses[earlier]) @ poses[later])
    found = ScanMatcher(_drawn(chart), MatchSettings(sigma_m=0.05, trust=0.1)).match_points(cloud, state, prior)
    if found is None:
        return None
    covariance = np.eye(6)
    plane = np.ix_([0, 1, 5], [0, 1, 5])
    covariance[plane] = np.linalg.inv(found.information + 0.01 * np.eye(3))  # unseen: ten metres, ten radians
    # the match moves the pose in the plane; what the belief says of height and tilt stays
    edge = inverse(poses[earlier]) @ poses[later] @ inverse(se2(*state)) @ se2(*found.state)
    return LoopEdge(earlier, later, edge, covariance, len(cloud))


def _cloud(views: Sequence[View], poses: np.ndarray, chosen: np.ndarray, at: int) -> np.ndarray:
    """(M, 2) wall points of the chosen views, in the frame of view `at`, metres."""
    out = [np.empty((0, 2))]
    for k in np.nonzero(chosen)[0].tolist():
        scan = views[k].scan
        if scan is not None:
            x, y, yaw = planar(inverse(poses[at]) @ poses[k])
            c, s = np.cos(yaw), np.sin(yaw)
            out.append(ends(scan, MatchSettings()) @ np.array([[c, s], [-s, c]]) + [x, y])
    return np.concatenate(out)


def _thinned(points: np.ndarray, cell_m: float) -> np.ndarray:
    """One point (their mean) per cell: walls seen often count no more than walls seen once."""
    if len(points) == 0:
        return points
    _, at = np.unique(np.floor(points / cell_m).astype(int), axis=0, return_inverse=True)
    count = np.bincount(at)
    return np.stack([np.bincount(at, points[:, axis]) / count for axis in (0, 1)], axis=1)


def _drawn(points: np.ndarray) -> OccupancyGrid:
    """A map whose cells are occupied where at least two wall points lie."""
    low = points.min(axis=0) - 1.0
    at = np.floor((points - low) / CELL_M).astype(int)
    columns, rows = at.max(axis=0) + int(1.0 / CELL_M)
    counts = np.zeros((rows, columns))
    np.add.at(counts, (at[:, 1], at[:, 0]), 1.0)
    return OccupancyGrid(np.where(counts >= 2, 0.95, 0.05).astype(np.float32), CELL_M, (float(low[0]), float(low[1])))
