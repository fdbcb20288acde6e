"""Places seen again: a stretch of scans looked for in the map of an earlier passage.

The window grows with the way along the graph, because that is what the odometry may have drifted; loops that were found
are short cuts in it. Corridors look alike, so a find must stand three tests: no other place in the window fits nearly as
well; the beams of these scans do not look through the walls of the earlier passage; and unless the window is small, loops
beside it close the same way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from rhs.api.records import LoopEdge
from rhs.estimation.scans.planar_poses import between, composed, lifted
from rhs.estimation.scans.point_map import Cloud, PointMap, gathered, seen_directions
from rhs.estimation.scans.window_search import WindowSearch
from rhs.estimation.views.edge_consistency import agreement, largest_agreeing

from .config import ScanGraphAdvanced, Windows
from .graph import Graph
from .keys import HEIGHT, Keys, covariances_of

LOOP_WAY_M = 0.05  # of a loop along the graph
THIN_M = 0.15
FAR_M, CLEAR_M = 10.0, 0.4
WEAK = np.diag([10.0, 10.0, 100.0])  # of a find: information, 0.3 m and 0.1 rad
SOURCE_SCANS = 5  # whose beams are tested


@dataclass(frozen=True, eq=False)
class Find:
    """Key scan `later` seen from `earlier`: pose (3,), information (3, 3), how well, and the window it was found in."""

    earlier: int
    later: int
    pose: np.ndarray
    information: np.ndarray
    share: float
    window_m: float
    refused: str = ""


def search_loops(graph: Graph, windows: Windows) -> list[Find]:
    """Looks for loops all along the way; those that are accepted are in the graph. Returns those that were refused."""
    keys, waiting, refused = graph.keys, [], []
    next_m = 0.0
    for later in range(len(keys)):
        if keys.way_m[later] < next_m:
            continue
        next_m = keys.way_m[later] + windows.every_m
        for earlier, way_m in _candidates(graph, later, windows):
            find = _look(graph, (earlier, later), way_m, windows)
            if find is None:
                continue
            if find.refused:
                refused.append(find)
                continue
            waiting.append(find)
            accepted = _agreeing(graph, find, waiting, windows)
            if accepted:
                waiting = [one for one in waiting if all(one is not other for other in accepted)]
                graph.add(accepted)
    graph.settle()
    return refused + [replace(find, refused="no loop beside it agrees") for find in waiting]


def _candidates(graph: Graph, later: int, windows: Windows) -> list[tuple[int, float]]:
    """The nearest key scan of each earlier passage that may be this place, and the way there along the graph."""
    poses, keys = graph.poses, graph.keys
    way_m = _way_along(graph, later)
    gap_m = np.hypot(*(poses[:, :2] - poses[later, :2]).T)
    near = (gap_m < np.minimum(windows.radius_m + windows.growth * way_m, windows.most_m) + 1.0) & (way_m > windows.way_m)
    chosen = [int(part[gap_m[part].argmin()]) for part in keys.passages(np.nonzero(near[:later])[0], windows.way_m / 2)]
    chosen.sort(key=lambda k: gap_m[k])
    return [(k, float(way_m[k])) for k in chosen[: windows.passages]]


def _way_along(graph: Graph, start: int) -> np.ndarray:
    """(K,) metres from a key scan to each along odometry and loops."""
    count = len(graph.keys)
    step_m = np.diff(graph.keys.way_m)
    rows = np.concatenate([np.arange(count - 1), [find.earlier for find in graph.loops]]).astype(int)
    columns = np.concatenate([np.arange(1, count), [find.later for find in graph.loops]]).astype(int)
    length = np.concatenate([np.maximum(step_m, 1e-6), np.full(len(graph.loops), LOOP_WAY_M)])
    ties = coo_matrix((length, (rows, columns)), (count, count)).tocsr()
    return dijkstra(ties, directed=False, indices=start)


def _look(graph: Graph, pair: tuple[int, int], way_m: float, windows: Windows) -> Find | None:
    """The later of two key scans looked for around the earlier one; None when nothing like it is there."""
    keys, poses, settings = graph.keys, graph.poses, graph.settings
    earlier, later = pair
    window_m = min(windows.radius_m + windows.growth * way_m, windows.most_m)
    window_rad = min(windows.turn_rad + windows.turn_growth * way_m, windows.turn_most_rad)
    there = keys.along(earlier, windows.target_m, windows.target_m)
    here = keys.along(later, windows.source_m, windows.source_m)
    there, here = there[there < here[0]], here[here > earlier]
    walls = PointMap(*_seen(keys, poses, there, earlier, settings.points.cell_m))
    points, normals = _seen(keys, poses, here, later, THIN_M)
    if len(points) < 20 or len(walls.points) < 20:
        return None
    some = points[np.linspace(0, len(points) - 1, min(len(points), windows.points)).astype(int)]
    around = between(poses[earlier], poses[later])
    found = WindowSearch(walls.points, cell_m=windows.cell_m, sigma_m=windows.sigma_m).best(
        some, around, window_m=window_m, window_rad=window_rad, step_rad=windows.step_rad, least=windows.least_score,
        rivals=windows.rival)
    if found is None:
        return None
    source = Cloud(points, normals, np.empty(0), np.empty(0), np.zeros(3))
    fit = walls.fit(source, found.pose, WEAK, settings.points)
    information = seen_directions(fit.information, settings.points)
    find = Find(earlier, later, fit.pose, information, fit.share, window_m)
    if found.rival > windows.rival * found.score:
        return replace(find, refused=f"another place fits as well ({found.rival:.2f} of {found.score:.2f})")
    if fit.share < windows.least_share:
        return replace(find, refused=f"{fit.share:.0%} of the points find a wall")
    share = _through(graph, walls, here, find)
    return replace(find, refused=f"beams look through {share:.0%} of the walls") if share > windows.through else find


def _seen(keys: Keys, poses: np.ndarray, chosen: np.ndarray, frame: int, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of the chosen key scans in the frame of one."""
    return gathered([keys.clouds[k] for k in chosen], between(np.tile(poses[frame], (len(chosen), 1)), poses[chosen]),
                    cell_m=cell_m)


