"""The files of one plan: map.yaml (the grid as planned on), plan.json and sketch.npy, written and read back."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.files import replacing, write_whole
from rhs.api.frozen import freeze
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.worlds.maps import load_map, save_map
from rhs.worlds.planning_question import Arena

_MOST_LINES = 4000  # segments of a tree or roadmap that are kept for the picture


@dataclass(frozen=True)
class Question:
    """What is asked, as bytes and text that nobody can change: made before a planner is built, judged by afterwards.

    blocked: the grid (H, W) of bool, row by row; about: start, goal and whatever else plan.json says of the problem."""

    blocked: bytes
    shape: tuple[int, int]
    resolution_m: float
    origin_m: tuple[float, float]
    about: str

    def problem(self) -> PlanningProblem:
        """A copy of the problem of its own, whose arrays are read-only."""
        about, blocked = json.loads(self.about), np.frombuffer(self.blocked, bool).reshape(self.shape).copy()
        return freeze(PlanningProblem(blocked, self.resolution_m, self.origin_m, np.array(about["start_m"]),
                                      np.array(about["goal_m"])))


def question_of(arena: Arena, *, start_radius_m: float = 0.3) -> Question:
    """The arena, which must name start and goal, with its map grown by the robot's radius. start_radius_m: how far a
    start in a blocked cell may be from the way out."""
    assert arena.start_m is not None and arena.goal_m is not None
    grid = arena.grid
    about = {
        "arena": arena.name, "start_m": list(map(float, arena.start_m)), "goal_m": list(map(float, arena.goal_m)),
        "robot_radius_m": arena.robot_radius_m, "start_radius_m": start_radius_m,
        "octile_m": None if np.isnan(arena.octile_m) else float(arena.octile_m),
        "classes": {name: gate.tolist() for name, gate in arena.classes},
    }
    rows, columns = grid.shape
    origin = (float(grid.origin_m[0]), float(grid.origin_m[1]))
    blocked = grid.blocked(arena.robot_radius_m).tobytes()
    return Question(blocked, (rows, columns), grid.resolution_m, origin, json.dumps(about))


def write_plan(folder: FilePath, question: Question, path: Path, sketch: np.ndarray | None = None) -> None:
    """map.yaml, plan.json and sketch.npy. sketch: (E, 2, 2) metres, lines for the picture."""
    blocked = np.frombuffer(question.blocked, bool).reshape(question.shape)
    save_map(folder / "map", OccupancyGrid(blocked.astype(np.float32), question.resolution_m, question.origin_m))
    content = json.loads(question.about) | {
        "reason": str(path.reason), "advice": path.advice, "points_m": np.asarray(path.points_m).tolist(),
        "raw_m": np.asarray(path.raw_m).tolist(), "learn_ms": path.learn_ms, "plan_ms": path.plan_ms,
        "details": {key: float(value) for key, value in path.details.items()},
    }
    with replacing(folder / "plan.json") as file:
        file.write(json.dumps(content) + "\n")
    if sketch is not None and len(sketch):
        lines = np.asarray(sketch, np.float32)
        lines = lines[:: max(1, -(-len(lines) // _MOST_LINES))]
        write_whole(folder / "sketch.npy", lambda where: np.save(where, lines, allow_pickle=False))


def read_plan(folder: FilePath) -> tuple[Path, PlanningProblem, dict[str, Any]]:
    """Path, problem and the whole plan.json of a run folder."""
    content = json.loads((folder / "plan.json").read_text("utf-8"))
    grid = load_map(folder / "map.yaml")
    problem = PlanningProblem(grid.occupied(), grid.resolution_m, grid.origin_m, np.array(content["start_m"]),
                              np.array(content["goal_m"]))
    points, raw = (np.array(content[key], float).reshape(-1, 2) for key in ("points_m", "raw_m"))
    path = Path(PlanReason(content["reason"]), points, raw, content["learn_ms"], content["plan_ms"], None,
                content["details"], advice=content.get("advice", ""))
    return path, problem, content
