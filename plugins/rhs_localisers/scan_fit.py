"""Is the robot where it believes itself, or where the map says nothing (off the map, or map and world differ)?

A particle filter compares poses in the map with one another: the best of them gets all the weight, also where the robot is
in a room that the map does not show. So `off` is a hypothesis of its own. The scans of the last metres, laid together by
the odometry, are laid onto the map at the belief, and every metre onto the whole map, for the best rival elsewhere. What
the map explains at wrong poses is its own null distribution: the best of as many wrong poses off the map explains about as
much as the best rival, and more by d with a chance that falls exponentially in d (the tail of the largest of many; Karlin
and Altschul, PNAS 87 (1990) 2264, judge matches of sequences by it). So the log-odds of the belief against `off` grow with
the margin over the best rival. A scan is evidence once: the margin weighs the chance that the belief had when the oldest
scan of the window came, less what may have happened in between, for a robot may leave the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import inverse, planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.jit import compiled
from rhs.api.records import Scan

from .advanced import FitSettings


@dataclass
class Frame:
    """One scan of the window: starts and ends (B, 4) of its beams in the body frame, metres, the pose by the odometry, the
    way gone when it came, and the chance of the belief by then."""

    beams: np.ndarray
    odom_from_body: np.ndarray
    way_m: float
    chance: float


class FitWatch:
    """The chance that the robot is where it believes itself and the map shows it."""

    def __init__(self, grid: OccupancyGrid, settings: FitSettings) -> None:
        from scipy.ndimage import distance_transform_edt

        self.settings, self._grid = settings, grid
        occupied = grid.occupied()
        gap_m = distance_transform_edt(~occupied) * grid.resolution_m if occupied.any() else np.full(grid.shape, np.inf)
        self._hit = np.exp(-0.5 * (gap_m / settings.sigma_m) ** 2).astype(np.float32)
        self._solid = occupied.astype(np.uint8)
        self._mapped = (occupied | grid.free() | (gap_m <= 2.0 * settings.sigma_m)).astype(np.uint8)
        self.start()

    def start(self, chance: float | None = None) -> None:
        """A robot that begins, or was carried off: no scan of before counts. chance: of its belief, if it is known."""
        least, most = self.settings.prior, self.settings.most
        self.chance = least if chance is None else float(np.clip(chance, least, most))
        self.share = self.rival = float("nan")  # explained from the belief, and most of what is from a rival
        self.rivals = np.empty((0, 3))  # poses elsewhere
        self._frames: list[Frame] = []
        self._odom_from_body = np.eye(4)
        self._way_m, self._searched_m = 0.0, -np.inf

    def move(self, previous_from_body: np.ndarray, way_m: float) -> None:
        """The robot has moved."""
        self._odom_from_body = self._odom_from_body @ previous_from_body
        self._way_m += way_m
        x, y, yaw = self.rivals.T
        dx, dy, turn = planar(previous_from_body)
        c, s = np.cos(yaw), np.sin(yaw)
        self.rivals = np.column_stack([x + c * dx - s * dy, y + s * dx + c * dy, yaw + turn])

    def see(self, scan: Scan) -> None:
        """Put a scan into the window; the last one gives way unless the robot has moved on from the one before."""
        s = self.settings
        reach, bearing = np.asarray(scan.ranges_m, float), np.asarray(scan.bearings_rad, float)
        used = np.flatnonzero(np.isfinite(reach) & (reach <= s.range_max_m))
        if len(used) < s.least_beams:
            return
        used = used[np.linspace(0, len(used) - 1, min(s.beams, len(used))).astype(int)]
        ends = np.stack([np.cos(bearing[used]), np.sin(bearing[used])], axis=1) * reach[used, None]
        begin = np.broadcast_to(np.asarray(scan.origin_xy_m, float), ends.shape)
        if len(self._frames) > 1 and self._way_m - self._frames[-2].way_m < s.frame_m:
            self._frames.pop()
        self._frames.append(Frame(np.hstack([begin, begin + ends]), self._odom_from_body, self._way_m, self.chance))
        while self._way_m - self._frames[0].way_m > s.window_m:
            self._frames.pop(0)

    def beams(self) -> np.ndarray:
        """(B, 4) starts and ends of all beams of the window in the body frame of now, metres."""
        out = [np.empty((0, 4))]
        for frame in self._frames:
            now_from_then = inverse(self._odom_from_body) @ frame.odom_from_body
            turn, shift = now_from_then[:2, :2].T, now_from_then[:2, 3]
            out.append(np.hstack([frame.beams[:, :2] @ turn + shift, frame.beams[:, 2:] @ turn + shift]))
        return np.concatenate(out)

    def rivals_due(self) -> bool:
        """Whether the map is to be searched for rivals."""
        return bool(self._frames) and self._way_m - self._searched_m >= self.settings.rivals_m

    def compare(self, rivals: np.ndarray) -> None:
        """Take over the best rival poses (K, 3)."""
        self.rivals, self._searched_m = rivals, self._way_m

    def follow(self, expected: np.ndarray | None, believed: np.ndarray) -> None:
        """A belief (3,) that is not where the last one and the motion since lead to is another belief: what was known of the
        other does not count, the scans do, and the map is searched anew, with the place left among the rivals."""
        if expected is None:
            return
        off = planar(inverse(se2(*expected)) @ se2(*believed))
        if np.hypot(off[0], off[1]) > self.settings.jump_m or abs(off[2]) > np.radians(self.settings.jump_deg):
            self._searched_m, self.rivals = -np.inf, np.vstack([self.rivals, expected])
            for frame in self._frames:
                frame.chance = self.settings.prior

    def look(self, believed: np.ndarray) -> None:
        """Bayes' rule between the belief (3,) and `off`."""
        if not self._frames:
            return
        s, beams, first = self.settings, self.beams(), self._frames[0]
        self.share = float(self.explained(believed[None], beams)[0])
        self.rival = float(self.explained(self.rivals, beams).max()) if len(self.rivals) else 0.0
        seen_m = self._way_m - first.way_m
        stayed = np.exp(-seen_m / s.leaves_m)
        before = s.prior + (first.chance - s.prior) * stayed
        gain = (self.share - self.rival) / s.scale * min(1.0, (s.first_m + seen_m) / s.full_m)
        odds = np.log(before) - np.log1p(-before) + gain
        self.chance = float(np.clip(1.0 / (1.0 + np.exp(-odds)), 1.0 - s.most, s.most))

    def explained(self, states: np.ndarray, beams: np.ndarray, *, roughly: bool = False) -> np.ndarray:
        """(N,) share of the ends in mapped ground that lie on walls which their beams reach, from states (N, 3); beams
        (B, 4) in the body frame, metres. roughly: beams are looked at at two points only."""
        cell = self._grid.resolution_m
        cells = (np.asarray(states, float) - [*self._grid.origin_m, 0.0]) / [cell, cell, 1.0]
        tables = (self._hit, self._solid, self._mapped)
        slack = 0 if roughly else self.settings.slack_cells
        return _explained(np.ascontiguousarray(cells), beams / cell, tables, self.settings.mapped, slack)


