"""The files of one plan: map.yaml (the grid as planned on), plan.json and sketch.npy, written and read back."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.files import replacing, write_whole
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.worlds.maps import load_map, save_map
from rhs.worlds.planning_question import Arena

_MOST_LINES = 4000  # segments of a tree or roadmap that are kept for the picture


def write_plan(folder: FilePath, path: Path, problem: PlanningProblem, arena: Arena) -> None:
    """map.yaml, plan.json and sketch.npy."""
    probability = problem.blocked.astype(np.float32)
    save_map(folder / "map", OccupancyGrid(probability, problem.resolution_m, problem.origin_m))
    content = {
        "arena": arena.name, "start_m": problem.start_m.tolist(), "goal_m": problem.goal_m.tolist(),
        "robot_radius_m": arena.robot_radius_m, "octile_m": _or_none(arena.octile_m),
        "classes": {name: gate.tolist() for name, gate in arena.classes},
        "reason": str(path.reason), "points_m": np.asarray(path.points_m).tolist(), "raw_m": np.asarray(path.raw_m).tolist(),
        "learn_ms": path.learn_ms, "plan_ms": path.plan_ms,
        "details": {key: float(value) for key, value in path.details.items()},
    }
    with replacing(folder / "plan.json") as file:
        file.write(json.dumps(content) + "\n")
    if path.sketch is not None and len(path.sketch):
        lines = np.asarray(path.sketch, np.float32)
        lines = lines[:: max(1, -(-len(lines) // _MOST_LINES))]
        write_whole(folder / "sketch.npy", lambda where: np.save(where, lines, allow_pickle=False))


def read_plan(folder: FilePath) -> tuple[Path, PlanningProblem, dict[str, Any]]:
    """Path, problem and the whole plan.json of a run folder."""
    content = json.loads((folder / "plan.json").read_text("utf-8"))
    grid = load_map(folder / "map.yaml")
    problem = PlanningProblem(grid.occupied(), grid.resolution_m, grid.origin_m, np.array(content["start_m"]),
                              np.array(content["goal_m"]))
    points, raw = (np.array(content[key], float).reshape(-1, 2) for key in ("points_m", "raw_m"))
    reason, details = PlanReason(content["reason"]), content["details"]
    return Path(reason, points, raw, content["learn_ms"], content["plan_ms"], None, details), problem, content


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
