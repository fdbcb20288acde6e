"""Mappers that count hits and passes, right and wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.geometry import planar
from rhs.api.grid import OccupancyGrid, frame_of

from . import settings

STEP_M = 0.04


class Honest:
    """Log odds of cells: up where a beam ends, down on its way."""

    resolution_m = 0.1

    def __init__(self, context):
        self.bounds = context.world.bounds_m
        self.reset()

    def reset(self):
        self.shape, self.origin = frame_of(self.bounds, self.resolution_m)
        self.odds = np.full(self.shape, np.nan)

    def grid(self):
        return OccupancyGrid((1.0 / (1.0 + np.exp(-self.odds))).astype(np.float32), self.resolution_m, self.origin)

    def update(self, map_from_body, scan):
        x, y, yaw = self.pose(map_from_body)
        ox, oy = self.from_body(scan)
        eye = np.array([x + np.cos(yaw) * ox - np.sin(yaw) * oy, y + np.sin(yaw) * ox + np.cos(yaw) * oy])
        passed, ended = np.zeros(self.shape, bool), np.zeros(self.shape, bool)
        for bearing, reach in zip(scan.bearings_rad, scan.ranges_m, strict=True):
            if np.isnan(reach):
                continue
            way = np.array([np.cos(yaw + bearing), np.sin(yaw + bearing)])
            self.mark(passed, eye + np.arange(0.0, self.free_to(min(reach, scan.max_range_m)), STEP_M)[:, None] * way)
            if self.ends(reach):
                self.mark(ended, (eye + min(reach, scan.max_range_m) * way)[None])
        self.count(passed & ~ended, ended)

    def pose(self, map_from_body):
        return planar(map_from_body)

    def from_body(self, scan):
        return scan.origin_xy_m

    def free_to(self, reach):
        return max(reach - 0.1, 0.0)

    def ends(self, reach):
        return np.isfinite(reach)

    def mark(self, cells, points):
        column, row = np.floor((points - self.origin) / self.resolution_m + 1e-9).astype(int).T
        inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        cells[row[inside], column[inside]] = True

    def count(self, passed, ended):
        known = passed | ended
        self.odds[known] = np.nan_to_num(self.odds[known])
        self.odds[passed] -= 0.8
        self.odds[ended] += 2.0
        np.clip(self.odds, -5.0, 5.0, out=self.odds)


class Finer(Honest):
    """Cells of five centimetres."""
    resolution_m = 0.05


class UnknownBeforeWalls(Honest):
    """Leaves the cells before a wall unknown: a beam is not that exact."""

    def free_to(self, reach):
        return max(reach - 0.35, 0.0)


class MirroredY(Honest):
    """Bearings to the other side."""
    says = "is a wall in the map"

    def update(self, map_from_body, scan):
        super().update(map_from_body, replace(scan, bearings_rad=-scan.bearings_rad,
                                              origin_xy_m=(scan.origin_xy_m[0], -scan.origin_xy_m[1])))


class Upside(Honest):
    """Row 0 is the greatest y, as in a picture."""
    says = "is a wall in the map"

    def grid(self):
        grid = super().grid()
        return replace(grid, probability=grid.probability[::-1].copy())


class IgnoresHeading(Honest):
    """Always looks along x."""
    says = "is a wall in the map"

    def pose(self, map_from_body):
        return [*planar(map_from_body)[:2], 0.0]


class IgnoresOrigin(Honest):
    """Beams leave the middle of the body."""
    says = "is a wall in the map"

    def from_body(self, scan):
        return 0.0, 0.0


class OriginInTheMap(Honest):
    """The scanner's place is not turned with the body."""
    says = "is a wall in the map"

    def update(self, map_from_body, scan):
        moved = np.array(map_from_body)
        moved[:2, 3] += scan.origin_xy_m
        super().update(moved, replace(scan, origin_xy_m=(0.0, 0.0)))


class IgnoresPlace(Honest):
    """Always stands at the origin."""
    says = "is a wall in the map"

    def pose(self, map_from_body):
        return [0.0, 0.0, planar(map_from_body)[2]]


class BodyFromMap(Honest):
    """Takes the pose the wrong way round."""
    says = "is a wall in the map"

    def pose(self, map_from_body):
        return planar(np.linalg.inv(map_from_body))


class Transposed(Honest):
    """x in rows, y in columns."""
    says = "does not hold the world's corners"

    def grid(self):
        grid = super().grid()
        return replace(grid, probability=grid.probability.T.copy())


