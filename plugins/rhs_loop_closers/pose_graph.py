"""Loop closer `pose_graph`: loops anywhere on the route, tested before one is believed, then least squares.

1. Appearance: VLAD likeness of all pairs of stored views far apart along the way; which are checked: candidates.py.
2. Geometry: one rigid motion (or PnP) explains the matches and covers what both views should show (rhs.sighting).
3. Odometry over a window: the loop moves no pose further than the odometry can have drifted; neighbouring views close the
   same loop; all accepted loops agree pairwise round the cycles they make (rhs.consistency).
4. Scans: where a corridor is walked back the other way round no camera recognises anything; its walls on the way there
   and on the way back are laid onto one another (rhs.scanloops), which stand the same tests.
5. Graph: after solving (rhs.posegraph), a loop that stays unhappy or bends the odometry between its neighbours is thrown
   out and the rest is solved again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rhs.consistency import DriftBounds, agreement, largest_agreeing, supported
from rhs.contracts import Context
from rhs.filtering import gate
from rhs.loops import closing_gap, edge_between, poses_of, travelled_m
from rhs.posegraph import Edges, Solution, chain, joined, optimise
from rhs.records import Closure, LoopEdge, View
from rhs.scanloops import ScanLoopSettings, scan_edges
from rhs.sighting import SightingSettings

from .candidates import beside, possible_pairs, progress_m, spread
from .pose_graph_config import PoseGraph

# A loop edge is trusted to this much at best: the check's own covariance leaves out what all its points share.
EDGE_SIGMA_M, EDGE_SIGMA_RAD = 0.02, 0.005


class PoseGraphCloser:
    """Finds, tests and uses loops."""

    def __init__(self, settings: PoseGraph, context: Context) -> None:
        self._settings, self._rng = settings, context.rng
        self._sighting = SightingSettings(settings.min_inliers, settings.min_coverage, context.features.ratio)

    def close(self, views: Sequence[View]) -> Closure:
        """Candidates, geometry, odometry, graph."""
        poses = poses_of(views)
        way_m = travelled_m(poses) if len(poses) else np.zeros(0)
        found, checked = self._recognised(views, poses, way_m)
        edges = self._judged(found, poses, way_m)
        solved = self._solved(edges, views, poses, poses, way_m)
        edges, poses = self._walked_back(solved, views, poses, way_m)
        accepted = sum(edge.accepted for edge in edges)
        details = {"closures": float(accepted), "closures_by_scan": float(sum(e.accepted for e in edges[len(solved[0]):])),
                   "closures_refused": float(len(edges) - accepted),
                   "pairs_checked": float(checked)}  # fmt: skip
        return Closure(poses, tuple(edges), details)

    def _recognised(self, views: Sequence[View], poses: np.ndarray, way_m: np.ndarray) -> tuple[list[LoopEdge], int]:
        """Pairs of views that geometry confirms, and how many were checked: half of the checks go to one pair of each
        stretch of the way, the other half first to those beside a pair that was confirmed."""
        earlier, later = possible_pairs(views, poses, way_m, self._settings, self._rng)
        seen_m, most = progress_m(poses), self._settings.checks
        ends_m = np.stack([seen_m[earlier], seen_m[later]], axis=1)
        first = spread(ends_m, self._settings.window_m / 3.0, -(-most // 2))
        edges = [self._edge(views, earlier[k], later[k]) for k in first]
        hits = [k for k, edge in zip(first, edges, strict=True)
                if edge is not None and self._plausible(edge, poses, way_m).accepted]
        second = beside(ends_m, first, hits, self._settings.window_m, most - len(first))
        edges += [self._edge(views, earlier[k], later[k]) for k in second]
        return [edge for edge in edges if edge is not None], len(edges)

    def _edge(self, views: Sequence[View], earlier: int, later: int) -> LoopEdge | None:
        return edge_between(views, int(earlier), int(later), settings=self._sighting, rng=self._rng)

    def _walked_back(self, solved: tuple[list[LoopEdge], np.ndarray], views: Sequence[View], believed, way_m: np.ndarray):
        """The edges and poses after the scans of corridors walked the other way round have been heard too."""
        edges, poses = solved
        if self._settings.scan_every_m <= 0 or len(views) < 2:
            return edges, poses
        found = scan_edges(views, poses, way_m, ScanLoopSettings(self._settings.scan_every_m))
        more = self._judged(found, poses, way_m)
        if not any(edge.accepted for edge in more):
            return edges + more, poses
        return self._solved(edges + more, views, poses, believed, way_m)

    def _judged(self, edges: list[LoopEdge], poses: np.ndarray, way_m: np.ndarray) -> list[LoopEdge]:
        """Refuse what the odometry cannot have earned, what stands alone, and what contradicts the others."""
        edges = [self._plausible(edge, poses, way_m) for edge in edges]
        alive = [k for k, edge in enumerate(edges) if edge.accepted]
        support = supported([edges[k] for k in alive], way_m, self._settings.window_m)
        for k, count in zip(alive, support, strict=True):
            if count < self._settings.support:
                edges[k] = _refused(edges[k], f"stands alone: {count} of {self._settings.support} views close this loop")
        alive = [k for k in alive if edges[k].accepted]
        agree = agreement([edges[k] for k in alive], poses, way_m, DriftBounds())
        chosen = set(largest_agreeing(agree, np.array([float(edges[k].inliers) for k in alive])))
        for n, k in enumerate(alive):
            if n not in chosen:
                edges[k] = _refused(edges[k], "contradicts the other loops through the odometry")
        return edges

    def _plausible(self, edge: LoopEdge, poses: np.ndarray, way_m: np.ndarray) -> LoopEdge:
        way = way_m[edge.later] - way_m[edge.earlier]
        shift_m = float(np.linalg.norm(closing_gap(poses, edge)[:3, 3]))
        if shift_m <= 0.5 + self._settings.max_drift_share * way:
            return edge
        return _refused(edge, f"moves the later view by {shift_m:.1f} m after {way:.1f} m of way")

    def _solved(self, edges: list[LoopEdge], views: Sequence[View], poses: np.ndarray, believed, way_m: np.ndarray):
        """The edges, with those refused that the graph does not bear, and the poses that follow from the rest; solved from
        `poses` on, with the odometry that led to the `believed` ones (both (N, 4, 4))."""
        odometry = _odometry_edges(views, believed, way_m, self._settings) if len(views) > 1 else None
        while any(edge.accepted for edge in edges):
            assert odometry is not None
            alive = [k for k, edge in enumerate(edges) if edge.accepted]
            graph = joined(odometry, _loop_edges([edges[k] for k in alive]))
            solution = optimise(poses, graph, kernel=self._settings.kernel_sigma)
            worst = _unhappy(solution, len(odometry), self._settings.kernel_sigma)
            if worst is None:
                return edges, solution.poses
            edges[alive[worst]] = _refused(edges[alive[worst]], "bends the graph: its residual stays outside the gate")
        return edges, believed


def _odometry_edges(views: Sequence[View], poses: np.ndarray, way_m: np.ndarray, settings: PoseGraph) -> Edges:
    """The chain of motions as the poses hold it, its covariance widened by the drift the settings expect."""
    step_m = np.diff(way_m)
    turn = np.array([views[k].motion.covariance for k in range(1, len(views))])
    drift_m = settings.drift_m_per_m * step_m + 1e-3
    drift_rad = settings.drift_rad_per_m * step_m + 1e-3
    floor = np.zeros_like(turn)
    floor[:, range(3), range(3)] = (drift_m**2)[:, None]
    floor[:, range(3, 6), range(3, 6)] = (drift_rad**2)[:, None]
    return chain(poses, turn + floor)


def _loop_edges(edges: Sequence[LoopEdge]) -> Edges:
    floor = np.diag([EDGE_SIGMA_M**2] * 3 + [EDGE_SIGMA_RAD**2] * 3)
    return Edges(
        np.array([edge.earlier for edge in edges]), np.array([edge.later for edge in edges]),
        np.stack([edge.earlier_from_later for edge in edges]), np.stack([edge.covariance + floor for edge in edges]),
        np.ones(len(edges), bool),
    )  # fmt: skip


def _unhappy(solution: Solution, odometry_count: int, kernel: float) -> int | None:
    """Which loop edge (position among them) is worst and outside the gate, or None when all fit."""
    loops = solution.chi2[odometry_count:]
    worst = int(loops.argmax())
    return worst if loops[worst] > gate(6, 0.999) * kernel**2 else None


def _refused(edge: LoopEdge, reason: str) -> LoopEdge:
    return replace(edge, accepted=False, reason=reason)
