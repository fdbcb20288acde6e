"""The loop closer `scan_graph`: key scans, loops, pose graph, pairs, every scan.

Source: graph SLAM with scan matching (Lu and Milios 1997; Olson 2009; Grisetti, Kuemmerle, Stachniss, Burgard 2010). What
the map says of itself (rhs.estimation.scans.inconsistency) decides whether loops are looked for again in wider windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rhs.api.records import Closure, LoopEdge, View
from rhs.estimation.scans.planar_poses import between, composed, flat, lifted

from ..pose_graph import EXACT
from .config import ScanGraph, Windows
from .graph import Graph
from .keys import Keys, key_scans, odometry_edges
from .refine import refine_passages, refit
from .windows import Find, loop_edge, search_loops


class ScanGraphCloser:
    """Finds loops in a finished survey of laser scans and lays every scan onto its neighbours."""

    def __init__(self, settings: ScanGraph) -> None:
        self._settings = settings

    def close(self, views: Sequence[View]) -> Closure:
        """The corrected poses, and the loops."""
        given = np.array([view.map_from_body for view in views]).reshape(-1, 4, 4)
        keys = key_scans(views, self._settings)
        if keys is None:
            return Closure(given)
        believed = flat(given)[keys.view]
        graph, refused, details = self._closed(keys, believed)
        asked, spread = graph.spread()
        details["way_sigma_m"] = float(np.sqrt(np.trace(spread[:, :2, :2], axis1=1, axis2=2).mean()))
        unsure = np.full((len(views), 6, 6), np.nan)
        unsure[0], unsure[keys.view[asked]] = EXACT * np.eye(6), spread
        poses = refit(graph, tuple(views), self._settings.advanced.refinement)
        first = flat(given[:1])[0]
        moved = composed(np.tile(first, (len(poses), 1)), between(np.tile(poses[0], (len(poses), 1)), poses))
        out = lifted(moved)
        out[:, 2, 3], out[0] = given[:, 2, 3], given[0]
        edges = tuple(self._named(find, keys) for find in [*graph.loops, *refused])
        return Closure(out, edges, details, unsure)

    def _closed(self, keys: Keys, believed: np.ndarray) -> tuple[Graph, list[Find], dict[str, float]]:
        """The graph whose map contradicts itself least, the loops it refused, and figures."""
        windows, best, wider = self._settings.advanced.windows, None, -1
        odometry = odometry_edges(keys, believed, self._settings.advanced)
        while wider < self._settings.tries:
            wider += 1
            graph = Graph(keys, believed, odometry, self._settings)
            refused = search_loops(graph, windows)
            refine_passages(graph, self._settings.advanced.refinement)
            value = keys.inconsistency(graph.poses)
            if best is None or value < best[2]:
                best = graph, refused, value
            if not best[2] > self._settings.wrong_over:
                break
            windows = self._wider(windows)
        assert best is not None
        return best[0], best[1], {"key_scans": len(keys), "inconsistency": best[2], "wider_searches": wider}

    def _wider(self, windows: Windows) -> Windows:
        by = self._settings.wider
        return replace(windows, radius_m=by * windows.radius_m, growth=by * windows.growth, most_m=by * windows.most_m,
                       turn_rad=by * windows.turn_rad, turn_growth=by * windows.turn_growth,
                       turn_most_rad=min(by * windows.turn_most_rad, np.pi), passages=2 * windows.passages)

    def _named(self, find: Find, keys: Keys) -> LoopEdge:
        """The loop between views instead of key scans."""
        edge = loop_edge(find, self._settings.advanced)
        return replace(edge, earlier=int(keys.view[find.earlier]), later=int(keys.view[find.later]))
