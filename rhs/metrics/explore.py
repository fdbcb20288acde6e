"""How much of a building a survey has seen, and what a robot that explored it alone spent on that."""

from __future__ import annotations

import numpy as np

from rhs.api.grid import OccupancyGrid, configuration_space, inflate
from rhs.api.metric import RunFiles, columns_of

from .survey import NAN, Values


def floor_within_reach(true: OccupancyGrid, start_m: np.ndarray, radius_m: float) -> np.ndarray:
    """(H, W) bool: free cells of the true plan that the body of a round robot can stand over, coming from start_m (2,)."""
    from scipy.ndimage import label

    growth = radius_m / true.resolution_m
    regions, _ = label(~configuration_space(~true.free(), growth), structure=np.ones((3, 3)))
    cells = np.argwhere(regions > 0)
    gaps_m = np.linalg.norm(true.centres(cells) - start_m, axis=1)
    if not len(cells) or gaps_m.min() > radius_m:  # cells are coarse: a start beside a wall may lie in a grown one
        return np.zeros(true.shape, bool)
    reached: np.ndarray = inflate(regions == regions[tuple(cells[np.argmin(gaps_m)])], growth) & true.free()
    return reached


def explored_share(mine: OccupancyGrid, true: OccupancyGrid, within_reach: np.ndarray) -> float:
    """Of the true floor within reach (H, W), the share for which the map calls some cell free, at most one cell away."""
    floor = true.centres(np.argwhere(within_reach))
    if not len(floor):
        return NAN
    cells, free = mine.cells(floor), np.pad(mine.free(), 1)
    last = np.array(free.shape) - 1
    near = [free[tuple(np.clip(cells + 1 + (dr, dc), 0, last).T)] for dr in (-1, 0, 1) for dc in (-1, 0, 1)]
    return float(np.any(near, axis=0).mean())


def explore_values(run: RunFiles) -> Values:
    """What was seen of the floor; of an explored survey also why it stopped and the true way until then."""
    mine, true, facts = run.grid("map"), run.grid("true_map"), run.json("facts")
    explored, driven = run.json("explore") or {}, run.trajectory("truth_survey")
    share, way_m = NAN, NAN
    if mine is not None and true is not None and facts is not None:
        reach = floor_within_reach(true, np.array(facts["start"][:2]), float(facts["robot_radius_m"]))
        share = explored_share(mine, true, reach)
    if explored and driven is not None and len(driven):
        way_m = float(driven.travelled_m[min(int(explored["views"]), len(driven)) - 1])
    return {"explored_share": share, "explore_way_m": way_m, "explore_stop": str(explored.get("stop", ""))}


EXPLORE = columns_of(
    explore_values,
    ("explored_share", "share",
     "of the true floor that a robot of this radius can reach, what the survey's map calls free (within a cell)",
     "rhs.metrics.explore"),
    ("explore_way_m", "m", "true distance of an exploration until it stopped; `distance_m` includes the way home",
     "explore.json, truth_survey.tum"),
    ("explore_stop", "", "why it stopped: no frontier, budget or coverage; and why it did not get home, if so",
     "explore.json"),
    words=("explore_stop",), more_is_better=("explored_share",),
)
