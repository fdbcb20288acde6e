"""What mappers must do (see rhs.testing)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.geometry import planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Scan
from rhs.api.validate import check_grid

from .room import FURNISHED, context, ranges
from .shared_state import untouched

BEARINGS = np.linspace(-1.2, 0.9, 211)  # looks further to the right than to the left
ORIGIN_M = (0.35, -0.2)  # the scanner sits ahead and to the right
HEIGHT_M = 0.3
# x m, y m, yaw rad: far from the origin of the map, headings all round
POSES = ((-2.5, -1.8, 0.6), (-1.0, 1.6, -2.4), (1.4, -0.6, 1.9), (-2.9, 2.0, -0.5))
OCCUPIED, FREE = 0.65, 0.25  # rhs.api.grid.OccupancyGrid
RIGHT_SHARE = 0.9
NEAR_CELLS = 1.5  # a wall may be drawn one cell off


def scan_at(pose: np.ndarray) -> Scan:
    """What a scanner that sits aside of the middle sees of the furnished room; beams beyond 4.5 m find nothing."""
    reach = ranges(FURNISHED, pose, BEARINGS, ORIGIN_M, HEIGHT_M)
    return freeze(Scan(BEARINGS.copy(), np.where(reach < 4.5, reach, np.inf), 4.5, ORIGIN_M))


def ends(pose: np.ndarray, scan: Scan, share: float = 1.0) -> np.ndarray:
    """(N, 2) metres in the map: the ends of the beams that hit, or places a share of the way to them."""
    x, y, yaw = planar(pose)
    hit = np.isfinite(scan.ranges_m)
    reach, bearing = share * scan.ranges_m[hit], scan.bearings_rad[hit]
    ahead, left = ORIGIN_M[0] + reach * np.cos(bearing), ORIGIN_M[1] + reach * np.sin(bearing)
    return np.stack([x + np.cos(yaw) * ahead - np.sin(yaw) * left, y + np.sin(yaw) * ahead + np.cos(yaw) * left], axis=1)


def _drawn(settings: Any, folder: Path, times: int = 6, poses: tuple[tuple[float, float, float], ...] = POSES) -> Any:
    mapper = complete("mapper", settings.build(context(folder, room=FURNISHED)))
    scans = [(freeze(se2(*pose)), scan_at(se2(*pose))) for pose in poses]
    with untouched(scans):
        for _ in range(times):
            for pose, scan in scans:
                mapper.update(pose, scan)
    return mapper


def _grid(mapper: Any) -> OccupancyGrid:
    return check_grid(mapper.grid(), who="grid()")


def _likeliest_near(grid: OccupancyGrid, points_m: np.ndarray) -> np.ndarray:
    """(N,) the greatest known chance within a cell of each point; NaN where nothing is known."""
    best = np.full(len(points_m), np.nan)
    for row in (-1, 0, 1):
        for column in (-1, 0, 1):
            cells = grid.cells(points_m) + (row, column)
            inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
            there = grid.probability[tuple(np.clip(cells, 0, np.array(grid.shape) - 1).T)]
            best = np.fmax(best, np.where(inside, there, np.nan))
    return best


def covers_the_world(settings: Any, folder: Path) -> None:
    x0, y0, x1, y1 = FURNISHED.facts.bounds_m
    hair = 1e-6  # the border itself may be the grid's
    corners = np.array([[x, y] for x in (x0 + hair, x1 - hair) for y in (y0 + hair, y1 - hair)])
    grid = _grid(complete("mapper", settings.build(context(folder, room=FURNISHED))))
    assert grid.inside(corners).all(), (
        f"grid at {grid.origin_m} of shape {grid.shape} does not hold the world's corners; expected all of "
        "context.world.bounds_m, origin_m its corner of least x and y, rows along y")


def walls_stand_where_beams_end(settings: Any, folder: Path) -> None:
    grid = _grid(_drawn(settings, folder))
    for pose in POSES:
        seen = _likeliest_near(grid, ends(se2(*pose), scan_at(se2(*pose))))
        with np.errstate(invalid="ignore"):
            share = float(np.mean(seen > OCCUPIED))
        assert share > RIGHT_SHARE, (f"of what was seen from {pose}, {share:.0%} is a wall in the map (a cell above "
                                     f"{OCCUPIED} next to the end of the beam), expected {RIGHT_SHARE:.0%}")


def the_way_of_a_beam_is_free(settings: Any, folder: Path) -> None:
    """Half way, where no wall is within two cells."""
    grid = _grid(_drawn(settings, folder))
    for pose in POSES:
        scan = scan_at(se2(*pose))
        half = ends(se2(*pose), scan, 0.5)[scan.ranges_m[np.isfinite(scan.ranges_m)] > 1.0]
        cells = grid.cells(half)
        with np.errstate(invalid="ignore"):
            share = float(np.mean(grid.probability[tuple(cells.T)] < FREE)) if grid.inside(half).all() else 0.0
        assert share > RIGHT_SHARE, (f"half way of the beams from {pose}, {share:.0%} of the cells are free (below {FREE}), "
                                     f"expected {RIGHT_SHARE:.0%}")


def there_are_no_other_walls(settings: Any, folder: Path) -> None:
    grid = _grid(_drawn(settings, folder))
    with np.errstate(invalid="ignore"):
        walls = grid.centres(np.argwhere(grid.probability > OCCUPIED))
    true = np.concatenate([ends(se2(*pose), scan_at(se2(*pose))) for pose in POSES])
    far = [np.linalg.norm(true - wall, axis=1).min() > NEAR_CELLS * grid.resolution_m + 0.05 for wall in walls]
    assert np.mean(far) < 1.0 - RIGHT_SHARE, (f"{np.mean(far):.0%} of {len(walls)} walls stand where no beam ended, "
                                              "for example where a beam found nothing up to its range")


def unknown_ranges_change_nothing(settings: Any, folder: Path) -> None:
    mapper, pose = _drawn(settings, folder, 1), se2(*POSES[0])
    before = np.array(_grid(mapper).probability)
    mapper.update(pose, Scan(BEARINGS.copy(), np.full(len(BEARINGS), np.nan), 4.5, ORIGIN_M))
    assert np.array_equal(before, _grid(mapper).probability, equal_nan=True), "a scan of NaN changed the map"


def what_was_never_seen_is_unknown_or_undecided(settings: Any, folder: Path) -> None:
    """In the middle of a box, a quarter of a metre behind its sides."""
    grid = _grid(_drawn(settings, folder))
    for low, high in FURNISHED.boxes[:2]:
        middle = np.array([[0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])]])
        value = float(grid.probability[tuple(grid.cells(middle)[0])])
        assert not (value > OCCUPIED or value < FREE), f"a cell no beam reached is {value:.2f}; expected NaN or undecided"


def reset_forgets_everything(settings: Any, folder: Path) -> None:
    mapper, fresh = _drawn(settings, folder, 1), complete("mapper", settings.build(context(folder, room=FURNISHED)))
    mapper.reset()
    assert np.array_equal(_grid(mapper).probability, _grid(fresh).probability, equal_nan=True), "reset() left something"


def same_scans_same_map_whoever_else_is_built(settings: Any, folder: Path) -> None:
    mapper = _drawn(settings, folder, 1)
    before = np.array(_grid(mapper).probability)
    _drawn(settings, folder, 1, POSES[:1])
    assert np.array_equal(before, _grid(mapper).probability, equal_nan=True), "what another one draws shows in its map"
    again = _grid(_drawn(settings, folder, 1)).probability
    assert np.array_equal(before, again, equal_nan=True), "two builds draw two maps of the same scans"


def keeps_no_hold_of_what_it_was_given(settings: Any, folder: Path) -> None:
    mapper, pose = complete("mapper", settings.build(context(folder, room=FURNISHED))), se2(*POSES[0])
    scan = scan_at(pose)
    mine = Scan(np.array(scan.bearings_rad), np.array(scan.ranges_m), scan.max_range_m, scan.origin_xy_m)
    mapper.update(pose, mine)
    before = np.array(_grid(mapper).probability)
    mine.ranges_m[:] = 0.5
    pose[:] = np.eye(4)
    assert np.array_equal(before, _grid(mapper).probability, equal_nan=True), "the map moved with its arguments"


MAPPER = (covers_the_world, walls_stand_where_beams_end, the_way_of_a_beam_is_free, there_are_no_other_walls,
          unknown_ranges_change_nothing, what_was_never_seen_is_unknown_or_undecided, reset_forgets_everything,
          same_scans_same_map_whoever_else_is_built, keeps_no_hold_of_what_it_was_given)
