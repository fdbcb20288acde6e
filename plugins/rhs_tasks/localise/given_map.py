"""The map in which somebody is to be found: read from a file, or from what a survey left in its run folder.

A ROS map and a floor plan are walls alone. A run folder has its map, the corrected way and, in run.mcap, what was seen on
it: its places are computed again from there. Where the survey's truth is known, true poses of a second drive are moved
into the map by it; that is for the judge alone.
"""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError, RhsError
from rhs.api.floorplan import truth_grid
from rhs.api.geometry import Camera, align, inverse
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Features, FeatureSettings, Motion, Observation, Tracking, View, Wall
from rhs.api.trajectory import Trajectory, associate, read_tum
from rhs.estimation.scans.wall_rays import lift_on_walls
from rhs.recording.reader import RecordedView, RunHead, read, read_head
from rhs.worlds.buildings import PICTURES
from rhs.worlds.maps import load_map, read_yaml
from rhs.worlds.world import load_world

log = logging.getLogger("rhs.localise")
WIDE_M = 1.0  # cells of a map that are hardly in metres
NO_CAMERA = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)
KNOWN = 1e-6 * np.eye(6)  # covariance of a pose that is taken as it stands
PAIRED_S = 0.02  # a corrected pose and a true one at most so far apart in time are of one view
EVERY = 3  # views of a survey from one place to the next, where its recording does not say


@dataclass(frozen=True, eq=False)
class GivenMap:
    """grid: the walls. folder: of the survey that drew it, or None. head: of its recording, or None. way: the survey's
    corrected poses and (`true_way`) its true ones, pair by pair, where its truth is known; None: true poses are taken to
    stand in the frame of the map."""

    grid: OccupancyGrid
    folder: Path | None = None
    head: RunHead | None = None
    way: np.ndarray | None = None
    true_way: np.ndarray | None = None

    @property
    def has_pictures(self) -> bool:
        """Whether places can be computed from the survey's recording."""
        return self.head is not None and self.head.has_images

    def in_map(self, truth: np.ndarray) -> np.ndarray:
        """A true pose (4x4) where the map has it: as it stands to the nearest view of the survey, by the truth. A map is
        bent; so is what is called right in it."""
        if self.way is None or self.true_way is None:
            return truth
        nearest = int(np.argmin(np.linalg.norm(self.true_way[:, :3, 3] - truth[:3, 3], axis=1)))
        moved: np.ndarray = self.way[nearest] @ inverse(self.true_way[nearest]) @ truth
        return moved

    @property
    def misfit_m(self) -> float:
        """How far the survey's way is off its truth when laid onto it (Umeyama 1991), RMS in metres: how bent the map is.
        NaN where nobody knows."""
        if self.way is None or self.true_way is None:
            return float("nan")
        move, _ = align(self.true_way[:, :3, 3], self.way[:, :3, 3])
        off_m = np.linalg.norm((move @ self.true_way)[:, :3, 3] - self.way[:, :3, 3], axis=1)
        return float(np.sqrt(np.mean(off_m**2)))


def read_given(name: str) -> GivenMap:
    """The map that was typed. Raises ConfigError in one line for anything else."""
    if not name:
        raise ConfigError("map is empty; type map=MAP.yaml (a ROS map), map=RUN_FOLDER or map=WORLD")
    path = Path(name).expanduser()
    if path.is_dir():
        return _of_run(path)
    if path.is_file() and path.suffix.lower() in PICTURES:
        raise ConfigError(f"map={name}: found a {path.suffix}; type map={path.with_suffix('.yaml')}, which says "
                          "how large a pixel of the picture is and where it lies")
    if path.is_file() and path.suffix.lower() in (".yaml", ".yml") and "image" in read_yaml(path):
        return GivenMap(_looked_at(load_map(path), path))
    try:
        return GivenMap(truth_grid(load_world(name)))
    except ConfigError as error:
        if path.is_file():
            raise
        raise ConfigError(f"map={name}: no such file, folder or world; type map=MAP.yaml (a ROS map), map=RUN_FOLDER or "
                          "map=WORLD") from error


