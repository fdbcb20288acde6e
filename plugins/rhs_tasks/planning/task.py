"""The planning task: one planner, one problem, one row; the planners alone, without a robot.

The files of a run folder: config.yaml, map.yaml and map.pgm (the grid as planned on: grown by the robot's radius),
plan.json (problem, path, times, details), sketch.npy (the tree or roadmap, thinned), plan.png, row.json. Every column
but the times of this machine follows from map and plan.json (`evaluate_plan`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.contracts import Context, FeatureSettings, WorldFacts
from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import camera_from_fov
from rhs.api.grid import inflate
from rhs.api.randomness import generator
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.api.task import TaskContext, Value
from rhs.worlds.plan_files import write_plan
from rhs.worlds.planning_question import Arena, load_arena

from .settings import Planning


class PlanningJob:
    """One planner, one problem."""

    def __init__(self, settings: Planning, context: TaskContext) -> None:
        self.context = context
        self.arena = chosen_arena(settings, context.world)

    def run(self) -> Mapping[str, Value]:
        """The columns of the row; map.yaml, plan.json and sketch.npy lie in the folder."""
        return run_planning(self.context.settings("planner"), self.arena, seed=self.context.seed, folder=self.context.folder)


def run_planning(settings: Any, arena: Arena, *, seed: int, folder: FilePath) -> dict[str, Any]:
    """Build the planner from its settings, plan twice (to learn, and with what was learnt), write the files, return the
    columns. arena must name start and goal. Times are the CPU milliseconds that the planner reports."""
    problem = problem_of(arena)
    warm_up(settings, arena, folder)
    planner = settings.build(context_of(arena, folder, generator(seed, "planner")))
    path = checked(planner.plan(problem), settings)
    again = checked(planner.plan(problem), settings)
    write_plan(folder, path, problem, arena)
    details = {f"plan_{key}": float(value) for key, value in path.details.items()}
    return details | {"plan_learn_ms": path.learn_ms, "plan_ms": path.plan_ms, "plan_again_ms": again.plan_ms}


def chosen_arena(settings: Planning, world: str) -> Arena:
    """The arena that was typed, with its start, goal and radius where they were typed."""
    arena = load_arena(world, scenario=settings.planning.scenario)
    ends: dict[str, Any] = {}
    for key in ("start", "goal"):
        typed, known = getattr(settings, key), getattr(arena, f"{key}_m")
        if not typed and known is None:
            raise ConfigError(f"{key}: the map {arena.name} names none; give one in metres, for example {key}=[1.0,2.0]")
        ends[f"{key}_m"] = np.array(typed, float) if typed else known
    radius = settings.planning.robot_radius_m
    return replace(arena, **ends, robot_radius_m=arena.robot_radius_m if radius is None else radius)


def problem_of(arena: Arena) -> PlanningProblem:
    """The problem in the map grown by the robot's radius; its arrays cannot be written to."""
    assert arena.start_m is not None and arena.goal_m is not None
    grid = arena.grid
    blocked = inflate(~grid.free(), arena.robot_radius_m / grid.resolution_m)
    arrays = [blocked, np.array(arena.start_m, float), np.array(arena.goal_m, float)]
    for array in arrays:
        array.setflags(write=False)
    return PlanningProblem(arrays[0], grid.resolution_m, grid.origin_m, arrays[1], arrays[2])


def context_of(arena: Arena, folder: FilePath, rng: np.random.Generator) -> Context:
    """What a planner is built with when there is no robot: an ordinary camera that nobody uses."""
    rows, columns = arena.grid.shape
    (x, y), step = arena.grid.origin_m, arena.grid.resolution_m
    start = (0.0, 0.0) if arena.start_m is None else tuple(map(float, arena.start_m))
    facts = WorldFacts(arena.name, (start[0], start[1], 0.0), (), (x, y, x + columns * step, y + rows * step),
                       arena.robot_radius_m)
    return Context(rng, camera_from_fov(640, 480, 60.0, height_m=1.2), facts, folder, FeatureSettings())


def warm_up(settings: Any, arena: Arena, folder: FilePath) -> None:
    """Plan something tiny with another instance, so that no time is spent on loading libraries."""
    blocked = np.zeros((8, 8), bool)
    blocked[4, 1:] = True
    tiny = PlanningProblem(blocked, 0.1, (0.0, 0.0), np.array([0.65, 0.15]), np.array([0.65, 0.65]))
    settings.build(context_of(arena, folder, generator(0, "warm-up"))).plan(tiny)


def checked(path: Any, settings: Any) -> Path:
    """The path, or ContractError: a success needs points, a failure has none, numbers are finite."""
    name = type(settings).__name__
    if not isinstance(path, Path) or not isinstance(path.reason, PlanReason):
        raise ContractError(f"planner {name} returned {type(path).__name__}; expected a Path with a PlanReason")
    for what in ("points_m", "raw_m"):
        points = np.asarray(getattr(path, what))
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            raise ContractError(f"planner {name}: {what} has shape {points.shape}; expected (N, 2) finite metres")
        if what == "points_m" and path.found != (len(points) > 0):
            raise ContractError(f"planner {name}: reason {path.reason} with {len(points)} points")
    return path
