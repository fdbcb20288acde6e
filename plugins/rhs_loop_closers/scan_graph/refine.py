"""After the loops: all key scans that overlap laid onto one another in pairs, then every scan onto the key scans
around it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rhs.api.records import View
from rhs.estimation.filters.pose_graph import joined
from rhs.estimation.scans.inconsistency import CLEAR_M
from rhs.estimation.scans.planar_poses import between, composed
from rhs.estimation.scans.point_map import Cloud, PointMap, cloud_of, gathered, seen_directions
from rhs.estimation.scans.settings import PointSettings

from .config import Refinement
from .graph import Graph, solved
from .keys import edges_of, wheel_spread

PAIR_FLOOR = np.diag([0.01, 0.01, 0.003]) ** 2  # of a pair of scans at best (1 sigma 1 cm, 3 mrad)
WEAK = np.diag([100.0, 100.0, 400.0])  # of a pair as believed: information, 0.1 m and 0.05 rad
SOLVED_KERNEL = 3.0


def refine_passages(graph: Graph, settings: Refinement) -> None:
    """Several rounds: key scans laid onto what other passages saw there, and the poses that agree with all of them."""
    keys, pairs = graph.keys, neighbours(graph, settings) if settings.rounds else []
    for number in range(settings.rounds):
        reach_m = settings.reach_m * settings.shrink**number
        maps: dict[int, PointMap] = {}
        first, second, seen, information = [], [], [], []
        for j, k in pairs:
            if j not in maps:
                maps[j] = _around(graph, j, settings)
            start = between(graph.poses[j], graph.poses[k])
            fit = maps[j].fit(keys.clouds[k], start, WEAK, graph.settings.points, steps=6, reach=(reach_m, reach_m))
            if fit.share <= settings.least_share:
                continue
            if _met(maps[j], keys.clouds[k], fit.pose, graph.settings.points) > settings.least_met:
                first.append(j)
                second.append(k)
                seen.append(fit.pose)
                information.append(fit.information)
        if not first:
            return
        known = seen_directions(np.array(information), graph.settings.points) + np.diag([1e-2, 1e-2, 1e-1])
        fits = edges_of(np.array(first), np.array(second), np.array(seen), np.linalg.inv(known) + PAIR_FLOOR, robust=True)
        edges = joined(graph.odometry, fits)
        graph.edges = joined(edges, graph.loop_edges()) if graph.loops else edges
        graph.poses = solved(graph.poses, graph.edges, SOLVED_KERNEL)


def _around(graph: Graph, j: int, settings: Refinement) -> PointMap:
    """What was seen on the way past a key scan, in its frame."""
    keys = graph.keys
    chosen = keys.along(j, settings.map_m, settings.map_m)
    seen_from = between(np.tile(graph.poses[j], (len(chosen), 1)), graph.poses[chosen])
    return PointMap(*gathered([keys.clouds[n] for n in chosen], seen_from, cell_m=graph.settings.points.cell_m))


def _met(walls: PointMap, cloud: Cloud, pose: np.ndarray, settings: PointSettings) -> float:
    """How many of the walls the beams of a scan end at from a pose (3,), as a share of the walls that it sees itself, both
    counted in cells. Without any it stands in the next corridor, and what looks alike is another wall."""
    _, met = walls.seen_through(cloud, pose, far_m=settings.range_max_m, clear_m=CLEAR_M)
    seen, _ = gathered([cloud], np.zeros((1, 3)), cell_m=settings.cell_m)
    return met / max(len(seen), 1)


def neighbours(graph: Graph, settings: Refinement) -> list[tuple[int, int]]:
    """Of each key scan the nearest ones of other passages, earlier or later."""
    keys, out = graph.keys, []
    near = cKDTree(graph.poses[:, :2]).query_ball_point(graph.poses[:, :2], settings.near_m)
    for k in range(len(keys)):
        others = np.sort(near[k])
        others = others[np.abs(keys.way_m[k] - keys.way_m[others]) > 2.0 * settings.map_m]
        if not len(others):
            continue
        gap_m = np.hypot(*(graph.poses[others, :2] - graph.poses[k, :2]).T)
        gaps_m = np.split(gap_m, np.nonzero(np.diff(keys.way_m[others]) > settings.near_m)[0] + 1)
        passages = keys.passages(others, settings.near_m)
        chosen = [(gap.min(), int(part[gap.argmin()])) for gap, part in zip(gaps_m, passages, strict=True)]
        out += [(j, k) for _, j in sorted(chosen)[: settings.partners]]
    return out


def refit(graph: Graph, views: tuple[View, ...], settings: Refinement) -> np.ndarray:
    """(N, 3) poses of all views: each scan laid onto the key scans around it, from where the odometry saw it."""
    keys = graph.keys
    poses = composed(graph.poses[keys.key], keys.from_key)
    tree = cKDTree(graph.poses[:, :2])
    for k in range(len(keys)):
        mine = np.nonzero(keys.key == k)[0]
        mine = mine[mine != keys.view[k]]
        if not len(mine):
            continue
        gap_m, around = tree.query(graph.poses[k, :2], k=min(settings.around, len(keys)),
                                   distance_upper_bound=settings.around_m)
        around = np.sort(np.atleast_1d(around)[np.isfinite(np.atleast_1d(gap_m))])
        around = np.unique(np.concatenate([around, np.arange(max(k - 1, 0), min(k + 2, len(keys)))]))
        walls = PointMap(*gathered([keys.clouds[j] for j in around], graph.poses[around], cell_m=settings.cell_m))
        for i in mine:
            scan = views[i].scan
            if scan is None:
                continue
            prior = np.linalg.inv(wheel_spread(keys.from_key[i], graph.settings))
            fit = walls.fit(cloud_of(scan, graph.settings.points), poses[i], prior, graph.settings.points, steps=8,
                            reach=(0.2, 0.12))
            if fit.share > settings.least_share:
                poses[i] = fit.pose
    return poses