class CornerForCentre(Honest):
    """Says its grid lies at the world's middle."""
    says = "does not hold the world's corners"

    def grid(self):
        return replace(super().grid(), origin_m=(0.0, 0.0))


class TwoCellsOff(Honest):
    """The origin is two cells off."""
    says = "is a wall in the map"

    def grid(self):
        grid = super().grid()
        return replace(grid, origin_m=(grid.origin_m[0] + 0.2, grid.origin_m[1] - 0.2))


class Inverse(Honest):
    """1 is free."""
    says = "of the cells are free"

    def grid(self):
        grid = super().grid()
        return replace(grid, probability=1.0 - grid.probability)


class OnlyWalls(Honest):
    """Never calls anything free."""
    says = "of the cells are free"

    def count(self, passed, ended):
        super().count(np.zeros_like(passed), ended)


class ThroughWalls(Honest):
    """Free half a metre behind every wall."""
    says = "a cell no beam reached"

    def free_to(self, reach):
        return reach + 0.5


class InfinityIsAWall(Honest):
    """A beam that found nothing ends at a wall."""
    says = "of the cells are free"

    def ends(self, reach):
        return True


class NanIsAWall(Honest):
    """An unknown range is one of half a metre."""
    says = "a scan of NaN changed the map"

    def update(self, map_from_body, scan):
        super().update(map_from_body, replace(scan, ranges_m=np.nan_to_num(scan.ranges_m, nan=0.5, posinf=np.inf)))


class NothingIsUnknown(Honest):
    """What nobody saw is free."""
    says = "a cell no beam reached"

    def grid(self):
        grid = super().grid()
        return replace(grid, probability=np.nan_to_num(grid.probability, nan=0.0))


class LastScanOnly(Honest):
    """Forgets everything but the last scan."""
    says = "is a wall in the map"

    def update(self, map_from_body, scan):
        self.reset()
        super().update(map_from_body, scan)


class NeverResets(Honest):
    """reset() does nothing."""
    says = "reset() left something"
    odds = None

    def reset(self):
        if self.odds is None:
            super().reset()


class Communal(Honest):
    """All mappers draw on one map."""
    says = "shows in its map"
    one = {}

    def reset(self):
        super().reset()
        self.odds = Communal.one.setdefault(self.shape, self.odds)

    def __init__(self, context):
        super().__init__(context)


class HoldsOn(Honest):
    """Keeps the scans it was given and draws when asked."""
    says = "moved with its arguments"

    def reset(self):
        super().reset()
        self.kept = []

    def update(self, map_from_body, scan):
        self.kept.append((map_from_body, scan))

    def grid(self):
        Honest.reset(self)
        for pose, scan in self.kept:
            super().update(pose, scan)
        return super().grid()


class LogOdds(Honest):
    """Hands out log odds."""
    says = "chances in [0, 1]"

    def grid(self):
        return replace(super().grid(), probability=self.odds.astype(np.float32))


class Percent(Honest):
    """As map_server has it: 0 to 100."""
    says = "chances in [0, 1]"

    def grid(self):
        grid = super().grid()
        return replace(grid, probability=100.0 * grid.probability)


class NoResolution(Honest):
    """A resolution of 0."""
    says = "resolution_m"

    def grid(self):
        return replace(super().grid(), resolution_m=0.0)


class Array(Honest):
    """Returns the array alone."""
    says = "expected an OccupancyGrid"

    def grid(self):
        return super().grid().probability


class Dream(Honest):
    """A little noise of its own."""
    says = "a scan of NaN changed the map"

    def count(self, passed, ended):
        super().count(passed, ended)
        self.odds += 1e-3 * np.random.default_rng().standard_normal(self.shape)


class Shared(Honest):
    """Noise from numpy's global generator."""
    says = "numpy's global generator"

    def count(self, passed, ended):
        super().count(passed, ended)
        np.random.shuffle(np.arange(3))  # noqa: NPY002


class Vandal(Honest):
    """Cuts the ranges it was given."""
    says = "it wrote to an array it was given"

    def update(self, map_from_body, scan):
        scan.ranges_m.setflags(write=True)
        scan.ranges_m[scan.ranges_m > 4.0] = np.nan
        super().update(map_from_body, scan)


RIGHT = (Finer, UnknownBeforeWalls)
HONEST = {part.__name__: settings(part, "scan") for part in (Honest, *RIGHT)}
PLANTED = {part.__name__: (settings(part, "scan"), part.says) for part in Honest.__subclasses__() if part not in RIGHT}
