"""Does the map explain what is seen from where the robot believes itself to be?

A particle filter compares poses in the map with one another: the best of them gets all the weight, also where the robot is
in a room that the map does not show, or where the map is out of date. So the chance of the belief is stated by a logistic
regression (Platt 1999; Niculescu-Mizil and Caruana 2005) on five statistics: the odds that the particles give it; how much
more of the scans' ends lie on walls from it than from the best rival place on the map, for which the whole map is searched
every metre of way (a robot off the map has a rival that fits as well as its belief or better); the share of the ends that
lie where the map shows nothing; how far the map explains less than right views have explained; and whether the start was
known. Shares are means over the last metres: scans taken a short way apart share their errors, and so do those of one
passage, so that evidence does not add up with the number of scans. The weights were fitted on made logs, in maps of the
whole and of the half of them (README.md).
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
        self._wall = (gap_m <= settings.wall_m).astype(np.uint8)
        self._mapped = (occupied | grid.free() | (gap_m <= settings.reach_m)).astype(np.uint8)
        self.start()

    def start(self, chance: float = 0.0) -> None:
        """A robot that begins; chance: that the belief it was given is right."""
        self.rival = self._s.unrivalled  # largest share from a place that is not believed in, at the last search
        self._unrivalled_m = np.inf
        self.begin(chance)

    def begin(self, chance: float = 0.0) -> None:
        """A new belief, of which only this is known."""
        self._given = chance
        self._sums = np.zeros(4)  # new scans, margins over the rival, unmapped shares, shortfalls; older ones fade
        self.share = float("nan")

    @property
    def evidence(self) -> float:
        """Log-odds that the belief is right, were it as likely as not by the particles."""
        s = self._s
        margin, unmapped, short = self._sums[1:] / (self._sums[0] + s.least_scans)
        told = s.margin * margin - s.unmapped * unmapped - s.unexplained * max(short, 0.0)
        return float(s.bias + told + s.given * self._given)

    def chance(self, by_particles: float = 0.5) -> float:
        """That the belief is right, which the particles give this chance."""
        odds = np.clip(by_particles, 1.0 - self._s.most, self._s.most)
        return float(1.0 / (1.0 + np.exp(-self.evidence - self._s.particles * np.log(odds / (1.0 - odds)))))

    def follow(self, expected: np.ndarray | None, believed: np.ndarray) -> None:
        """A belief (3,) that is not where the last one and the motion since lead to is another belief."""
        if expected is None:
            return
        off = planar(inverse(se2(*expected)) @ se2(*believed))
        if np.hypot(off[0], off[1]) > self._s.jump_m or abs(off[2]) > np.radians(self._s.jump_deg):
            self.begin()

    def rivals_due(self, way_m: float) -> bool:
        """Whether the map is to be searched for rivals, after so much more way."""
        self._unrivalled_m += way_m
        return self._unrivalled_m >= self._s.rivals_m

    def compare(self, scan: Scan | None, rivals: np.ndarray) -> None:
        """Take over what the map explains of a scan from the best of rival poses (K, 3)."""
        self._unrivalled_m = 0.0
        shares = np.array([self.explained(scan, rival)[0] for rival in rivals])
        self.rival = float(np.nanmax(shares)) if np.isfinite(shares).any() else self._s.unrivalled

    def look(self, scan: Scan | None, believed: np.ndarray, fresh: float, way_m: float) -> None:
        """Take the evidence of a scan seen from a pose (3,), so much way after the last. fresh: 0..1, how much of it is
        new."""
        self.share, unmapped = self.explained(scan, believed)
        fading = np.exp(-way_m / self._s.over_m)
        self._given *= fading
        self._sums *= fading
        if np.isfinite(self.share):
            self._sums += fresh * np.array([1.0, self.share - self.rival, unmapped, self._s.expected - self.share])

    def explained(self, scan: Scan | None, at: np.ndarray) -> tuple[float, float]:
        """Share of the scan's ends in mapped ground that lie on walls which their beams reach, from a pose (3,), and share
        of all its ends that lie where nothing is mapped; NaN with too few beams."""
        if scan is None:
            return float("nan"), float("nan")
        cell = self._grid.resolution_m
        reach, bearing = np.asarray(scan.ranges_m, float), np.asarray(scan.bearings_rad, float)
        used = np.isfinite(reach) & (reach <= self._s.range_max_m)
        if used.sum() < self._s.least_beams:
            return float("nan"), float("nan")
        start = se2(*at)[:2, :2] @ np.asarray(scan.origin_xy_m, float) + at[:2]
        begin = (start - np.asarray(self._grid.origin_m)) / cell
        good, told = _explained(begin, reach[used] / cell, bearing[used] + at[2], (self._solid, self._wall, self._mapped),
                                self._s.reach_m / cell)
        return good / max(told, 1), 1.0 - told / int(used.sum())


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
