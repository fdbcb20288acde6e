"""Helpers of the planner tests: problems, all registered first-party planners, building without a run.

A planner with two backends stands twice among PLANNERS: `prm` is as it comes, `prm/ompl` the other one.
"""

from importlib.metadata import entry_points
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from rhs.api.records import PlanningProblem
from rhs.estimation.paths.shorten import shortened
from rhs.worlds.maps import load_map

MAPS = Path(__file__).parents[2] / "worlds" / "maps"
WORDS = sorted(e.name for e in entry_points(group="rhs.planner") if e.value.startswith("rhs_planners."))
PLANNERS = WORDS + ["prm/ompl", "prm_star/ompl", "rrt_connect/ompl"]


def settings(name: str, **values):
    """The config of a planner by its word on the command line, or word/backend."""
    word, _, backend = name.partition("/")
    (entry,) = entry_points(group="rhs.planner", name=word)
    return entry.load()(**({"backend": backend} if backend else {}), **values)


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


def room() -> np.ndarray:
    """12 x 12 free cells, a wall across with one gap, and a sealed chamber in the upper right corner."""
    blocked = np.zeros((12, 12), bool)
    blocked[5, 1:] = True
    blocked[8:, 8] = blocked[8, 8:] = True
    return blocked


def digits(name: str, seed: int) -> str:
    """Every bit of a planner's raw and shortened path through the room."""
    task = problem(room(), (9.3, 1.7), (4.1, 9.2))
    path = shortened(planner(name, seed).plan(task), task)
    return path.raw_m.tobytes().hex() + path.points_m.tobytes().hex()
