"""Key scans of a survey, the nodes of the graph, and how far the odometry is trusted between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.records import Tracking, View
from rhs.estimation.filters.pose_graph import Edges
from rhs.estimation.scans.inconsistency import inconsistency
from rhs.estimation.scans.planar_poses import between, flat, lifted
from rhs.estimation.scans.point_map import Cloud, PointMap, cloud_of, gathered, seen_directions, without_passed

from .config import ScanGraph, ScanGraphAdvanced

LEAST_POINTS = 20
HEIGHT = np.diag([0.0, 0.0, 1e-6, 1e-6, 1e-6, 0.0])  # a laser on a floor stays there
STEP_FLOOR = np.diag([0.005, 0.005, 0.002]) ** 2  # of the motion between two key scans at best (metres, radians)
LAG = 13.0  # mean age of some 25 key scans in the map that the odometry lays a scan onto
BESIDE, BESIDE_M = (-8, -4, -2, 2, 4, 8), 4.0  # key scans on the same way that say what moved, metres of way at most
MOVED = np.array([0.2, 0.05, 0.01])  # what beams must pass a thing by; metres and radians the poses may be wrong by
BLIND_M = 2.0  # a stretch without a good scan gets a node after so much way all the same, metres


@dataclass(frozen=True, eq=False)
class Keys:
    """Of K key scans: view (K,) each is of, clouds, way_m (K,) from the start. Of all N views: key (N,) before each or its
    own, from_key (N, 3) the view as the odometry saw it from there."""

    view: np.ndarray
    clouds: list[Cloud]
    way_m: np.ndarray
    key: np.ndarray
    from_key: np.ndarray

    def __len__(self) -> int:
        return len(self.view)

    def along(self, k: int, before_m: float, after_m: float) -> np.ndarray:
        """Key scans within so much way before and after one."""
        low = np.searchsorted(self.way_m, self.way_m[k] - before_m)
        return np.arange(low, np.searchsorted(self.way_m, self.way_m[k] + after_m, side="right"))

    def passages(self, chosen: np.ndarray, apart_m: float) -> list[np.ndarray]:
        """Chosen key scans (M,) ascending, in stretches with less than so much way between neighbours."""
        if not len(chosen):
            return []
        return np.split(chosen, np.nonzero(np.diff(self.way_m[chosen]) > apart_m)[0] + 1)

    def inconsistency(self, poses: np.ndarray) -> float:
        """Share of walls that other passages look through, with the key scans at poses (K, 3)."""
        return inconsistency(self.clouds, poses, self.way_m)


def key_scans(views: Sequence[View], settings: ScanGraph) -> Keys | None:
    """The key scans of a survey; None where no two views have a scan."""
    states = flat(np.array([view.map_from_body for view in views])) if views else np.empty((0, 3))
    chosen: list[int] = []
    clouds: list[Cloud] = []
    for k, view in enumerate(views):
        if view.scan is None or (chosen and not _far(states[chosen[-1]], states[k], view, settings)):
            continue
        cloud = cloud_of(view.scan, settings.advanced.points)
        if len(cloud.points) >= LEAST_POINTS:
            chosen.append(k)
            clouds.append(cloud)
    if len(chosen) < 2:
        return None
    at = np.array(chosen)
    key = np.maximum(np.searchsorted(at, np.arange(len(views)), side="right") - 1, 0)
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(states[:, :2], axis=0).T))])
    return Keys(at, _still(clouds, states[at], way_m[at]), way_m[at], key, between(states[at[key]], states))


def _still(clouds: list[Cloud], poses: np.ndarray, way_m: np.ndarray) -> list[Cloud]:
    """The clouds at poses (K, 3) without what the beams of those beside them pass by."""
    beside = [[j for j in (k + step for step in BESIDE) if 0 <= j < len(clouds) and abs(way_m[j] - way_m[k]) < BESIDE_M]
              for k in range(len(clouds))]
    return [without_passed(cloud, poses[k], [(clouds[j], poses[j]) for j in beside[k]], MOVED)
            for k, cloud in enumerate(clouds)]


def _far(last: np.ndarray, state: np.ndarray, view: View, settings: ScanGraph) -> bool:
    moved = between(last, state)
    way_m = float(np.hypot(*moved[:2]))
    if view.motion.status is Tracking.LOST:
        return way_m > BLIND_M
    return way_m > settings.key_m or abs(float(moved[2])) > settings.key_rad


def odometry_edges(keys: Keys, poses: np.ndarray, settings: ScanGraphAdvanced) -> tuple[Edges, np.ndarray]:
    """The key scans one after another at poses (K, 3), as sure as each fits onto those before it; and what that leaves of an
    error in the long run, covariances (K - 1, 3, 3).

    A scan laid onto the mean of those before it leaves 1 / LAG of its error in the map; what the wheels say of a direction
    that no scan sees stays whole."""
    steps = between(poses[:-1], poses[1:])
    shares, information = np.empty(len(steps)), np.empty((len(steps), 3, 3))
    for k in range(1, len(keys)):
        before = keys.along(k, settings.map_m, 0.0)
        before = before[before < k][-30:]
        if not len(before):
            before = np.array([k - 1])
        walls = PointMap(*gathered([keys.clouds[j] for j in before], poses[before], cell_m=settings.points.cell_m))
        fit = walls.fit(keys.clouds[k], poses[k], np.eye(3), settings.points, steps=0)
        shares[k - 1], information[k - 1] = fit.share, fit.information
    wheels = np.linalg.inv(np.array([wheel_spread(step, settings) for step in steps]))
    seen = seen_directions(information, settings.points)
    spread = np.linalg.inv(seen + wheels)
    lag = LAG * np.eye(3) - (LAG - 1.0) * spread @ wheels  # of each direction: 1 where the wheels alone say it
    spread += STEP_FLOOR
    drift = np.linalg.inv(lag) @ spread @ np.linalg.inv(np.swapaxes(lag, 1, 2))
    spread[shares < 0.35] = drift[shares < 0.35] = np.diag([settings.loose_m, settings.loose_m, settings.loose_rad]) ** 2
    return edges_of(np.arange(len(steps)), np.arange(1, len(steps) + 1), steps, spread, robust=False), drift


def wheel_spread(step: np.ndarray, s: ScanGraphAdvanced) -> np.ndarray:
    """(3, 3) covariance of a motion (3,) of which nothing else is known."""
    way_m = float(np.hypot(*step[:2]))
    sigma_m = s.odometry_m + s.odometry_share * way_m
    sigma_rad = s.odometry_rad + s.odometry_share * abs(float(step[2])) + s.odometry_rad_per_m * way_m
    return np.diag([sigma_m, sigma_m, sigma_rad]) ** 2


def edges_of(first: np.ndarray, second: np.ndarray, seen: np.ndarray, spread: np.ndarray, *, robust: bool) -> Edges:
    """Edges of the pose graph from planar ones: seen (M, 3), spread (M, 3, 3)."""
    covariances = covariances_of(0.5 * (spread + np.swapaxes(spread, 1, 2))) + HEIGHT
    return Edges(np.asarray(first), np.asarray(second), lifted(seen), covariances, np.full(len(seen), robust))


def covariances_of(spread: np.ndarray) -> np.ndarray:
    """(..., 6, 6) of planar covariances (..., 3, 3): nothing of height, roll and pitch."""
    out = np.zeros((*spread.shape[:-2], 6, 6))
    plane = np.array([0, 1, 5])
    out[..., plane[:, None], plane] = spread
    return out
