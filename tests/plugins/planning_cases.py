"""Helpers of the planner tests: problems, all registered first-party planners, building without a run."""

from importlib.metadata import entry_points
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from rhs.maps import load_map
from rhs.records import PlanningProblem

MAPS = Path(__file__).parents[2] / "worlds" / "maps"
PLANNERS = sorted(e.name for e in entry_points(group="rhs.planner") if e.value.startswith("rhs_planners."))


def settings(name: str, **values):
    """The config of a planner by its word on the command line."""
    (entry,) = entry_points(group="rhs.planner", name=name)
    return entry.load()(**values)


def planner(name: str, seed: int = 0, **values):
    return settings(name, **values).build(SimpleNamespace(rng=np.random.default_rng(seed)))


def problem(blocked, start, goal, resolution_m: float = 1.0, origin_m=(0.0, 0.0)) -> PlanningProblem:
    blocked = np.asarray(blocked, bool)
    blocked.setflags(write=False)
    return PlanningProblem(blocked, resolution_m, origin_m, np.array(start, float), np.array(goal, float))


def thesis_problem(number: int) -> PlanningProblem:
    """Maps 1 to 4 of the thesis's table 3.1 for a point robot."""
    grid = load_map(MAPS / f"map{number}.yaml")
    start, goal = ((2.0, 1.0), (5.0, 3.0)) if number == 1 else ((1.0, 1.0), (9.0, 9.0))
    return problem(grid.blocked(0.0), start, goal, grid.resolution_m, grid.origin_m)
