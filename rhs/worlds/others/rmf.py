"""Buildings of Open-RMF's traffic editor (`.building.yaml`): the level of reference, its floors, walls and holes.

As rmf_building_map_tools builds them: walls are 0.1 m thick, doors stand where no wall is drawn (and are open here), a pixel
is the mean of what the measurements say, and y of a drawing points down. Other levels, lifts and models are left out.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

from ..house_expo import inside
from ..maps import MOST_CELLS, read_yaml

CELL_M = 0.05
WALL_M = 0.1
MARGIN_M = 0.5  # round all of it
SYSTEMS = ("reference_image", "cartesian_meters")  # of which the first has y down, and pixels

log = logging.getLogger("rhs.worlds")


def level_in(path: Path) -> OccupancyGrid | None:
    """The floor of a building, free, and all else a wall; None of another YAML. Raises ConfigError in one line."""
    plain = read_yaml(path)
    levels = plain.get("levels")
    if "levels" not in plain:
        return None
    if not isinstance(levels, dict) or not levels:
        raise ConfigError(f"{path}: levels holds no level; expected one of RMF's traffic editor")
    name = plain.get("reference_level_name", next(iter(levels)))
    system = plain.get("coordinate_system", SYSTEMS[0])
    if system not in SYSTEMS:
        raise ConfigError(f"{path}: coordinate_system is {system!r}; expected {' or '.join(SYSTEMS)}, metres")
    try:
        grid = _drawn(levels[name], metric=system != SYSTEMS[0])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        said = " ".join(str(error).split())[:120]
        raise ConfigError(f"{path}: level {name} of RMF's traffic editor cannot be read ({said})") from None
    log.warning("%s: the walls and floors of level %s, its doors open; left out: levels %d, models %d", path.name, name,
                len(levels) - 1, len(levels[name].get("models") or ()))
    return grid


def _drawn(level: dict[str, Any], *, metric: bool) -> OccupancyGrid:
    """Cells are free whose middle is on a floor (where there is none: anywhere), not over a hole, and in no wall. Raises
    ValueError and what wrong types raise."""
    points = np.array([vertex[:2] for vertex in level["vertices"]], float).reshape(-1, 2)
    if not metric:
        points = points * (1.0, -1.0) * _metres_a_pixel(level, points)
    walls = [_footprint(points[list(wall[:2])]) for wall in level.get("walls") or () if wall[0] != wall[1]]
    floors, holes = ([points[one["vertices"]] for one in level.get(key) or ()] for key in ("floors", "holes"))
    if not walls:
        raise ValueError("it has no walls")
    corners = np.concatenate([*walls, *floors])
    low = corners.min(axis=0) - MARGIN_M
    columns, rows = np.ceil((corners.max(axis=0) + MARGIN_M - low) / CELL_M).tolist()
    if not rows * columns <= MOST_CELLS:
        raise ValueError(f"it spans {columns * CELL_M:.0f} x {rows * CELL_M:.0f} m")
    free = np.full((int(rows), int(columns)), not floors)
    for polygons, value in ((floors, True), (holes, False), (walls, False)):
        for polygon in polygons:
            _fill(free, (polygon - low) / CELL_M, value=value)
    return OccupancyGrid(np.where(free, 0.0, 1.0).astype(np.float32), CELL_M, (float(low[0]), float(low[1])))


def _metres_a_pixel(level: dict[str, Any], points: np.ndarray) -> float:
    ratios = [float(about["distance"][1]) / float(np.linalg.norm(points[a] - points[b]))
              for a, b, about in level.get("measurements") or () if a != b]
    if not ratios or not 0.0 < np.mean(ratios) < np.inf:
        raise ValueError("nothing says how large a pixel is: draw a measurement in the traffic editor")
    return float(np.mean(ratios))


def _footprint(ends: np.ndarray) -> np.ndarray:
    """(4, 2) corners of a wall between two points (2, 2), half its thickness longer at each end."""
    along = (ends[1] - ends[0]) * 0.5 * WALL_M / np.linalg.norm(ends[1] - ends[0])
    across = np.array([-along[1], along[0]])
    return np.array([ends[0] - along + across, ends[1] + along + across, ends[1] + along - across, ends[0] - along - across])


def _fill(cells: np.ndarray, corners: np.ndarray, *, value: bool) -> None:
    """Sets the cells whose middle is inside a polygon (N, 2), in cells."""
    low, high = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    part = cells[low[1]:high[1], low[0]:high[0]]
    part[inside(corners - low, part.shape)] = value