def _looked_at(grid: OccupancyGrid, path: Path) -> OccupancyGrid:
    """The map; what is odd about it is said, for in such a one nobody finds himself."""
    walls, floor = int(grid.occupied().sum()), int(grid.free().sum())
    if walls > floor:
        log.warning("%s: more of it is wall (%d cells) than floor (%d); for a dark floor turn `negate` round (mode: raw of "
                    "a map in percent)", path.name, walls, floor)
    if grid.resolution_m >= WIDE_M:
        log.warning("%s: its cells are %g m wide; `resolution` is in metres (5 cm: 0.05)", path.name, grid.resolution_m)
    return grid


def _of_run(folder: Path) -> GivenMap:
    if not (folder / "map.yaml").is_file() or not (folder / "corrected.tum").is_file():
        raise ConfigError(f"map={folder}: holds no map.yaml with corrected.tum; expected the folder of a finished survey")
    grid, recording = load_map(folder / "map.yaml"), folder / "run.mcap"
    head = read_head(recording) if recording.is_file() else None
    corrected, truth = (read_tum(folder / f"{name}.tum") if (folder / f"{name}.tum").is_file() else None
                        for name in ("corrected", "truth_survey"))
    assert corrected is not None
    return GivenMap(grid, folder, head, *paired(corrected, truth))


def paired(corrected: Trajectory, truth: Trajectory | None) -> tuple[np.ndarray | None, np.ndarray | None]:
    """(N, 4, 4) corrected and true poses of the views that have both; (None, None) where there is none."""
    if truth is None:
        return None, None
    pairs = associate(corrected.stamps_s, truth.stamps_s, PAIRED_S)
    return (corrected.poses[pairs[:, 0]], truth.poses[pairs[:, 1]]) if len(pairs) else (None, None)


def surveyed(given: GivenMap, settings: FeatureSettings, *, pictures: bool) -> tuple[View, ...]:
    """The views of the survey behind a map, at their corrected poses, as a localiser learns them; none of a plain map.

    pictures: key-points are computed for those that the survey kept as places (a view in `places.every`, and the last).
    Raises RhsError where the recording and corrected.tum are not of one survey."""
    if given.folder is None:
        return ()
    poses = read_tum(given.folder / "corrected.tum")
    if given.head is None:
        return tuple(_view(k, stamp, NO_CAMERA, poses, None) for k, stamp in enumerate(poses.stamps_s))
    every = int(given.head.config.get("places", {}).get("every", EVERY))
    walls, views, last = _walls(given.folder / "walls.json"), [], None
    survey = (view for view in read(given.folder / "run.mcap").views() if view.phase == "survey")
    for k, seen in enumerate(survey):
        if k >= len(poses):
            raise RhsError(f"{given.folder}: run.mcap holds more views of the survey than corrected.tum has poses")
        last = Observation(k, seen.capture.stamp_s, given.head.camera, seen.capture.image, seen.capture.depth,
                           seen.capture.scan)
        stored = pictures and k % every == 0
        view = _view(k, seen.capture.stamp_s, given.head.camera, poses, seen)
        views.append(replace(view, features=_key_points(last, settings, view, walls)) if stored else view)
    if pictures and last is not None and views[-1].features is None:
        views[-1] = replace(views[-1], features=_key_points(last, settings, views[-1], walls))
    return tuple(views)


def _view(k: int, stamp_s: float, camera: Camera, poses: Trajectory, seen: RecordedView | None) -> View:
    before = inverse(poses.poses[max(k - 1, 0)]) @ poses.poses[k]
    return View(k, float(stamp_s), camera, Motion(before, KNOWN, Tracking.OK), poses.poses[k], KNOWN,
                None if seen is None else seen.capture.scan, None)


def _key_points(seen: Observation, settings: FeatureSettings, view: View, walls: tuple[Wall, ...]) -> Features | None:
    """Those of a stored view; of a monocular sensor, with points where their rays meet the walls of the survey."""
    from rhs.estimation.views.features import features

    if seen.image is None:
        return None
    found = features(seen, settings)
    if walls and not np.isfinite(found.points).any():
        return lift_on_walls(found, view.camera, view.map_from_body, walls)
    return found


def _walls(path: Path) -> tuple[Wall, ...]:
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []
    return tuple(Wall(np.array(row["start_m"], float), np.array(row["end_m"], float), row["floor_m"],
                      np.inf if row["ceiling_m"] is None else row["ceiling_m"]) for row in rows)
