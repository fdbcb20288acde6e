"""How far a drawn map agrees with the true plan."""

from __future__ import annotations

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.api.metric import LOOP, RunFiles, columns_of


def map_agreement(mine: OccupancyGrid, true: OccupancyGrid) -> dict[str, float]:
    """map_agreement: of the cells called occupied or free, the share with a true cell of that kind within one cell
    (eight neighbours). map_observed_share: of the truly free cells, the share that was called anything.

    The grids may differ in extent and resolution: each cell of `mine` is compared at its centre.
    """
    occupied, free = mine.occupied(), mine.free()
    called = np.argwhere(occupied | free)
    if not len(called):
        return {"map_agreement": float("nan"), "map_observed_share": 0.0}
    reach = mine.resolution_m * np.array([[dx, dy] for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    near = mine.centres(called)[:, None, :] + reach[None]
    is_occupied = _look_up(true, true.occupied(), near).any(axis=1)
    is_free = _look_up(true, true.free(), near).any(axis=1)
    agrees = np.where(occupied[called[:, 0], called[:, 1]], is_occupied, is_free)
    floor = true.centres(np.argwhere(true.free()))
    seen = _look_up(mine, ~np.isnan(mine.probability), floor[:, None, :])[:, 0]
    return {"map_agreement": float(agrees.mean()), "map_observed_share": float(seen.mean()) if len(seen) else float("nan")}


def _look_up(grid: OccupancyGrid, flags: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Flags of (N, K, 2) points; False outside the grid."""
    flat = points.reshape(-1, 2)
    inside = grid.inside(flat)
    out = np.zeros(len(flat), bool)
    cells = grid.cells(flat[inside])
    out[inside] = flags[cells[:, 0], cells[:, 1]]
    return out.reshape(points.shape[:2])


def map_values(run: RunFiles) -> dict[str, float | int | str]:
    """How far the map agrees with the true plan, and how much of the true free space was seen."""
    mine, true = run.grid("map"), run.grid("true_map")
    if mine is None or true is None:
        return {"map_agreement": float("nan"), "map_observed_share": float("nan")}
    return {**map_agreement(mine, true)}


def contradiction_values(run: RunFiles) -> dict[str, float | int | str]:
    """What the map says against itself, before and after closing, how sure its way is; from when it was closed."""
    known = run.json("closure") or {}
    said = {**known.get("details", {}), **known}
    return {name: float(said.get(name, float("nan"))) for name in (*CONTRADICTIONS, "way_sigma_m", *WHEELS, "views_late_s")}


def mount_values(run: RunFiles) -> dict[str, float | int | str]:
    """How the laser of a recording sits, seen from what was told."""
    known = run.json("closure") or run.json("localise") or {}
    return {name: float(known.get(name, float("nan"))) for name in MOUNT}


CONTRADICTIONS = ("map_inconsistency", "map_inconsistency_before_closing")
WHEELS = ("wheel_way_ratio", "wheel_turn_ratio")
MOUNT = ("mount_roll_off_deg", "mount_yaw_off_deg", "mount_heading_off_deg")
MAP = columns_of(
    contradiction_values,
    ("map_inconsistency", "share",
     "walls that beams of other passes see through, of those they see through or hit; above 0.04 the map is wrong",
     "rhs.estimation.scans.inconsistency"),
    ("map_inconsistency_before_closing", "share", "the same before loop closing",
     "rhs.estimation.scans.inconsistency"),
    ("way_sigma_m", "m",
     "standard deviation of positions seen from the start, rms along the way, by the pose graph of loop_closer=scan_graph: "
     "large where scans saw no motion (corridors, empty streets) and no loop corrected it", "closure.json"),
    ("wheel_way_ratio", "",
     "way that the wheels of a recording told of over what the camera saw, median of the views that go straight",
     "rhs.patrol.gate"),
    ("wheel_turn_ratio", "", "the same of turns", "rhs.patrol.gate"),
    ("views_late_s", "s",
     "by which the views of a survey are stamped later than the turns that the wheels told of; 0 where they agree as far as "
     "can be told", "rhs.estimation.filters.time_offset"),
) + columns_of(
    mount_values,
    ("mount_roll_off_deg", "deg",
     "180: by its scans and the wheels the laser of a recording is mounted upside down, and that was not told; else 0",
     "rhs.estimation.scans.mount_fit"),
    ("mount_yaw_off_deg", "deg",
     "by which the laser is turned about the vertical besides (left positive) seen from what was told; 0 below what wheels "
     "that drift would look like", "rhs.estimation.scans.mount_fit"),
    ("mount_heading_off_deg", "deg",
     "by which the sensor of a survey beside wheels is turned about the vertical (left positive) seen from what was told, "
     "by the way as it was solved; 0 below 5", "rhs.estimation.scans.mount_fit"),
    tasks=(*LOOP, "localise"),
) + columns_of(
    map_values,
    ("map_agreement", "share", "cells called occupied or free that have a true cell of that kind within one cell",
     "map.yaml, true_map.yaml"),
    ("map_observed_share", "share", "truly free cells that are not unknown in the map", "map.yaml, true_map.yaml"),
    more_is_better=("map_agreement", "map_observed_share"),
)