def _through(graph: Graph, walls: PointMap, here: np.ndarray, find: Find) -> float:
    """Share of the walls of the earlier passage that the beams of the scans `here` look through."""
    counts = np.zeros(2)
    for k in here[np.linspace(0, len(here) - 1, min(len(here), SOURCE_SCANS)).astype(int)]:
        pose = composed(find.pose, between(graph.poses[find.later], graph.poses[k]))
        counts += walls.seen_through(graph.keys.clouds[k], pose, far_m=FAR_M, clear_m=CLEAR_M)
    return float(counts[0] / max(counts.sum(), 1.0))


def _agreeing(graph: Graph, find: Find, waiting: list[Find], windows: Windows) -> list[Find]:
    """The finds, this one among them, that may be believed now."""
    if find.window_m < windows.alone_m and find.share > windows.alone_share:
        return [find]
    way_m = graph.keys.way_m
    beside = [one for one in waiting if one is find or (abs(way_m[one.later] - way_m[find.later]) < windows.beside_m
              and abs(way_m[one.earlier] - way_m[find.earlier]) < windows.beside_m)]
    edges = [loop_edge(one, graph.settings) for one in beside]
    agree = agreement(edges, lifted(graph.poses), way_m, graph.settings.agreeing)
    chosen = largest_agreeing(agree, np.ones(len(edges)))
    needed = 3 if find.window_m > windows.three_m else 2
    together = [beside[k] for k in chosen]
    return together if len(together) >= needed and any(one is find for one in together) else []


def loop_edge(find: Find, settings: ScanGraphAdvanced) -> LoopEdge:
    """The find as an edge between key scans."""
    covariance = covariances_of(find_spread(find, settings)) + HEIGHT
    return LoopEdge(find.earlier, find.later, lifted(find.pose[None])[0], covariance, int(100 * find.share),
                    not find.refused, find.refused)


def find_spread(find: Find, settings: ScanGraphAdvanced) -> np.ndarray:
    """(3, 3) covariance: what the scans see, no better than the floor."""
    floor = np.diag([settings.floor_m, settings.floor_m, settings.floor_rad]) ** 2
    spread: np.ndarray = np.linalg.inv(find.information + np.diag([1e-2, 1e-2, 1e-1])) + floor
    return 0.5 * (spread + spread.T)