@compiled
def _explained(states: np.ndarray, beams: np.ndarray, tables: tuple[np.ndarray, np.ndarray, np.ndarray], least: float,
               slack: int) -> np.ndarray:
    """See FitWatch.explained; lengths in cells. Where a share less than `least` of the beams ends in mapped ground or
    behind a wall, the others count as not explained. slack: cells before its end in which a beam may meet a wall, 0:
    see roughly."""
    hit, solid, mapped = tables
    rows, columns = hit.shape
    out = np.empty(len(states))
    for k in range(len(states)):
        c, s = np.cos(states[k, 2]), np.sin(states[k, 2])
        good, told = 0.0, 0
        for b in range(len(beams)):
            sx, sy = states[k, 0] + c * beams[b, 0] - s * beams[b, 1], states[k, 1] + s * beams[b, 0] + c * beams[b, 1]
            ex, ey = states[k, 0] + c * beams[b, 2] - s * beams[b, 3], states[k, 1] + s * beams[b, 2] + c * beams[b, 3]
            length = np.hypot(ex - sx, ey - sy)
            step, way, last = (1.0, 1.0, length - slack) if slack else (0.35 * length, 0.35 * length, 0.8 * length)
            free = True
            while free and way < last:
                x, y = sx + (ex - sx) * way / length, sy + (ey - sy) * way / length
                free = not (x >= 0 and y >= 0 and x < columns and y < rows and solid[int(y), int(x)])
                way += step
            if not free:
                told += 1
            elif ex >= 0 and ey >= 0 and ex < columns and ey < rows and mapped[int(ey), int(ex)]:
                told += 1
                good += hit[int(ey), int(ex)]
        out[k] = good / max(told if told >= least * len(beams) else len(beams), 1)
    return out
