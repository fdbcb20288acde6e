"""Things that stand where the map says free: seen in the scans, forgotten when seen through, remembered for one mission only
(thesis 5.6)."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import planar
from rhs.api.grid import OccupancyGrid, inflate
from rhs.api.records import Scan
from rhs.estimation.scans.settings import VoteSettings

from .changed_map import ChangedMap
from .surroundings import NOTHING, TRAIL_S

CONFIRM_VIEWS, WITHIN_M = 2, 4.0  # views that a thing is seen in, and how near
PASSED_CELLS = 1.5  # a thing that a way squeezes past may turn out so much thicker, cells
BESIDE_CELLS = 1.5  # so near to what stays there nothing has gone, cells
LEAST_KEPT_S = 4.0  # what was seen once only is kept so long
TRAIL_KEPT_S = 15.0  # and a low thing near the robot, as in its surroundings (GuardSettings.look_s)
NEAR_WALL_M, NEAR_WALL_PER_M = 0.12, 0.05  # a hit this near a wall is the wall: map and belief, and 3 degrees of heading


def scan_points(map_from_body: np.ndarray, scan: Scan) -> np.ndarray:
    """(N, 2) map points of the ends of all beams; NaN where there is none."""
    x, y, yaw = planar(map_from_body)
    c, s = np.cos(yaw), np.sin(yaw)
    ox, oy = scan.origin_xy_m
    with_end = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, np.nan)
    bx = ox + with_end * np.cos(scan.bearings_rad)
    by = oy + with_end * np.sin(scan.bearings_rad)
    return np.stack([x + c * bx - s * by, y + s * bx + c * by], axis=1)


def in_map(points_m: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(K, 2) points of the body frame, in the map; pose (3,): x, y, yaw."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return points_m @ np.array([[c, s], [-s, c]]) + pose[:2]


def in_body(points_m: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(..., 2) points of the map, in the body frame of the pose (3,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (points_m - pose[:2]) @ np.array([[c, -s], [s, c]])


def spread(points_m: np.ndarray, by_m: float) -> np.ndarray:
    """(9 K, 2) the points (K, 2) and eight round each, so far off: where they may be."""
    angles = np.arange(8) * np.pi / 4.0
    round_m = by_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([points_m, (points_m[:, None] + round_m).reshape(-1, 2)])


class ObstacleWatch:
    """Compares scans with the finished map and keeps what the map does not know until it is seen through or forgotten.

    A cell counts as an obstacle when beams ended in it in at least CONFIRM_VIEWS, less those whose beams went through, the
    map calls it free, and no wall of the map lies near. Near grows with the distance of the hit up to `tolerance_m`, as the
    belief's error of heading moves it: a box beside a wall is told from the wall when the robot comes near.
    """

    def __init__(self, grid: OccupancyGrid, free: np.ndarray, *, tolerance_m: float, votes: VoteSettings | None = None,
                 changed: ChangedMap | None = None) -> None:
        from scipy.ndimage import distance_transform_edt

        from rhs.estimation.scans.votes import Votes  # compiled code, half a second to load

        self.grid, self.tolerance_m, self.changed = grid, tolerance_m, changed
        settings = votes or VoteSettings()
        self.least_votes = CONFIRM_VIEWS - settings.clear
        self._passed: np.ndarray | None = None  # (H, W) bool: what the way now driven squeezes past
        walls = grid.occupied()
        self._walls_m = grid.centres(np.argwhere(walls))
        gap_cells = distance_transform_edt(~walls) if walls.any() else np.full(grid.shape, np.inf)
        self._wall_gap_m = gap_cells * grid.resolution_m
        self.watch_on(free)
        self.at_eye, self.below = (Votes(grid.shape, grid.resolution_m, grid.origin_m, settings) for _ in range(2))
        # of each: when a beam of it last passed a cell or ended there; one at eye height says nothing of what lies lower
        self.seen_s = np.full((2, *grid.shape), -np.inf)
        self.since_s = np.full((2, *grid.shape), np.inf)  # when it first saw what stands there, also if forgotten since

    def watch_on(self, free: np.ndarray) -> None:
        """Tell things on these cells (H, W) from the map's walls, and take no notice of others."""
        self.gap_m = np.where(free, self._wall_gap_m, 0.0)  # to the nearest wall; 0 where nothing is known

    def forget(self) -> None:
        """A new mission begins with the map as surveyed, and with what was touched and nobody has looked through since."""
        self.at_eye.votes[:] = 0
        self.below.votes[~self._touched] = 0

    @property
    def _touched(self) -> np.ndarray:
        """(H, W) bool: where the robot ran into something."""
        return np.isneginf(self.since_s[1]) & (self.below.votes > 0.0)

    @property
    def touched_m(self) -> np.ndarray:
        """(K, 2) metres in the map: where the robot ran into something and nobody has looked through since."""
        return self.grid.centres(np.argwhere(self._touched))

    def planned(self, *, squeezed: bool) -> None:
        """A way was planned past what is known now; squeezed: nearer to it than its margin, on purpose."""
        self._passed = inflate(self.cells, PASSED_CELLS) if squeezed else None

    def on_way(self, way_m: np.ndarray, near_m: float) -> np.ndarray:
        """(K, 2) metres in the map: middles of the cells where something stands within near_m of the way (M, 2), unless the
        way squeezes past it."""
        cells = self.cells if self._passed is None else self.cells & ~self._passed
        where = self.grid.centres(np.argwhere(cells))
        if not len(where):
            return where
        return where[np.linalg.norm(where[:, None, :] - way_m[None, :, :], axis=2).min(axis=1) < near_m]

    def forget_gone(self, now_s: float, at_m: np.ndarray, blind_m: float, walked_m: np.ndarray = NOTHING) -> bool:
        """Forget what has been out of sight for longer than it was seen to stand: it may have gone. Whether there was any.
        Not what is low and within blind_m of the robot at (2,): it would not be seen to be still there; but what was seen
        for less than TRAIL_S, as the trail of a pet is, or where somebody was seen to walk (walked_m, (K, 2)), after
        TRAIL_KEPT_S.
        A box seen twice in a minute is remembered for another, somebody who stood there for two seconds is not. A rule of
        thumb in the place of the persistence filter (Rosen, Mason and Leonard 2016, Towards lifelong feature-based mapping
        in semi-static environments)."""
        gone, walked = self.cells, np.zeros(self.grid.shape, bool)
        walked[tuple(self.grid.cells(walked_m[self.grid.inside(walked_m)]).T)] = True
        for layer, seen_s, since_s in zip((self.at_eye, self.below), self.seen_s, self.since_s, strict=True):
            stays = (layer.votes > 0.0) & (now_s - seen_s <= np.maximum(seen_s - since_s, LEAST_KEPT_S))
            if layer is self.below and blind_m > 0.0:
                trail = ((seen_s - since_s < TRAIL_S) | walked) & (now_s - seen_s > TRAIL_KEPT_S)
                stays |= self.near(at_m, blind_m) & (layer.votes > 0.0) & ~trail
            layer.votes[~inflate(stays, BESIDE_CELLS)] = 0.0
        return bool((gone & ~self.cells).any())

    def low(self, at_m: np.ndarray) -> bool:
        """Whether nothing was seen at the camera's height at the point (2,) of the map."""
        row, column = np.clip(self.grid.cells(at_m)[0], 0, np.array(self.grid.shape) - 1)
        return bool(self.at_eye.votes[row, column] <= 0.0)

    def near(self, at_m: np.ndarray, within_m: float) -> np.ndarray:
        """(H, W) bool: cells whose middle is so near to the point (2,) of the map."""
        rows, columns = (np.arange(count) + 0.5 for count in self.grid.shape)
        y_m, x_m = (steps * self.grid.resolution_m for steps in (rows, columns))
        gaps_m = np.hypot(y_m[:, None] + self.grid.origin_m[1] - at_m[1], x_m[None] + self.grid.origin_m[0] - at_m[0])
        return gaps_m < within_m

    def look(self, map_from_body: np.ndarray, scan: Scan | None, obstacle: Scan | None = None, *,
             now_s: float = 0.0, moves: bool = False) -> None:
        """Count one view: its scan, and what its whole depth image shows besides. moves: something was seen to, lately."""
        from rhs.estimation.scans.votes import low_only

        for layer in (self.at_eye, self.below):
            layer.walks[:] = moves
        if scan is not None:
            self._count(0, map_from_body, scan, hits=self._unknown(map_from_body, scan), now_s=now_s)
        if obstacle is not None:
            hits = low_only(obstacle, scan) & self._unknown(map_from_body, obstacle)
            self._count(1, map_from_body, obstacle, hits=hits, now_s=now_s)
        if self.changed is not None:
            self.changed.look(map_from_body, scan, obstacle, WITHIN_M)

    def redrawn(self) -> OccupancyGrid | None:
        """The map with what has gone and what came to stay, where it may change and did."""
        if self.changed is None:
            return None
        return self.changed.grid if self.changed.update(self.stood_s) else None

    @property
    def stood_s(self) -> np.ndarray:
        """(H, W) for how long something that the map does not know was seen to stand in each cell, seconds."""
        return np.where(self.cells, (self.seen_s - self.since_s).max(axis=0), 0.0)

    def _count(self, number: int, map_from_body: np.ndarray, scan: Scan, *, hits: np.ndarray, now_s: float) -> None:
        """Count a scan in the layer of that number."""
        layer = (self.at_eye, self.below)[number]
        before = layer.votes.copy() if layer.walks.any() else layer.votes
        rows, columns = layer.look(map_from_body, scan, hits=hits, within_m=WITHIN_M).T
        since_s, votes = self.since_s[number, rows, columns], layer.votes[rows, columns]
        stands = (votes > 0.0) & ~(layer.walks[rows, columns] & (votes < before[rows, columns]))  # nobody: others come there
        self.since_s[number, rows, columns] = np.where(stands, np.minimum(since_s, now_s), np.inf)
        self.seen_s[number, rows, columns] = now_s

    def _unknown(self, map_from_body: np.ndarray, scan: Scan) -> np.ndarray:
        """(N,) bool: the beam ends where the map knows of nothing."""
        near_m = np.minimum(self.tolerance_m, NEAR_WALL_M + NEAR_WALL_PER_M * scan.ranges_m)
        return self.unknown(scan_points(map_from_body, scan), near_m)

    def unknown(self, points_m: np.ndarray, near_m: float | np.ndarray = NEAR_WALL_M) -> np.ndarray:
        """(N,) bool: the map calls the point (N, 2) free and has no wall within near_m of it. NaN is not."""
        known = np.isfinite(points_m).all(axis=1)
        points = np.where(known[:, None], points_m, 0.0)
        cells = np.clip(self.grid.cells(points), 0, np.array(self.grid.shape) - 1)
        return known & self.grid.inside(points) & (self.gap_m[cells[:, 0], cells[:, 1]] > near_m)

    def walls_near(self, pose: np.ndarray, within_m: float = 1.0) -> np.ndarray:
        """(K, 2) the map's walls so near to the pose (3,), in its body frame."""
        return in_body(self._walls_m[np.linalg.norm(self._walls_m - pose[:2], axis=1) < within_m], pose)

    def bump(self, points_m: np.ndarray) -> None:
        """Something was touched at these map points (K, 2)."""
        points = points_m[self.unknown(points_m)]
        cells = self.grid.cells(points)
        self.below.votes[cells[:, 0], cells[:, 1]] = self.below.settings.most
        self.seen_s[1, cells[:, 0], cells[:, 1]] = np.inf
        self.since_s[1, cells[:, 0], cells[:, 1]] = -np.inf

    def known_near(self, pose: np.ndarray) -> np.ndarray:
        """(K, 2) what the map or this watch knows near the pose (3,), in its body frame."""
        return np.concatenate([self.walls_near(pose), in_body(self.grid.centres(np.argwhere(self.cells)), pose)])

    @property
    def cells(self) -> np.ndarray:
        """(H, W) bool: where something stands that the map does not know."""
        return (self.at_eye.votes >= self.least_votes) | (self.below.votes >= self.least_votes)
