"""Loop closer `pose_graph`: loops anywhere on the route, tested before one is believed, then least squares.

1. Appearance: VLAD likeness of all pairs of stored views far apart along the way; which are checked: candidates.py.
2. Geometry: one rigid motion (or PnP) explains the matches and covers what both views should show
   (rhs.estimation.views.view_pose).
3. Odometry over a window: the loop moves and turns no pose further than the odometry, straightened by the walls seen on
   the way, can have drifted; neighbouring views close the same loop; all accepted loops agree pairwise round the cycles
   they make (rhs.estimation.views.edge_consistency).
4. Scans: where a corridor is walked back the other way round no camera recognises anything; its walls on the way there
   and on the way back are laid onto one another (rhs.estimation.scans.scan_loops), which stand the same tests.
5. Graph: after solving (rhs.estimation.filters.pose_graph), a loop that stays unhappy or bends the odometry between its
   neighbours is thrown out and the rest is solved again. Of a long way only key poses are nodes
   (rhs.estimation.filters.key_poses).

What lies between the loops is held by the odometry, and by the straight walls that scans saw on the way (walls.py), which
know its heading far better; with walls, what share the odometry's metres are too short by is solved for too. Without loops
the walls alone straighten the survey.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from rhs.api.contracts import Context
from rhs.api.geometry import inverse, log_so3
from rhs.api.records import Closure, LoopEdge, View
from rhs.estimation.filters.kalman import gate
from rhs.estimation.filters.key_poses import KeyPoses, key_rows
from rhs.estimation.filters.pose_graph import CommonScale, Edges, Solution, joined, log_poses, marginals, optimise
from rhs.estimation.scans.planar_poses import flat, lifted
from rhs.estimation.scans.scan_loops import scan_edges
from rhs.estimation.views.edge_consistency import agreement, largest_agreeing, supported, surprise
from rhs.estimation.views.loops import closing_gap, edge_between, in_a_hand, poses_of, travelled_m
from rhs.estimation.views.settings import SightingSettings

from .candidates import beside, possible_pairs, progress_m, spread
from .config import PoseGraph, PoseGraphAdvanced
from .walls import WallGraph, crooked, followed, wall_graph

ANYWHERE = 1e3  # metres and radians: says nothing
EXACT = 1e-9  # square metres and square radians: where the map begins


@dataclass(frozen=True, eq=False)
class Between:
    """What holds the way between the loops: the poses (N, 4, 4) believed, the covariances (N - 1, 6, 6) of the motions that
    led there, whether a floor bears them, the walls seen."""

    believed: np.ndarray
    covariances: np.ndarray
    level: bool
    walls: WallGraph | None


@dataclass(frozen=True, eq=False)
class Solved:
    """edges: all of them, those refused that the graph does not bear. poses (N, 4, 4). walls: those that it bears. share: of
    which the odometry's metres are too short."""

    edges: list[LoopEdge]
    poses: np.ndarray
    walls: WallGraph | None
    share: float = 0.0


@dataclass(frozen=True, eq=False)
class Graph:
    """keys: the poses that are nodes. nodes (K + W, 4, 4): they, then the walls. edges: `of_odometry` of the odometry, then
    the loops, then sightings of walls. scale: what the odometry's metres are too short by is solved for."""

    keys: KeyPoses
    nodes: np.ndarray
    edges: Edges
    of_odometry: int
    scale: CommonScale | None


