"""Where a robot that draws its own map looks next: the frontier between what it knows to be free and what nobody has seen.

Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997, for what is left to see; Gonzalez-Banos and
Latombe, "Navigation strategies for exploring indoor environments", IJRR 2002, for how much of it a place shows: the
unknown area that rays reach before a known wall, through frontiers alone; Burgard et al., "Coordinated multi-robot
exploration", IEEE T-RO 2005, for weighing it against the way. Deviations: one camera sees a window of bearings, so a place
is a position and a heading; the weight is a ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.errors import Bounded, within
from rhs.api.geometry import wrap
from rhs.api.grid import OccupancyGrid, configuration_space
from rhs.worlds.clearance import ways_m

RAYS = 72  # every five degrees
EDGES_DEG = 7.0  # of what is seen at once: not well
ANGLES = 2.0 * np.pi * np.arange(RAYS) / RAYS
STRIDE_M = 0.3  # between the places that are weighed
AT_ONCE = 64  # places whose rays are cast together
AGAIN_M = 1.0  # nearer to where it was looked at in vain a frontier is not looked at again
MOST_LOOKS = 3  # in vain, after which nobody will see what is behind a frontier


@dataclass(frozen=True)
class ExploreSettings(Bounded):
    """How the robot explores (mission.survey=explore)."""

    views: int = within(6000, 1, 10_000_000)
    """after so many views the robot goes home, whatever is left"""
    coverage: float = within(1.0, 0.01, 1.0)
    """share of the cells within the world's bounds that is known when the robot goes home; 1: never, frontiers decide (the
    insides of blocks and walls are never known)"""
    sight_m: float = within(4.0, 0.5, 100.0)
    """unknown ground further than this from a place is no reason to go there, metres: half of what a depth camera sees, for
    walls not known yet"""
    least_m2: float = within(0.3, 0.0, 1e4)
    """less unknown ground than this is no reason to go anywhere, square metres: a robot of 0.3 m radius covers as much"""
    frontier_m: float = within(0.3, 0.0, 100.0)
    """a shorter frontier is a seam between views, metres"""
    view_deg: float | None = within(None, 5.0, 360.0)
    """what the robot sees well at once, degrees; unset: what its first scan spans, less 7 at its edges (a Kinect 57)"""
    here_m: float = within(1.0, 0.01, 100.0)
    """added to every way, metres: a place at hand is not worth infinitely much"""
    turn_m: float = within(0.3, 0.0, 100.0)
    """turning by a radian costs as much as so many metres"""
    places: bool = True
    """before it goes home the robot looks round at those places of the patrol that it has not been near: a localiser knows
    again what was looked at, not what was only mapped"""
    place_m: float = within(1.0, 0.0, 100.0)
    """that near, metres"""

    def seeing(self, bearings_rad: np.ndarray) -> ExploreSettings:
        """These settings, view_deg by the bearings (N,) of a scan where it is unset, in steps of the rays that are cast."""
        if self.view_deg is not None or not len(bearings_rad):
            return self
        step_deg = 360.0 / RAYS
        spans = (float(np.degrees(np.ptp(bearings_rad))) - EDGES_DEG) / step_deg
        return replace(self, view_deg=step_deg * min(RAYS, max(1, round(spans))))


@dataclass(frozen=True)
class Viewpoint:
    """A place worth going to. at_m (2,): metres in the map. facing_rad: heading. gain_m2: unknown ground seen from there."""

    at_m: np.ndarray
    facing_rad: float
    gain_m2: float


@dataclass(frozen=True, eq=False)
class Look:
    """A look in vain: where from (2,), and seen (H, W) bool: the frontiers that were in view. From elsewhere they may show
    what is behind them: past the post of a door the eye goes along the edge of what it sees."""

    at_m: np.ndarray
    seen: np.ndarray


class Frontiers:
    """What a map leaves to be seen by a robot that needs need_m round its middle, after looks in vain."""

    def __init__(self, grid: OccupancyGrid, need_m: float, looks: Sequence[Look], settings: ExploreSettings) -> None:
        from scipy.ndimage import binary_dilation, label

        self.grid, self.looks, self.settings = grid, looks, settings
        self.view_rad = np.radians(50.0 if settings.view_deg is None else settings.view_deg)  # before a scan
        free, self.unknown = grid.free(), ~(grid.free() | grid.occupied())  # what one beam passed is not known yet
        growth = need_m / grid.resolution_m
        self.open_ = ~configuration_space(~free, growth)
        # if the unknown turns out free, and the walls are a cell further apart than they were drawn from afar
        passable = ~configuration_space(~(free | self.unknown), max(0.0, growth - 1.0))
        self.wall = ~(free | self.unknown)
        tried = sum((look.seen for look in looks), np.zeros(grid.shape, int)) >= MOST_LOOKS
        edge = free & binary_dilation(self.unknown) & ~tried
        regions, _ = label(edge, structure=np.ones((3, 3)))
        sizes = np.bincount(regions.ravel())  # of a doorway the robot's middle may fit through a cell or two alone
        self.frontier = edge & passable & (sizes[regions] * grid.resolution_m >= settings.frontier_m)
        self.crossing = binary_dilation(self.frontier, structure=np.ones((3, 3)))

    def best(self, pose: np.ndarray) -> Viewpoint | None:
        """The viewpoint with the most unknown ground for its way from a pose (x, y, yaw); None where nothing is left."""
        ways_m = self.ways_m(pose[:2])
        cells = self._candidates(ways_m)
        if not len(cells):
            return None
        gains, facing = self.seen_m2(cells)
        at_m = self.grid.centres(cells)
        way_m = ways_m[cells[:, 0], cells[:, 1]]
        here = way_m < STRIDE_M
        ahead = np.where(here, facing, np.arctan2(*(at_m - pose[:2]).T[::-1]))
        cost = way_m + self.settings.here_m + self.settings.turn_m * np.abs(wrap(ahead - pose[2]))
        worth = np.where(gains >= self.settings.least_m2, gains / cost, 0.0)
        k = int(np.argmax(worth))
        return Viewpoint(at_m[k], float(facing[k]), float(gains[k])) if worth[k] > 0.0 else None

    def _candidates(self, ways_m: np.ndarray) -> np.ndarray:
        """(K, 2) cells the robot can get to that lie within sight of a frontier, on a lattice."""
        from scipy.ndimage import distance_transform_edt

        if not self.frontier.any():
            return np.zeros((0, 2), int)
        stride = max(1, round(STRIDE_M / self.grid.resolution_m))
        near = distance_transform_edt(~self.frontier) * self.grid.resolution_m <= self.settings.sight_m
        lattice = np.zeros(self.grid.shape, bool)
        lattice[::stride, ::stride] = True
        lattice |= ways_m == 0.0
        return np.argwhere(np.isfinite(ways_m) & near & lattice)

    def ways_m(self, at_m: np.ndarray) -> np.ndarray:
        """(H, W) length of the way to each cell where the robot may be, metres; inf where none leads."""
        cells = np.argwhere(self.open_)
        if not len(cells):
            return np.full(self.grid.shape, np.inf)
        start = cells[np.argmin(np.linalg.norm(self.grid.centres(cells) - at_m, axis=1))]
        return ways_m(self.open_, self.grid.resolution_m, start)

    def seen_m2(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((K,) unknown ground in the best view from each of (K, 2) cells, square metres; (K,) heading of that view)."""
        rays = np.concatenate([self._rays(some)[0] for some in np.array_split(cells, len(cells) // AT_ONCE + 1)])
        width = max(1, round(self.view_rad / (2.0 * np.pi) * RAYS))
        total = np.cumsum(np.concatenate([np.zeros((len(rays), 1)), rays, rays[:, :width]], axis=1), axis=1)
        window = total[:, width:width + RAYS] - total[:, :RAYS]
        first = np.argmax(window, axis=1)
        return window.max(axis=1), wrap((first + 0.5 * (width - 1)) * 2.0 * np.pi / RAYS)

    def looked_at(self, at_m: np.ndarray, facing_rad: float) -> np.ndarray:
        """(H, W) bool: the frontiers that are in view from a place with a heading."""
        seen = np.zeros(self.grid.shape, bool)
        _, entries = self._rays(self.grid.cells(at_m[None]))
        inside = np.abs(wrap(ANGLES - facing_rad)) <= 0.5 * self.view_rad + 2.0 * np.pi / RAYS
        for row, column in entries[0, inside]:
            if row >= 0:
                seen[max(0, row - 2):row + 3, max(0, column - 2):column + 3] = True
        return seen

    def _rays(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((K, RAYS) unknown ground along each ray that enters it through a frontier, square metres; (K, RAYS, 2) the cell
        where it does, -1 where it does not)."""
        resolution_m = self.grid.resolution_m
        reach = np.arange(1.0, self.settings.sight_m / resolution_m)
        rows = np.floor(cells[:, 0, None, None] + 0.5 + np.sin(ANGLES)[:, None] * reach).astype(int)
        columns = np.floor(cells[:, 1, None, None] + 0.5 + np.cos(ANGLES)[:, None] * reach).astype(int)
        height, width = self.grid.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        at = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
        clear = ~np.logical_or.accumulate(self.wall[at] | ~inside, axis=2)
        new = self.unknown[at] & clear
        first = np.argmax(new, axis=2)[..., None]
        entered = np.take_along_axis(new & self.crossing[at], first, axis=2)
        entry = np.stack([np.take_along_axis(index, first, axis=2)[..., 0] for index in at], axis=-1)
        for look in self.looks:
            near = np.linalg.norm(self.grid.centres(cells) - look.at_m, axis=1) < AGAIN_M
            entered[near] &= ~look.seen[tuple(np.moveaxis(entry[near], -1, 0))][..., None]
        area = (new * entered * reach).sum(axis=2) * resolution_m**2 * 2.0 * np.pi / RAYS
        return area, np.where(entered, entry, -1)
