"""Walls seen again and again along the way: what holds a survey straight between its loops.

A loop says where its two ends lie, and nothing of where on the way between the error arose. A straight wall does: every
scan that sees it knows its direction to a twentieth of a degree and its distance to millimetres, and the same wall is seen
over many metres, round a corner even. So each wall becomes a node of the pose graph, and each scan that sees it an edge
that knows the direction of the wall and the distance to it, and nothing of the place along it (lines as landmarks: compare
Castellanos, Montiel, Neira, Tardos, The SPmap, IEEE Trans. Robotics and Automation 15(5), 1999).

A wall is followed from scan to scan, where the odometry has hardly had time to drift; lost from sight, it is forgotten, so
that a look-alike wall elsewhere is another wall: finding places again is the business of loops. Nothing is assumed of how
walls stand to one another, only that a wall is straight as far as it is followed, which the odometry must bear out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from rhs.api.geometry import inverse, planar, wrap
from rhs.api.records import View
from rhs.estimation.filters.pose_graph import Edges, adjoints
from rhs.estimation.scans.planar_poses import between
from rhs.estimation.scans.wall_lines import WallLine, find_wall_lines

from .candidates import progress_m
from .config import WallSettings


@dataclass
class FollowedWall:
    """A wall being followed: its sightings, its frame in the map as last seen well (x, y, yaw), the stretch seen so far
    along that x (low, high); way, turning and yaw at the first sighting and at the one the frame is of; way at the last."""

    state: np.ndarray
    sigma_rad: float
    stretch: tuple[float, float]
    first: tuple[float, float, float]
    frame: tuple[float, float, float]
    last_m: float
    sightings: list[tuple[int, WallLine]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class WallGraph:
    """Nodes for N views and W walls: first (W,) the view that saw each first, first_from_wall (W, 4, 4); edges from views to
    walls, whose positions follow those of the views; wall_of (M,) of each edge."""

    first: np.ndarray
    first_from_wall: np.ndarray
    edges: Edges
    wall_of: np.ndarray

    def nodes(self, poses: np.ndarray) -> np.ndarray:
        """(W, 4, 4) where the walls stand in the map if the views stand at `poses` (N, 4, 4)."""
        return poses[self.first] @ self.first_from_wall

    def without(self, bad: np.ndarray) -> WallGraph:
        """The same without the sightings of some walls (W,) bool."""
        kept = ~bad[self.wall_of]
        e = self.edges
        edges = Edges(e.from_at[kept], e.to_at[kept], e.from_from_to[kept], e.covariances[kept], e.robust[kept])
        return WallGraph(self.first, self.first_from_wall, edges, self.wall_of[kept])


def followed(
    views: Sequence[View], poses: np.ndarray, settings: WallSettings, *, every_m: float = 0.6
) -> list[FollowedWall]:
    """The walls that several scans see, from believed poses (N, 4, 4). every_m: way between two scans looked at."""
    way_m, turned_rad = progress_m(poses), _turned_rad(poses)
    walls: list[FollowedWall] = []
    for k in _looks(views, way_m, every_m):
        scan = views[k].scan
        at = float(way_m[k]), float(turned_rad[k])
        for line in find_wall_lines(scan, settings.lines) if scan is not None else []:
            state = planar(poses[k] @ line.body_from_line)
            wall = _same(walls, line, state, at, settings)
            if wall is None:
                stretch = float(line.ends_m[0]), float(line.ends_m[1])
                wall = FollowedWall(state, line.sigma_rad, stretch, (*at, float(state[2])), (*at, float(state[2])), at[0])
                walls.append(wall)
            else:
                _extend(wall, line, state, at)
            wall.last_m = at[0]
            wall.sightings.append((k, line))
    return [wall for wall in walls if _is_straight(wall, settings)]


def wall_graph(walls: Sequence[FollowedWall], poses: np.ndarray, settings: WallSettings) -> WallGraph | None:
    """Nodes and edges of the walls, with the views at believed poses (N, 4, 4); None without walls."""
    if not walls:
        return None
    first = np.array([wall.sightings[0][0] for wall in walls])
    first_from_wall = np.stack([wall.sightings[0][1].body_from_line for wall in walls])
    wall_of = np.array([n for n, wall in enumerate(walls) for _ in wall.sightings])
    seen = [sighting for wall in walls for sighting in wall.sightings]
    view_at, lines = np.array([k for k, _ in seen]), [line for _, line in seen]
    body_from_line = np.stack([line.body_from_line for line in lines])
    node = (poses[first] @ first_from_wall)[wall_of]
    along = (inverse(body_from_line) @ inverse(poses[view_at]) @ node)[:, 0, 3]
    shift = np.tile(np.eye(4), (len(seen), 1, 1))
    shift[:, 0, 3] = along  # nothing is known of the place along the wall: it is taken to be as believed
    # what no scan shows: where along the wall it is, its height and its tilt
    spread = np.tile(np.diag([settings.blind_m, 1.0, 1.0, 1.0, 1.0, 1.0]) ** 2, (len(seen), 1, 1))
    sigma_rad = float(np.radians(settings.sigma_deg))
    spread[:, 1, 1] = [line.sigma_m**2 + settings.sigma_m**2 for line in lines]
    spread[:, 5, 5] = [line.sigma_rad**2 + sigma_rad**2 for line in lines]
    move = adjoints(inverse(shift))
    edges = Edges(view_at, len(poses) + wall_of, body_from_line @ shift, move @ spread @ np.swapaxes(move, 1, 2),
                  np.ones(len(seen), bool))  # fmt: skip
    return WallGraph(first, first_from_wall, edges, wall_of)


def crooked(graph: WallGraph, chi2: np.ndarray, settings: WallSettings) -> np.ndarray:
    """(W,) bool: walls whose sightings (squared residuals (M,), two degrees of freedom each) do not fit one line."""
    count = np.bincount(graph.wall_of, minlength=len(graph.first))
    total = np.bincount(graph.wall_of, np.minimum(chi2, 1e6), minlength=len(graph.first))
    return total > 2.0 * settings.fit_sigma**2 * count


def _looks(views: Sequence[View], way_m: np.ndarray, every_m: float) -> Iterator[int]:
    """Views whose scan is looked at: of a sensor that measures it, on a robot that stands on a floor."""
    last_m = -np.inf
    for k, view in enumerate(views):
        measured = view.scan is not None and view.motion.scan is None and view.camera.height_m > 0.0
        if measured and way_m[k] >= last_m + every_m:
            last_m = way_m[k]
            yield k


def _turned_rad(poses: np.ndarray) -> np.ndarray:
    """(N,) radians turned about z up to each pose, whichever way."""
    yaw = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(yaw)))])


def _is_straight(wall: FollowedWall, settings: WallSettings) -> bool:
    """Whether enough scans see the wall and show no curvature, all of them together."""
    weight = np.array([line.sigma_bend**-2 for _, line in wall.sightings])
    bend = np.array([line.bend_per_m for _, line in wall.sightings])
    if len({k for k, _ in wall.sightings}) < settings.least:
        return False
    unsure = settings.bend_sigma * weight.sum() ** -0.5
    return bool(abs(weight @ bend) / weight.sum() < unsure < settings.bend_per_m)


def _same(
    walls: list[FollowedWall], line: WallLine, state, at: tuple[float, float], settings: WallSettings
) -> FollowedWall | None:
    """The wall that a line, believed at `state` (3,), sees the most of again, or None. at: way and turning up to there."""
    best, most_m = None, -np.inf
    for wall in walls:
        if at[0] - wall.last_m <= settings.forget_m:
            shared_m = _shared_m(wall, line, state, at, settings)
            if shared_m > most_m:
                best, most_m = wall, shared_m
    return best


def _shared_m(
    wall: FollowedWall, line: WallLine, state: np.ndarray, at: tuple[float, float], settings: WallSettings
) -> float:
    """Metres of the wall seen before that a line, believed at `state` (3,), sees again; -inf when it is another wall."""
    sigma_rad = np.sqrt(line.sigma_rad**2 + wall.sigma_rad**2 + 2.0 * np.radians(settings.sigma_deg) ** 2)
    for then_m, then_rad, yaw_rad in (wall.frame, wall.first):
        drift_rad = settings.drift_rad_per_m * (at[0] - then_m) + settings.drift_share * (at[1] - then_rad)
        if abs(wrap(state[2] - yaw_rad)) > settings.match_sigma * sigma_rad + drift_rad:
            return -np.inf
    x_m, y_m, turned = between(wall.state, state)
    low, high = max(x_m + line.ends_m[0], wall.stretch[0]), min(x_m + line.ends_m[1], wall.stretch[1])
    lever_m = 0.5 * (low + high) - x_m
    off_m = abs(y_m + lever_m * turned)
    same = high - low > -settings.gap_m and off_m <= settings.off_m + 2.0 * line.sigma_m
    return high - low if same else -np.inf


def _extend(wall: FollowedWall, line: WallLine, state: np.ndarray, at: tuple[float, float]) -> None:
    """The wall with the stretch of one more sighting; its frame moves there unless that sighting is much vaguer."""
    if line.sigma_rad <= 1.5 * wall.sigma_rad:
        back_m = between(state, wall.state)[0]
        wall.stretch = min(back_m + wall.stretch[0], line.ends_m[0]), max(back_m + wall.stretch[1], line.ends_m[1])
        wall.state, wall.sigma_rad, wall.frame = state, line.sigma_rad, (*at, float(state[2]))
        return
    on_m = between(wall.state, state)[0]
    wall.stretch = min(on_m + line.ends_m[0], wall.stretch[0]), max(on_m + line.ends_m[1], wall.stretch[1])