class PoseGraphCloser:
    """Finds, tests and uses loops."""

    def __init__(self, settings: PoseGraph, context: Context) -> None:
        self._settings, self._advanced, self._rng = settings, settings.advanced, context.rng
        ransac = settings.advanced.ransac
        self._sighting = SightingSettings(settings.min_inliers, settings.min_coverage, context.features.ratio, ransac,
                                          settings.advanced.depth_share)

    def close(self, views: Sequence[View]) -> Closure:
        """Walls, candidates, geometry, odometry, graph."""
        poses = poses_of(views)
        solid = in_a_hand(views)
        way_m = travelled_m(poses, solid=solid) if len(poses) else np.zeros(0)
        between = self._between(views, poses, way_m, solid=solid)
        straight = self._solved([], poses, between)
        between, poses = replace(between, walls=straight.walls), straight.poses
        found, checked = self._recognised(views, poses, way_m, solid=solid)
        found = self._likely(found, poses, between.covariances)
        first = self._solved(self._judged(found, poses, way_m, solid=solid), poses, between)
        if solid and self._borne_out(first.edges, between.believed):
            first = replace(first, poses=between.believed)
        last = first if solid else self._walked_back(first, views, between, way_m)
        accepted = sum(edge.accepted for edge in last.edges)
        by_scan = sum(edge.accepted for edge in last.edges[len(first.edges):])
        details = {"closures": float(accepted), "closures_by_scan": float(by_scan),
                   "closures_refused": float(len(last.edges) - accepted), "pairs_checked": float(checked),
                   **_of_walls(last)}  # fmt: skip
        unsure = None
        if not solid and len(views) > 1:
            honest = _motion_covariances(views, way_m, self._settings, self._advanced.motion_share)
            unsure = self._spread(last, replace(between, covariances=honest))
        return Closure(last.poses, tuple(last.edges), details, unsure)

    def _borne_out(self, edges: Sequence[LoopEdge], poses: np.ndarray) -> bool:
        """Whether a camera in a hand came back to where its loops are by what it believes, as far as they can tell: half of
        them fit as well as half would by their own noise alone. Such loops confirm; an odometry with a map of its own knows
        these places better than two views do, and moving it by their noise made it worse."""
        taken = [edge for edge in edges if edge.accepted]
        if not taken:
            return False
        off = log_poses(np.stack([closing_gap(poses, edge) for edge in taken]))
        spread = _loop_edges(taken, self._advanced).covariances
        chi2 = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[..., None])[..., 0])
        return bool(np.median(chi2) < gate(6, 0.5))

    def _between(self, views: Sequence[View], poses: np.ndarray, way_m: np.ndarray, *, solid: bool) -> Between:
        every_m = self._settings.walls_every_m
        rules, walls = self._advanced.walls, None
        if every_m > 0 and len(views) > 1:
            walls = wall_graph(followed(views, poses, rules, every_m=every_m), poses, rules)
        unsure = _motion_covariances(views, way_m, self._settings)
        return Between(poses, unsure, self._advanced.level_m > 0.0 and not solid, walls)

    def _recognised(self, views: Sequence[View], poses: np.ndarray, way_m: np.ndarray, *, solid: bool,
                    ) -> tuple[list[LoopEdge], int]:
        """Pairs of views that geometry confirms, and how many were checked: half of the checks go to one pair of each
        stretch of the way, the other half first to those beside a pair that was confirmed."""
        earlier, later = possible_pairs(views, poses, way_m, self._settings, self._rng, solid=solid)
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

    def _walked_back(self, solved: Solved, views: Sequence[View], between: Between, way_m: np.ndarray) -> Solved:
        """What follows after the scans of corridors walked the other way round have been heard too."""
        if self._settings.scan_every_m <= 0 or len(views) < 2:
            return solved
        found = scan_edges(views, solved.poses, way_m, self._advanced.scan_loops, every_m=self._settings.scan_every_m)
        more = self._judged(found, solved.poses, way_m)
        if not any(edge.accepted for edge in more):
            return replace(solved, edges=solved.edges + more)
        return self._solved(solved.edges + more, solved.poses, replace(between, walls=solved.walls))

    def _likely(self, edges: list[LoopEdge], poses: np.ndarray, motions: np.ndarray) -> list[LoopEdge]:
        """Refuse what the odometry calls all but impossible by its own covariances (N - 1, 6, 6)."""
        if self._advanced.odometry_probability == 1.0:
            return edges
        squared, most = surprise(edges, poses, motions), gate(3, self._advanced.odometry_probability)
        return [edge if off <= most else _refused(edge, f"moves the later view by {np.sqrt(off):.1f} sigmas of the odometry")
                for edge, off in zip(edges, squared, strict=True)]

    def _judged(self, edges: list[LoopEdge], poses: np.ndarray, way_m: np.ndarray, *, solid: bool = False) -> list[LoopEdge]:
        """Refuse what the odometry cannot have earned, what stands alone, and what contradicts the others
        (solid: in space)."""
        edges = [self._plausible(edge, poses, way_m) for edge in edges]
        alive = [k for k, edge in enumerate(edges) if edge.accepted]
        support = supported([edges[k] for k in alive], way_m, self._settings.window_m)
        for k, count in zip(alive, support, strict=True):
            if count < self._settings.support:
                edges[k] = _refused(edges[k], f"stands alone: {count} of {self._settings.support} views close this loop")
        alive = [k for k in alive if edges[k].accepted]
        agree = agreement([edges[k] for k in alive], poses, way_m, self._advanced.drift, solid=solid)
        chosen = set(largest_agreeing(agree, np.array([float(edges[k].inliers) for k in alive])))
        for n, k in enumerate(alive):
            if n not in chosen:
                edges[k] = _refused(edges[k], "contradicts the other loops through the odometry")
        return edges

    def _plausible(self, edge: LoopEdge, poses: np.ndarray, way_m: np.ndarray) -> LoopEdge:
        way = way_m[edge.later] - way_m[edge.earlier]
        gap = closing_gap(poses, edge)
        shift_m, turn_rad = float(np.linalg.norm(gap[:3, 3])), float(np.linalg.norm(log_so3(gap[:3, :3])))
        if shift_m > self._advanced.base_m + self._settings.max_drift_share * way:
            return _refused(edge, f"moves the later view by {shift_m:.1f} m after {way:.1f} m of way")
        turned_rad = max(progress_m(poses[edge.earlier : edge.later + 1])[-1] - way, 0.0)
        bounds = self._advanced.drift
        if turn_rad > bounds.base_rad + bounds.rad_per_m * way + self._advanced.turn_share * turned_rad:
            return _refused(edge, f"turns the later view by {np.degrees(turn_rad):.0f} degrees after {way:.1f} m of way")
        return edge

    def _solved(self, edges: list[LoopEdge], poses: np.ndarray, between: Between) -> Solved:
        """The graph solved from `poses` on, without the walls and the loops that it does not bear."""
        walls, kernel = between.walls, self._settings.kernel_sigma
        while walls is not None or any(edge.accepted for edge in edges):
            alive = [k for k, edge in enumerate(edges) if edge.accepted]
            solution = self._optimised([edges[k] for k in alive], poses, replace(between, walls=walls))
            loops, seen = np.split(solution.chi2, [len(alive)])
            bad = crooked(walls, seen, self._advanced.walls) if walls is not None else np.zeros(0, bool)
            worst = _unhappy(loops, kernel, self._advanced.gate_probability)
            if walls is not None and bad.any():
                walls = walls.without(bad)
            elif worst is not None:
                edges[alive[worst]] = _refused(edges[alive[worst]], "bends the graph: its residual stays outside the gate")
            else:
                return Solved(edges, solution.poses, walls, solution.share)
        return Solved(edges, between.believed, walls)

    def _optimised(self, loops: list[LoopEdge], poses: np.ndarray, between: Between) -> Solution:
        """The poses (N, 4, 4) that odometry, loops and walls agree on, solved from `poses` on; squared residuals of the
        loops, then of the walls."""
        graph = self._graph(loops, poses, between, self._advanced.most_poses)
        effort = self._advanced.effort if between.walls is not None else None
        solution = optimise(graph.nodes, graph.edges, kernel=self._settings.kernel_sigma, scale=graph.scale, effort=effort)
        solved = solution.poses[: len(graph.keys.rows)]
        return replace(solution, poses=graph.keys.filled(solved, solution.share), chi2=solution.chi2[graph.of_odometry:])

    def _graph(self, loops: list[LoopEdge], poses: np.ndarray, between: Between, most: int) -> Graph:
        """The graph of at most so many evenly spaced poses (N, 4, 4), and of those that loops and walls hold."""
        walls, held = between.walls, self._held(loops, between.believed)
        rows = key_rows(len(poses), most, held.from_at, held.to_at,
                        np.empty(0, int) if walls is None else walls.edges.from_at)
        keys = KeyPoses(between.believed, between.covariances, rows)
        odometry = keys.chain()
        if between.level:
            odometry = joined(odometry, level_edges(between.believed[rows], self._advanced, share=len(rows) / len(poses)))
        edges = joined(odometry, replace(held, from_at=np.searchsorted(rows, held.from_at),
                                         to_at=np.searchsorted(rows, held.to_at)))
        nodes, scale = poses[rows], None
        if walls is not None:
            edges = joined(edges, replace(walls.edges, from_at=np.searchsorted(rows, walls.edges.from_at),
                                          to_at=len(rows) + walls.wall_of))
            nodes = np.concatenate([nodes, walls.nodes(poses)])
            scale = CommonScale(np.arange(len(edges)) < len(odometry), self._settings.scale_sigma)
        return Graph(keys, nodes, edges, len(odometry), scale)

    def _spread(self, solved: Solved, between: Between) -> np.ndarray:
        """(N, 6, 6) covariances of the solved poses against the first, at every so many views; NaN at the others."""
        out = np.full((len(solved.poses), 6, 6), np.nan)
        out[0] = EXACT * np.eye(6)
        loops = [edge for edge in solved.edges if edge.accepted]
        graph = self._graph(loops, solved.poses, replace(between, walls=solved.walls), self._advanced.spread_poses)
        rows = graph.keys.rows
        at = np.searchsorted(rows, key_rows(len(solved.poses), self._advanced.spread_poses)[1:])
        scale = None if graph.scale is None else replace(graph.scale, share=solved.share)
        out[rows[at]] = marginals(graph.nodes, graph.edges, at, kernel=self._settings.kernel_sigma, scale=scale)
        return out

    def _held(self, loops: list[LoopEdge], poses: np.ndarray) -> Edges:
        """The loops as edges of the graph. Where depths are read off pictures, loops of the same two stretches of the way
        share the errors of their depths: together they know no more than one of them."""
        held = _loop_edges(loops, self._advanced)
        if self._advanced.depth_share == 0.0:
            return held
        alike = supported(loops, travelled_m(poses), self._settings.window_m)
        return replace(held, covariances=held.covariances * alike[:, None, None])


