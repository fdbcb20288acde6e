"""What a survey leaves behind: views, the corrected trajectory, the finished map and where the robot has stood."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import LoopCloser, Mapper, Odometry
from rhs.api.frozen import freeze
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Closure, Features, FeatureSettings, Observation, Revision, Scan, Step, View, Wall
from rhs.api.spare import later
from rhs.api.validate import FAR_M, check_closure, check_grid, check_revision
from rhs.estimation.kept_views import ChangedViews, KeptViews
from rhs.estimation.scans.settings import VoteSettings
from rhs.estimation.scans.wall_rays import lift_on_scan, lift_on_walls
from rhs.estimation.views.packed import held_bytes, packed
from rhs.estimation.views.thinning import thinned

FURNITURE_VOTES = 2.0  # views, less those that saw through, that make a thing of the map: one alone may be a speck
FURNITURE = 0.95  # chance that a cell with so many is occupied
HIDDEN = 0.5  # the same of one behind such a thing that no view showed
HIDES_M = 1.0  # a thing is no deeper than this
BLUR_M, LEVER_M = 0.1, 3.0  # a cell of the map; of a beam as long as most: by how much its end is off is told in such cells
LEAST_PLACES = 20  # views that stay stored whatever they take
MOST_PLACES = 500  # views stored at most where memory is bounded: closing the loop compares each with each, in 30 MB


@dataclass(frozen=True)
class Survey:
    """views: one per step. closure: corrected poses and loops. grid: drawn from the corrected poses."""

    views: Sequence[View]
    closure: Closure
    grid: OccupancyGrid


class ViewCollector:
    """Turns steps into views, keeping the features of every `every`-th one, of the first and of the last.

    most_mb: of features, megabytes; beyond it, or beyond MOST_PLACES, those are given up, a tenth at a time, whose place
    another view shows as well, so that closing the loop of a way without end in one building takes bounded memory.
    folder: where the file lies that the views are kept in."""

    def __init__(self, every: int, settings: FeatureSettings,
                 features: Callable[[Observation, FeatureSettings], Features], most_mb: float = np.inf, *,
                 folder: Path | None = None) -> None:
        self.every, self.settings, self.features, self.most_mb = every, settings, features, most_mb
        self._most = MOST_PLACES if np.isfinite(most_mb) else np.inf
        self._places: dict[int, int] = {}  # row in views -> bytes of its features
        self._held = 0  # bytes, of all of them
        self.views = KeptViews(folder)
        self.last: Observation | None = None
        self.own_stamps_s: list[float] = []  # of a recording whose stamps were repaired: those it came with
        self.wheels: list[np.ndarray | None] = []  # (3,) travel since the view before, of each view

    def watch(self, steps: Iterable[Step]) -> Iterator[Step]:
        settled = None  # the features of the view before, once they are known
        for step in steps:
            if settled is not None:
                self._store(settled())
            stored = len(self.views) % self.every == 0 and step.observation.image is not None
            belief = step.belief
            self.views.append(View(step.index, step.stamp_s, step.observation.camera, step.motion,
                                   belief.map_from_body, belief.covariance, step.scan, None,
                                   step.observation.obstacle))
            settled = self._found(step.observation) if stored else None
            self.last = step.observation
            self.wheels.append(step.observation.wheel)
            if "log_stamp_s" in step.observation.extras:
                self.own_stamps_s.append(float(step.observation.extras["log_stamp_s"][0]))
            yield step
        if settled is None and len(self.views) and self.last is not None and self.last.image is not None:
            settled = self._found(self.last)
        if settled is not None:
            self._store(settled())

    def _store(self, features: Features) -> None:
        row = len(self.views) - 1
        self.views.keep_features(row, features)
        self._places[row] = size = held_bytes(features)
        self._held += size
        if len(self._places) > (LEAST_PLACES if self._held > 1e6 * self.most_mb else self._most):
            rows = np.array(list(self._places))
            poses = np.stack([self.views[row].map_from_body for row in rows.tolist()])
            for row in rows[thinned(poses, max(len(rows) // 10, 1))].tolist():
                self.views.forget_features(row)
                self._held -= self._places.pop(row)

    def _found(self, seen: Observation) -> Callable[[], Features]:
        return later(lambda: packed(freeze(self.features(seen, self.settings))))


def revise(views: Sequence[View], odometry: Odometry, *, who: str = "odometry",
           reach_m: float = FAR_M) -> tuple[Sequence[View], tuple[Wall, ...]]:
    """The views with the poses, scans and feature depths that the odometry settled on at the end, if it did; the walls it
    found, in the frame of these poses. who: the odometry as typed, for errors."""
    revision = odometry.revise()
    if revision is None:
        return views, ()
    revision = check_revision(revision, len(views), who=who, reach_m=reach_m)
    begun = views[0].map_from_body @ np.linalg.inv(revision.poses[0])
    return ChangedViews(views, partial(_revised, revision, begun)), tuple(shifted(w, begun, begun) for w in revision.walls)


def _revised(revision: Revision, begun: np.ndarray, k: int, view: View) -> View:
    """The k-th view as the odometry settled on it; begun: 4x4, from its frame to the map."""
    pose, scan = revision.poses[k], view.scan if revision.scans is None else freeze(revision.scans[k])
    surer = revision.covariance if k == len(revision.poses) - 1 else None
    return replace(view, map_from_body=freeze(begun @ pose), scan=scan,
                   covariance=view.covariance if surer is None else freeze(surer),
                   features=_lifted(view, pose, scan, revision.walls))


def _lifted(view: View, pose: np.ndarray, scan: Scan | None, walls: tuple[Wall, ...]) -> Features | None:
    """The view's features; those of one camera get the points where their rays meet the walls the odometry settled on, or
    what its scan measured."""
    if view.features is None or np.isfinite(view.features.points).any():
        return view.features
    if view.motion.scan_measured and scan is not None:
        return freeze(lift_on_scan(view.features, view.camera, scan))
    if not walls:
        return view.features
    return freeze(lift_on_walls(view.features, view.camera, pose, walls))


def shifted(wall: Wall, start_by: np.ndarray, end_by: np.ndarray) -> Wall:
    """The wall with its ends moved by 4x4 poses of the floor."""
    start, end = (by[:2, :2] @ at + by[:2, 3] for by, at in ((start_by, wall.start_xy_m), (end_by, wall.end_xy_m)))
    return replace(wall, start_xy_m=start, end_xy_m=end)


def carried(walls: tuple[Wall, ...], views: Sequence[View], closure: Closure) -> tuple[Wall, ...]:
    """The walls where the closed loop puts them: each end goes with the view nearest to it. views: before it closed."""
    stood = np.array([view.map_from_body[:2, 3] for view in views])

    def by(at: np.ndarray) -> np.ndarray:
        nearest = int(np.argmin(np.linalg.norm(stood - at, axis=1)))
        moved: np.ndarray = closure.poses[nearest] @ np.linalg.inv(views[nearest].map_from_body)
        return moved

    return tuple(shifted(wall, by(wall.start_xy_m), by(wall.end_xy_m)) for wall in walls)


def wall_rows(walls: tuple[Wall, ...]) -> list[dict[str, Any]]:
    """The walls as walls.json has them: ends in the map, metres; a ceiling never seen is null."""
    return [{"start_m": np.round(wall.start_xy_m, 6).tolist(), "end_m": np.round(wall.end_xy_m, 6).tolist(),
             "floor_m": float(wall.floor_m), "ceiling_m": float(wall.ceiling_m) if np.isfinite(wall.ceiling_m) else None}
            for wall in walls]


def close(views: Sequence[View], loop_closer: LoopCloser, *, who: str = "loop_closer",
          reach_m: float = FAR_M) -> tuple[Sequence[View], Closure]:
    """The views moved to the poses the loop closer found. who: the loop closer as typed, for errors."""
    closure = check_closure(loop_closer.close(views), views, who=who, reach_m=reach_m)
    return ChangedViews(views, partial(_closed, closure)), closure


def _closed(closure: Closure, k: int, view: View) -> View:
    """The k-th view where the closed loop puts it."""
    of_map = None if closure.covariances is None or np.isnan(closure.covariances[k, 0, 0]) else closure.covariances[k]
    return replace(view, map_from_body=closure.poses[k], of_map=of_map)


def draw(views: Sequence[View], mapper: Mapper, *, who: str = "mapper") -> OccupancyGrid:
    """The map, drawn anew from the corrected poses, the surest last, with what stands below the camera's height laid over
    what the mapper drew of the scans. who: the mapper as typed, for errors."""
    mapper.reset()
    obstacles, order = False, surest_last(views)
    for view in (views[k] for k in order):
        obstacles |= view.obstacle is not None
        if view.scan is not None:
            mapper.update(view.map_from_body, view.scan)
    grid = check_grid(mapper.grid(), who=who)
    if mapper.draws_furniture or not obstacles:
        return grid
    return furnished(grid, (views[k] for k in order))


def surest_last(views: Sequence[View]) -> list[int]:
    """The numbers of the views in the order in which they are drawn: the last ones decide of a cell that was seen often, and
    the end of a survey whose loop nobody closed knows worst where it is. Those whose beams end off by less than BLUR_M, by
    what the loop closer says (View.of_map), and those as unsure as each other, keep the order in which they were taken."""
    said = [(k, _end_sigma_m(view.of_map)) for k, view in enumerate(views) if view.of_map is not None]
    if not said:
        return list(range(len(views)))
    at, sigma_m = np.array(said, float).T
    blur = np.floor(np.interp(np.arange(len(views)), at, sigma_m) / BLUR_M)
    return [int(k) for k in np.argsort(-blur, kind="stable")]


def _end_sigma_m(of_map: np.ndarray) -> float:
    """Metres by which the end of a beam of LEVER_M is off (1 sigma), of a pose with covariance (6, 6)."""
    return float(np.sqrt(np.linalg.eigvalsh(of_map[:2, :2])[-1] + LEVER_M**2 * of_map[5, 5]))


def furnished(grid: OccupancyGrid, views: Iterable[View]) -> OccupancyGrid:
    """The grid with those cells occupied in which the views saw something that the scan passes over, and those behind it of
    which none showed the floor unknown (HIDDEN). The scan says that its way is free at the camera's height, which is no word
    against a table, nor for the ground under its far side."""
    from rhs.estimation.scans.votes import Votes, behind, low_only  # compiled code

    low = Votes(grid.shape, grid.resolution_m, grid.origin_m, VoteSettings())
    shown, hidden = np.zeros(grid.shape, bool), np.zeros(grid.shape, bool)
    for view in views:
        if view.obstacle is None:
            continue
        hits = low_only(view.obstacle, view.scan)
        cells = low.look(view.map_from_body, view.obstacle, hits=hits, within_m=np.inf)
        shown[cells[:, 0], cells[:, 1]] = True
        points = behind(view.obstacle, hits, HIDES_M, step_m=0.5 * grid.resolution_m)
        points = points @ view.map_from_body[:2, :2].T + view.map_from_body[:2, 3]
        rows, columns = grid.cells(points[grid.inside(points)]).T
        hidden[rows, columns] = True
    probability = grid.probability.copy()
    probability[hidden & ~shown & grid.free()] = HIDDEN
    probability[low.votes >= FURNITURE_VOTES] = FURNITURE
    return replace(grid, probability=probability)


def at_eye_level(grid: OccupancyGrid) -> OccupancyGrid:
    """The grid without what is lower than the camera, and what that hides, as a level scan meets it: free there."""
    low = np.isin(grid.probability, np.array([FURNITURE, HIDDEN], np.float32))
    return replace(grid, probability=np.where(low, np.float32(1.0 - FURNITURE), grid.probability))


def known(grid: OccupancyGrid) -> np.ndarray:
    """(H, W) bool: cells that some view showed down to the floor, or the scan where nothing low stands before them."""
    shown: np.ndarray = np.isfinite(grid.probability) & (grid.probability != np.float32(HIDDEN))
    return shown


def known_free(grid: OccupancyGrid, views: Sequence[View], radius_m: float, margin_m: float = 0.0) -> np.ndarray:
    """(H, W) bool: cells the map calls free, those the robot's own body has stood on without touching anything, and
    what nobody saw within margin_m and a cell of its side then: its own way through a hall wider than the camera sees."""
    free, unseen = grid.free(), ~known(grid)
    beside_m = radius_m + margin_m + (grid.resolution_m if margin_m else 0.0)
    rows, columns = np.indices(grid.shape)
    x = (columns + 0.5) * grid.resolution_m + grid.origin_m[0]
    y = (rows + 0.5) * grid.resolution_m + grid.origin_m[1]
    for view in views:
        px, py = view.map_from_body[:2, 3]
        gap2 = (x - px) ** 2 + (y - py) ** 2
        free |= (gap2 <= radius_m**2) | (unseen & (gap2 <= beside_m**2))
    return free
