"""Does the map explain what is seen from where the robot believes itself to be?

A particle filter compares poses in the map with one another: the best of them gets all the weight, also where the robot is
in a room that the map does not show, or where the map is out of date. So the belief is held against the alternative that it
is wrong: of the scan's ends in mapped ground, how many lie on a wall that the beam could reach? Beams that end where nothing
is mapped say nothing, unless they are many. How large a share a right pose has depends on the building, on what was moved
since, and on the scanner; how large a one a wrong pose can have is seen in the map itself: every metre of way the whole map
is searched for the best rival elsewhere. A robot off the map has one that fits as well as its belief or better. The
evidence of one scan is a log-odds in proportion to the share above or below the mean of FitSettings.expected and the share
from there, and views taken a short way apart count as one: they share their errors.
"""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import inverse, planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.jit import compiled
from rhs.api.records import Scan

from .advanced import FitSettings


class FitWatch:
    """The chance that the belief is where the robot is, by what the map explains of the scans since it is what it is."""

    def __init__(self, grid: OccupancyGrid, settings: FitSettings) -> None:
        from scipy.ndimage import distance_transform_edt

        self._s, self._grid = settings, grid
        occupied = grid.occupied()
        self._solid = occupied.astype(np.uint8)
        gap_m = distance_transform_edt(~occupied) * grid.resolution_m if occupied.any() else np.full(grid.shape, np.inf)
        self._wall = (gap_m <= settings.reach_m).astype(np.uint8)
        self._mapped = (occupied | grid.free() | (gap_m <= settings.reach_m)).astype(np.uint8)
        self.start()

    def start(self, chance: float | None = None) -> None:
        """A robot that begins, of whose belief only this is known."""
        self.rival = float("nan")  # largest share from a place that is not believed in, at the last search
        self._unrivalled_m = np.inf
        self.begin(chance)

    def begin(self, chance: float | None = None) -> None:
        """A new belief, of which only this is known."""
        prior = self._s.prior if chance is None else min(max(chance, self._s.prior), self._s.most)
        self._odds = self._log_odds(prior)
        self.share = float("nan")
        self._pulls: list[tuple[float, np.ndarray]] = []  # way, and how far the scans moved the belief off its motion

    @staticmethod
    def _log_odds(chance: float) -> float:
        return float(np.log(chance) - np.log1p(-chance))

    @property
    def chance(self) -> float:
        """That the map explains the belief."""
        return float(1.0 / (1.0 + np.exp(-self._odds)))

    def follow(self, expected: np.ndarray | None, believed: np.ndarray, way_m: float) -> None:
        """A belief (3,) that is not where the last one and the motion since, of way_m, lead to is another belief. One that
        was held back or pulled along bit by bit is trusted like a new one until it has followed its motion again."""
        if expected is None:
            return
        off = planar(inverse(se2(*expected)) @ se2(*believed))
        if np.hypot(off[0], off[1]) > self._s.jump_m or abs(off[2]) > np.radians(self._s.jump_deg):
            self.begin()
            return
        if not self._pulls or self._pulls[-1][0] > 0.05 * self._s.slip_over_m:
            self._pulls.append((0.0, np.zeros(2)))
        since_m, pull = self._pulls.pop()
        self._pulls.append((since_m + way_m, pull + believed[:2] - expected[:2]))
        while sum(way for way, _ in self._pulls) - self._pulls[0][0] >= self._s.slip_over_m:
            self._pulls.pop(0)
        if np.hypot(*np.sum([pull for _, pull in self._pulls], axis=0)) > self._s.slip_m:
            self._odds = min(self._odds, self._log_odds(self._s.prior))

    def rivals_due(self, way_m: float) -> bool:
        """Whether the map is to be searched for rivals, after so much more way."""
        self._unrivalled_m += way_m
        return self._s.rival_weight > 0 and self._unrivalled_m >= self._s.rivals_m

    def compare(self, scan: Scan | None, rivals: np.ndarray) -> None:
        """Take over what the map explains of a scan from the best of rival poses (K, 3)."""
        self._unrivalled_m = 0.0
        shares = np.array([self.explained(scan, rival) for rival in rivals])
        self.rival = float(np.nanmax(shares)) if np.isfinite(shares).any() else float("nan")

    def look(self, scan: Scan | None, believed: np.ndarray, fresh: float) -> None:
        """Take the evidence of a scan seen from a pose (3,). fresh: 0..1, how much of it is new."""
        s = self._s
        self.share = self.explained(scan, believed)
        if np.isfinite(self.share):
            expected = s.expected if np.isnan(self.rival) else s.expected + s.rival_weight * (self.rival - s.expected)
            evidence = float(np.clip(s.slope * (self.share - expected), -s.step, s.step))
            most = self._log_odds(s.most)
            self._odds = float(np.clip(self._odds + fresh * evidence, -most, most))

    def explained(self, scan: Scan | None, at: np.ndarray) -> float:
        """Share of the scan's ends in mapped ground that lie on walls which their beams reach, from a pose (3,); NaN with
        too few beams."""
        if scan is None:
            return float("nan")
        cell = self._grid.resolution_m
        reach, bearing = np.asarray(scan.ranges_m, float), np.asarray(scan.bearings_rad, float)
        used = np.isfinite(reach) & (reach <= self._s.range_max_m)
        if used.sum() < self._s.least_beams:
            return float("nan")
        start = se2(*at)[:2, :2] @ np.asarray(scan.origin_xy_m, float) + at[:2]
        begin = (start - np.asarray(self._grid.origin_m)) / cell
        good, told = _explained(begin, reach[used] / cell, bearing[used] + at[2], (self._solid, self._wall, self._mapped),
                                self._s.reach_m / cell)
        if told < self._s.mapped * used.sum():
            return good / int(used.sum())  # the robot believes itself where hardly anything is mapped
        return good / told if told >= self._s.least_beams else float("nan")


@compiled
def _explained(start: np.ndarray, reach: np.ndarray, heading: np.ndarray, cells: tuple[np.ndarray, np.ndarray, np.ndarray],
               slack: float) -> tuple[int, int]:
    """How many beams end by a wall and met none before (but within `slack` of their end), and how many end in mapped
    ground or behind a wall; lengths in cells. cells: walls, cells by a wall, mapped ones."""
    solid, wall, mapped = cells
    rows, columns = solid.shape
    good, told = 0, 0
    for b in range(len(reach)):
        c, s = np.cos(heading[b]), np.sin(heading[b])
        free, way = True, 1.0
        while free and way < reach[b] - slack - 1.0:
            px, py = start[0] + c * way, start[1] + s * way
            if px >= 0 and py >= 0 and px < columns and py < rows and solid[int(py), int(px)]:
                free = False
            way += 1.0
        x, y = start[0] + c * reach[b], start[1] + s * reach[b]
        if not free:
            told += 1
        elif x >= 0 and y >= 0 and x < columns and y < rows and mapped[int(y), int(x)]:
            told += 1
            good += wall[int(y), int(x)]
    return good, told
