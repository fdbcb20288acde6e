"""A world without pictures: a robot on a bitmap, with a ray-cast scan and exact odometry. For tests of the loop."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from rhs.api.contracts import WorldFacts
from rhs.api.geometry import camera_from_fov, inverse, planar, se2
from rhs.api.grid import OccupancyGrid, inflate
from rhs.api.records import Belief, Capture, Motion, Observation, Path, PlanReason, Scan, Tracking, Twist

BEARINGS = np.linspace(-0.5, 0.5, 41)


class Flatland:
    """A source that can be driven. `hidden` obstacles are put in when the patrol begins."""

    def __init__(self, occupied: np.ndarray, start, places, *, hidden: np.ndarray | None = None, slip: float = 1.0):
        self.occupied, self.hidden, self.slip = occupied.copy(), hidden, slip
        self.resolution, self.radius = 0.1, 0.3
        self.camera = camera_from_fov(32, 24, 57.0, height_m=1.0)
        h, w = occupied.shape
        bounds = (0.0, 0.0, w * 0.1, h * 0.1)
        self.facts = WorldFacts("flatland", tuple(start), tuple(places), bounds, self.radius)
        self.views_expected = None
        self.pose = se2(*start)
        self.index, self.stamp = 0, 0.0
        self.least, self.hit = np.inf, False

    def grid(self) -> OccupancyGrid:
        return OccupancyGrid(np.where(self.occupied, 0.95, 0.05).astype(np.float32), 0.1, (0.0, 0.0))

    def lead(self):
        return None

    def begin_patrol(self):
        if self.hidden is not None:
            self.occupied |= self.hidden

    def drive(self, command: Twist) -> Capture:
        for _ in range(10):
            dt = command.duration_s / 10
            step = se2(self.slip * command.forward_mps * dt, 0.0, command.turn_radps * dt)
            ahead = self.pose @ step
            gap = self._gap(ahead[:2, 3])
            self.least = min(self.least, gap)
            if gap <= 0:
                self.hit = True
                break
            self.pose = ahead
        self.index += 1
        self.stamp += command.duration_s
        return Capture(self.index, self.stamp, command=command, scan=self._scan())

    def truth(self):
        return self.pose.copy()

    def clearance_m(self):
        out = (self.least, self.hit)
        self.least, self.hit = np.inf, False
        return out

    def close(self):
        pass

    def _gap(self, xy) -> float:
        rows, columns = np.nonzero(self.occupied)
        centres = np.stack([(columns + 0.5) * 0.1, (rows + 0.5) * 0.1], axis=1)
        return float(np.linalg.norm(centres - xy, axis=1).min() - 0.05 - self.radius)

    def _scan(self) -> Scan:
        x, y, yaw = planar(self.pose)
        ranges = np.full(len(BEARINGS), np.inf)
        reach = np.arange(0.0, 6.0, 0.03)
        for i, bearing in enumerate(BEARINGS):
            px, py = x + reach * np.cos(yaw + bearing), y + reach * np.sin(yaw + bearing)
            r, c = (py / 0.1).astype(int), (px / 0.1).astype(int)
            inside = (r >= 0) & (r < self.occupied.shape[0]) & (c >= 0) & (c < self.occupied.shape[1])
            h, w = self.occupied.shape
            hit = inside & self.occupied[np.clip(r, 0, h - 1), np.clip(c, 0, w - 1)]
            if hit.any():
                ranges[i] = reach[np.argmax(hit)]
        return Scan(BEARINGS, ranges, 6.0)


class Through:
    """A sensor that adds nothing."""

    def __init__(self, camera):
        self.camera = camera

    def sense(self, capture: Capture) -> Observation:
        return Observation(capture.index, capture.stamp_s, self.camera, scan=capture.scan, command=capture.command)


class Oracle:
    """Odometry and localiser that know where the robot is: the loop is under test, not they."""

    def __init__(self, source: Flatland):
        self.source, self.previous = source, source.truth()

    def update(self, observation: Observation, motion: Motion | None = None):
        if motion is not None:
            return Belief(self.source.truth(), 1e-4 * np.eye(6))
        now = self.source.truth()
        step, self.previous = inverse(self.previous) @ now, now
        return Motion(step, 1e-6 * np.eye(6), Tracking.OK)


class Dijkstra:
    """A planner of a few lines, so that the loop is tested without any plugin. corners: it goes between two cells that touch
    at a corner, as a planner must not."""

    corners = True

    def plan(self, problem) -> Path:
        from scipy.sparse import csr_matrix
        from scipy.sparse.csgraph import dijkstra

        blocked = problem.blocked
        h, w = blocked.shape
        to_cell = lambda p: tuple(np.floor((np.asarray(p) - problem.origin_m) / problem.resolution_m).astype(int)[::-1])  # noqa: E731
        start, goal = to_cell(problem.start_m), to_cell(problem.goal_m)
        nothing = np.zeros((0, 2))
        if blocked[goal]:
            return Path(PlanReason.GOAL_BLOCKED, nothing, nothing)
        index = np.arange(h * w).reshape(h, w)
        rows, columns, costs = [], [], []
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            a = index[: h - dr, max(0, -dc): w - max(0, dc)]
            b = index[dr:, max(0, dc): w + min(0, dc)]
            ok = ~blocked.ravel()[a] & ~blocked.ravel()[b]
            if dr and dc and not self.corners:
                ok &= ~blocked.ravel()[a + w] & ~blocked.ravel()[b - w]
            rows.append(a[ok])
            columns.append(b[ok])
            costs.append(np.full(ok.sum(), np.hypot(dr, dc)))
        graph = csr_matrix((np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), (h * w, h * w))
        distance, previous = dijkstra(graph, directed=False, indices=index[start], return_predecessors=True)
        if not np.isfinite(distance[index[goal]]):
            return Path(PlanReason.DISCONNECTED, nothing, nothing)
        way = [index[goal]]
        while way[-1] != index[start]:
            way.append(previous[way[-1]])
        cells = np.stack(np.unravel_index(way[::-1], (h, w)), axis=1)
        points = (cells[:, ::-1] + 0.5) * problem.resolution_m + problem.origin_m
        points[0], points[-1] = problem.start_m, problem.goal_m
        return Path(PlanReason.OK, points, points)


def parts(localiser, planner=None, who=None) -> SimpleNamespace:
    """What a sentinel takes of a run's parts."""
    from rhs_replan import NewMission

    return SimpleNamespace(localiser=localiser, planner=planner or Dijkstra(), replan=NewMission(), slam=None, who=who)


def ring(size_m: float = 8.0, width_m: float = 2.0) -> np.ndarray:
    """Occupied cells of a closed square corridor."""
    n, wall = int(size_m * 10), 1
    k = int(width_m * 10)
    occupied = np.ones((n, n), bool)
    occupied[wall: n - wall, wall: n - wall] = False
    occupied[k: n - k, k: n - k] = True
    return occupied


__all__ = ["Flatland", "Through", "Oracle", "Dijkstra", "parts", "ring", "inflate"]
