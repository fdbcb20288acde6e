"""Mappers in three small rooms: walls found, walls made up, what a passer-by leaves, and whether the chances mean what they
say."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.geometry import planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Scan
from rhs.api.validate import check_grid
from rhs.metrics.calibration import calibration_error
from rhs.testing.mappers import FREE, NEAR_CELLS, OCCUPIED
from rhs.testing.room import CORRIDOR, FURNISHED, HALL, Room, context, scan_of

from .forked import ForkResult
from .laps import LAP, STRAIGHT, round_room, stretch

POSE_SIGMA = np.array([0.02, 0.02, np.radians(0.5)])  # of the poses of a good survey, metres and radians
BODY_M, STRIDE_M = 0.25, 0.12  # radius of who passes by, and the way in a view
DRIVES: dict[str, tuple[Room, tuple[tuple[float, float], ...], bool, bool]] = {  # steps, wrong poses, somebody passes by
    "room": (round_room(HALL), LAP, False, False), "furnished room": (round_room(FURNISHED), LAP, False, False),
    "corridor": (CORRIDOR, STRAIGHT, False, False), "poses 2 cm wrong": (round_room(FURNISHED), LAP, True, False),
    "somebody passes by": (round_room(HALL), LAP, False, True)}
COLUMNS = {
    "walls_share": "of the places where beams ended: a cell beside it is a wall (above 0.65)",
    "false_walls_share": "of the cells that are walls: further than a cell and a half from all of them",
    "free_share": "half way of the beams: the cell is free (below 0.25)",
    "ece": "expected calibration error of the chances of cells that a beam passed or ended in, ten bins (Guo et al. 2017)",
    "update_ms": "CPU time of a scan, median",
    "memory_mb": "memory taken beyond the process it began in",
}


@dataclass(frozen=True, eq=False)
class Shown:
    """One scan as it is handed over, its believed pose, and what is true of it: ends and middles of beams (N, 2), metres."""

    pose: np.ndarray
    scan: Scan
    ends_m: np.ndarray
    middles_m: np.ndarray


@dataclass(frozen=True, eq=False)
class Drawn:
    """What one drive came to: the columns but for memory, and the map."""

    room: str
    figures: dict[str, float]
    cpu_ms: np.ndarray
    grid: OccupancyGrid


def prepare() -> None:
    """Look at every room once, for all parts."""
    for title in DRIVES:
        shown(title)


def work(settings: Any, *, degraded: bool = True) -> Iterator[Drawn]:
    """Every drive. degraded: nothing more is asked."""
    with tempfile.TemporaryDirectory() as name:
        for title, (room, *_) in DRIVES.items():
            part = complete("mapper", settings.build(context(Path(name), 0, room)))
            cpu_ms = []
            for one in shown(title):
                began = process_time()
                part.update(one.pose, one.scan)
                cpu_ms.append(1e3 * (process_time() - began))
            grid = check_grid(part.grid(), who="grid()")
            yield Drawn(title, judged(grid, shown(title)), np.array(cpu_ms), grid)


@cache
def shown(title: str) -> tuple[Shown, ...]:
    """The scans of a drive, 5 mm of noise on each range."""
    room, steps, wrong, passer = DRIVES[title]
    rng, out = np.random.default_rng(3), []
    for k, seen in enumerate(stretch(room, steps, 1)):
        exact, scan = scan_of(seen.world_from_body, room), seen.observation.scan
        assert scan is not None
        if passer:
            at = np.array([-2.5 + STRIDE_M * k % 5.0, 1.2])
            scan = replace(scan, ranges_m=np.minimum(scan.ranges_m, to_disc(seen.world_from_body, scan.bearings_rad, at)))
        pose = seen.world_from_body @ se2(*(POSE_SIGMA * rng.standard_normal(3))) if wrong else seen.world_from_body
        ends, middles = (along(seen.world_from_body, exact, share) for share in (1.0, 0.5))
        out.append(freeze(Shown(pose, scan, ends, middles)))
    return tuple(out)


def along(pose: np.ndarray, scan: Scan, share: float) -> np.ndarray:
    """(N, 2) metres: points at a share of the way of beams of more than a metre that leave the body's middle."""
    x, y, yaw = planar(pose)
    far = scan.ranges_m > 1.0
    angles, reach = yaw + scan.bearings_rad[far], share * scan.ranges_m[far]
    return np.stack([x + reach * np.cos(angles), y + reach * np.sin(angles)], axis=1)


def to_disc(pose: np.ndarray, bearings: np.ndarray, at_m: np.ndarray) -> np.ndarray:
    """(N,) metres along each beam to somebody who stands at (2,); inf where it passes."""
    x, y, yaw = planar(pose)
    there = at_m - (x, y)
    ahead = np.cos(yaw + bearings) * there[0] + np.sin(yaw + bearings) * there[1]
    aside2 = there @ there - ahead**2
    hit = (ahead > 0.0) & (aside2 < BODY_M**2)
    return np.where(hit, ahead - np.sqrt(np.maximum(BODY_M**2 - aside2, 0.0)), np.inf)


def judged(grid: OccupancyGrid, views: Sequence[Shown]) -> dict[str, float]:
    """The map against where the beams truly ended and passed."""
    from scipy.spatial import cKDTree

    ends, middles = (np.concatenate([getattr(one, name) for one in views]) for name in ("ends_m", "middles_m"))
    with np.errstate(invalid="ignore"):
        walls = grid.centres(np.argwhere(grid.probability > OCCUPIED))
        free = grid.probability < FREE
    reach_m = NEAR_CELLS * grid.resolution_m
    found = cKDTree(walls).query(ends)[0] < reach_m if len(walls) else np.zeros(len(ends), bool)
    false = cKDTree(ends).query(walls)[0] > reach_m if len(walls) else np.zeros(0, bool)
    chances, true = [], []
    for points, wall in ((ends, True), (middles, False)):
        cells = grid.cells(points[grid.inside(points)])
        known = grid.probability[tuple(np.unique(cells, axis=0).T)]
        chances.append(known[np.isfinite(known)])
        true.append(np.full(len(chances[-1]), wall))
    inside = middles[grid.inside(middles)]
    return {"walls_share": float(found.mean()), "false_walls_share": float(false.mean()) if len(false) else 0.0,
            "free_share": float(free[tuple(grid.cells(inside).T)].sum()) / len(middles),
            "ece": calibration_error(np.concatenate(chances).astype(float), np.concatenate(true))}


def figures(result: ForkResult) -> dict[str, float]:
    """The columns, mean over the drives."""
    if not result.items:
        return {}
    mean = {name: float(np.mean([one.figures[name] for one in result.items])) for name in result.items[0].figures}
    cpu_ms = float(np.median(np.concatenate([one.cpu_ms for one in result.items])))
    return mean | {"update_ms": cpu_ms, "memory_mb": result.memory_mb}


def details(result: ForkResult) -> dict[str, Any]:
    """The drives one by one."""
    return {"rooms": {one.room: figures(ForkResult([one])) for one in result.items}}