def _motion_covariances(views: Sequence[View], way_m: np.ndarray, settings: PoseGraph, share: float = 1.0) -> np.ndarray:
    """(N - 1, 6, 6) of the motions between the views, this share of them, widened by the drift the settings expect."""
    step_m = np.diff(way_m)
    turn = np.empty((len(step_m), 6, 6))
    for covariance, view in zip(turn, islice(views, 1, None), strict=True):
        covariance[...] = share * view.motion.covariance
    drift_m = settings.drift_m_per_m * step_m + 1e-3
    drift_rad = settings.drift_rad_per_m * step_m + 1e-3
    turn[:, range(3), range(3)] += (drift_m**2)[:, None]
    turn[:, range(3, 6), range(3, 6)] += (drift_rad**2)[:, None]
    return turn


def level_edges(poses: np.ndarray, s: PoseGraphAdvanced, *, share: float = 1.0) -> Edges:
    """A robot on a floor: every pose lies in the plane of the first and stands upright, wherever in it (loops of few points
    err in height and tilt, which the floor knows). share: that these poses are of all, for which they speak."""
    level = lifted(flat(inverse(poses[:1]) @ poses[1:]))
    sigma = np.array([ANYWHERE, ANYWHERE, s.level_m, s.level_rad, s.level_rad, ANYWHERE])
    count = len(level)
    return Edges(np.zeros(count, int), np.arange(1, count + 1), level, np.tile(share * np.diag(sigma**2), (count, 1, 1)),
                 np.zeros(count, bool))


