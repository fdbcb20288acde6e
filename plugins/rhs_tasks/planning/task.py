"""The planning task: one planner, one problem, one row; the planners alone, without a robot.

The files of a run folder: config.yaml, map.yaml and map.pgm (the grid as planned on: grown by the robot's radius),
plan.json (problem, path, times, details), sketch.npy (the tree or roadmap, thinned), plan.png, row.json. Every column
but the times of this machine follows from map and plan.json (`evaluate_plan`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.contracts import Context, FeatureSettings, WorldFacts
from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import camera_from_fov
from rhs.api.grid import inflate
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.config.compose import RunConfig, identity
from rhs.config.parts import generator
from rhs.metrics.path_judge import Optimum
from rhs.patrol.task_row import run_task
from rhs.reports.planning_pictures import plan_picture
from rhs.runfolder.plan_files import read_plan, write_plan
from rhs.worlds.planning_question import Arena, load_arena

from .metrics import path_values


def run_planning_config(config: RunConfig, folder: FilePath) -> dict[str, Any]:
    """Plan one problem as a run of the command line, and return its row, written whatever the outcome.

    Raises ConfigError before anything ran, for what can be refused. The cause of a failure stands under `_cause`.
    """
    arena = chosen_arena(config)
    which = identity(config)
    about = {name: which[name] for name in ("task", "world", "planner", "seed", "config_hash")}
    row = run_task(about, config, folder,
                   lambda: run_planning(config.planner.settings, arena, seed=config.seed, folder=folder))
    if row["_cause"] is None:
        plan_picture(folder)
    return row


def run_planning(settings: Any, arena: Arena, *, seed: int, folder: FilePath) -> dict[str, Any]:
    """Build the planner from its settings, plan twice (to learn, and with what was learnt), write the files, return the
    columns. arena must name start and goal. Times are the CPU milliseconds that the planner reports."""
    problem = problem_of(arena)
    warm_up(settings, arena, folder)
    planner = settings.build(context_of(arena, folder, generator(seed, "planner")))
    path = checked(planner.plan(problem), settings)
    again = checked(planner.plan(problem), settings)
    write_plan(folder, path, problem, arena)
    return evaluate_plan(folder) | {"plan_learn_ms": path.learn_ms, "plan_ms": path.plan_ms, "plan_again_ms": again.plan_ms}


def chosen_arena(config: RunConfig) -> Arena:
    """The arena that the configuration names, with its start, goal and radius where they were typed."""
    arena = load_arena(config.world, scenario=config.planning.scenario)
    ends: dict[str, Any] = {}
    for key in ("start", "goal"):
        typed, known = getattr(config, key), getattr(arena, f"{key}_m")
        if not typed and known is None:
            raise ConfigError(f"{key}: the map {arena.name} names none; give one in metres, for example {key}=[1.0,2.0]")
        ends[f"{key}_m"] = np.array(typed, float) if typed else known
    radius = config.planning.robot_radius_m
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


def evaluate_plan(folder: FilePath) -> dict[str, Any]:
    """All columns that follow from the files of a run folder."""
    path, problem, content = read_plan(folder)
    optimum = Optimum(problem.blocked, problem.resolution_m, problem.origin_m)
    classes = tuple((name, np.array(gate)) for name, gate in content["classes"].items())
    values = path_values(path, problem, optimum=optimum, classes=classes)
    octile = float("nan") if content["octile_m"] is None else content["octile_m"]
    rows, columns = problem.blocked.shape
    return values | {"octile_claimed_m": octile, "map_resolution_m": problem.resolution_m, "map_cells": rows * columns}
