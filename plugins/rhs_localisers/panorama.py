"""All round, nobody in the way: was the robot carried off, or did somebody only pass by?

Somebody who fills the view breaks it off from the last one as a robot carried off would, and where no place was recognised
before, none is afterwards either. A robot that doubts itself turns on the spot, and what it then sees all round is held
against the map. People walk on, and those who stand hide a wall, so of each bearing the farthest that was seen counts. A
robot carried off stands anywhere: what is seen is as likely as from all places and headings in the mean. One that was not
sees it from where it would be. Bayes' rule does the rest; in a building that looks alike all over it changes little, and
a recognised place has to say it.

The chance of a beam by what it meets is the beam model of Thrun, Burgard, Fox, Probabilistic Robotics, 6.3, with four cases
in the place of its densities.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.geometry import inverse, planar, transform, wrap
from rhs.api.grid import OccupancyGrid
from rhs.api.jit import compiled, inner
from rhs.api.records import Scan
from rhs.estimation.filters.pose_hypotheses import Hypothesis
from rhs.estimation.scans.scan_match import ScanMatcher

from .advanced import PanoramaSettings
from .scan_guess import laid_on_map

FREE, WALL, UNKNOWN = 0, 1, 2  # cells of a map
SPARSE = 3  # of so many beams one is looked at
MOST_VIEWS = 100  # of a panorama: three times round
STEP = 0.7  # cells between two looks along a beam


class Panorama:
    """What was seen all round from about here, moved along with the robot."""

    def __init__(self, settings: PanoramaSettings) -> None:
        self._s = settings
        self.begin()

    def begin(self) -> None:
        """Nothing was seen yet."""
        self._views: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []  # body_from_view, bearings looked at, ends (B, 2)

    def add(self, scan: Scan | None, previous_from_body: np.ndarray) -> None:
        """The robot moved (4x4) and took a scan; what was seen from further away than near_m is dropped."""
        back = inverse(previous_from_body)
        moved = [(back @ pose, bearings, ends) for pose, bearings, ends in self._views]
        self._views = [view for view in moved if np.hypot(*view[0][:2, 3]) <= self._s.near_m][-MOST_VIEWS:]
        if scan is not None:
            known = np.isfinite(scan.ranges_m)
            reach, bearing = scan.ranges_m[known], scan.bearings_rad[known]
            ends = np.stack([reach * np.cos(bearing), reach * np.sin(bearing)], axis=1) + scan.origin_xy_m
            self._views.append((np.eye(4), np.asarray(scan.bearings_rad, float), ends))

    @property
    def share(self) -> float:
        """Share of the bearings that were looked at."""
        looked = np.zeros(self._s.bearings, bool)
        for pose, bearings, _ in self._views:
            looked[self._bins(bearings + planar(pose)[2])] = True
        return float(looked.mean())

    def scan(self) -> Scan:
        """The farthest end on each bearing; NaN where there is none."""
        points = [transform(pose, np.column_stack([ends, np.zeros(len(ends))]))[:, :2] for pose, _, ends in self._views]
        ends = np.concatenate(points) if points else np.zeros((0, 2))
        ranges_m = np.full(self._s.bearings, -np.inf)
        np.maximum.at(ranges_m, self._bins(np.arctan2(ends[:, 1], ends[:, 0])), np.hypot(*ends.T))
        middles = (np.arange(self._s.bearings) + 0.5) * 2.0 * np.pi / self._s.bearings - np.pi
        return Scan(middles, np.where(ranges_m > 0.0, ranges_m, np.nan), np.inf)

    def _bins(self, bearings_rad: np.ndarray) -> np.ndarray:
        turns = (np.asarray(wrap(bearings_rad)) + np.pi) / (2.0 * np.pi)
        return np.clip((turns * self._s.bearings).astype(int), 0, self._s.bearings - 1)


class LookRound:
    """What the walls say to a robot that doubts where it is."""

    def __init__(self, grid: OccupancyGrid, walls: ScanMatcher, settings: PanoramaSettings) -> None:
        self._s, self._grid, self._walls = settings, grid, walls
        self._map: Whereabouts | None = None  # made when it is needed
        self._panorama = Panorama(settings)
        self.begin()

    def begin(self) -> None:
        """There is no doubt."""
        self._panorama.begin()
        self.again()

    def again(self) -> None:
        """There is a new doubt: what the map said before does not answer it."""
        self._asked, self._told = 0.0, 0.0  # share of the bearings looked at when the map was asked last, and what it said

    def add(self, scan: Scan | None, previous_from_body: np.ndarray) -> bool:
        """A motion (4x4) and a scan of a robot in doubt; whether enough more was seen round about to ask the map."""
        self._panorama.add(scan, previous_from_body)
        share = self._panorama.share
        if share < self._asked - self._s.more:  # the robot went on: what was seen there is seen anew
            self._asked, self._told = share, 0.0
        return share >= self._asked + self._s.more

    def odds(self, guesses: Sequence[Hypothesis]) -> tuple[list[Hypothesis], np.ndarray]:
        """The guesses laid on the map, and how much likelier what was seen makes each of them than anywhere else, beside
        what was said before: logarithms."""
        self._map = self._map or Whereabouts(self._grid, self._s)
        seen = self._panorama.scan()
        laid = [laid_on_map(guess, seen, self._walls) for guess in guesses]
        odds = self._map.odds(seen, np.array([planar(guess.map_from_body) for guess in laid]))
        told, self._told, self._asked = self._told, float(odds.max()), self._panorama.share
        return laid, odds - told


class Whereabouts:
    """The whole map, where a robot that was carried off may be."""

    def __init__(self, grid: OccupancyGrid, settings: PanoramaSettings) -> None:
        self._s, self._grid = settings, grid
        self._cells = np.where(grid.occupied(), WALL, np.where(grid.free(), FREE, UNKNOWN)).astype(np.uint8)
        self._lattice = self._spread()

    def _spread(self) -> np.ndarray:
        """(N, 3) states all over the free room, as close as `most` allows."""
        s, free = self._s, np.argwhere(self._cells == FREE)
        turns = np.arange(0.0, 2.0 * np.pi, np.radians(s.turn_deg))
        step = max(1, round(s.step_m / self._grid.resolution_m))
        while True:
            spots = self._grid.centres(free[(free % step == 0).all(axis=1)])
            if len(spots) * len(turns) <= s.most:
                return np.column_stack([np.repeat(spots, len(turns), axis=0), np.tile(turns, len(spots))])
            step += 1

    def odds(self, scan: Scan, believed: np.ndarray) -> np.ndarray:
        """(N,) how much likelier a scan is from poses (N, 3) than from anywhere in the map, all places and headings being
        alike: logarithms."""
        if not len(self._lattice):
            return np.zeros(len(believed))  # a map without free room
        anywhere = self.heights(scan, self._lattice)
        return self.heights(scan, believed) - np.logaddexp.reduce(anywhere) + np.log(len(anywhere))

    def heights(self, scan: Scan, states: np.ndarray) -> np.ndarray:
        """(N,) log-likelihood of a scan at states (N, 3)."""
        s, cell = self._s, self._grid.resolution_m
        known = np.flatnonzero(np.isfinite(scan.ranges_m) & (scan.ranges_m <= s.range_max_m))[::SPARSE]
        where = np.column_stack([(states[:, :2] - self._grid.origin_m) / cell, states[:, 2]])
        chances = SPARSE * s.trust * np.log([s.hit, s.short, s.through, s.unknown])
        return _heights(where, scan.ranges_m[known] / cell, scan.bearings_rad[known], self._cells, chances,
                        s.slack_m / cell, s.slack_per_m)


@inner
def _cell(cells: np.ndarray, x: float, y: float) -> int:
    """What is at a place, in cells."""
    rows, columns = cells.shape
    return UNKNOWN if x < 0 or y < 0 or x >= columns or y >= rows else cells[int(y), int(x)]


@compiled
def _heights(states: np.ndarray, reach: np.ndarray, bearing: np.ndarray, cells: np.ndarray, chances: np.ndarray,
             slack: float, slack_per: float) -> np.ndarray:
    """Log-likelihood of the beams at each state (N, 3), all lengths in cells: a beam ends at the first wall, before it,
    behind it, or where nothing is known."""
    hit, short, through, unknown = chances
    out = np.zeros(len(states))
    for k in range(len(states)):
        if _cell(cells, states[k, 0], states[k, 1]) != FREE:
            out[k] = len(reach) * through  # no robot stands there
            continue
        for b in range(len(reach)):
            c, s = np.cos(states[k, 2] + bearing[b]), np.sin(states[k, 2] + bearing[b])
            off = slack + slack_per * reach[b]
            chance, way = short, 0.0
            while way < reach[b] + off:
                cell = _cell(cells, states[k, 0] + c * way, states[k, 1] + s * way)
                if cell == WALL:
                    chance = through if way < reach[b] - off else hit
                    break
                if cell == UNKNOWN:
                    chance = unknown
                    break
                way += STEP
            out[k] += chance
    return out