def _loop_edges(edges: Sequence[LoopEdge], s: PoseGraphAdvanced) -> Edges:
    floor = np.diag([s.edge_sigma_m**2] * 3 + [s.edge_sigma_rad**2] * 3)
    return Edges(
        np.array([edge.earlier for edge in edges], int), np.array([edge.later for edge in edges], int),
        np.array([edge.earlier_from_later for edge in edges]).reshape(-1, 4, 4),
        np.array([edge.covariance + floor for edge in edges]).reshape(-1, 6, 6), np.ones(len(edges), bool),
    )  # fmt: skip


def _unhappy(chi2: np.ndarray, kernel: float, probability: float) -> int | None:
    """Which loop (position among their squared residuals) is worst and outside the gate, or None when all fit."""
    worst = int(chi2.argmax()) if len(chi2) else -1
    return worst if worst >= 0 and chi2[worst] > gate(6, probability) * kernel**2 else None


def _of_walls(solved: Solved) -> dict[str, float]:
    """What the closure says of walls: how many, seen how many times (edges between the loops), and the odometry's scale."""
    if solved.walls is None:
        return {"walls": 0.0, "edges_between": 0.0}
    return {"walls": float(len(np.unique(solved.walls.wall_of))), "edges_between": float(len(solved.walls.edges)),
            "odometry_short_share": solved.share}


def _refused(edge: LoopEdge, reason: str) -> LoopEdge:
    return replace(edge, accepted=False, reason=reason)
