"""The planning task: one planner, one problem, one row; the planners alone, without a robot.

The files of a run folder: config.yaml, map.yaml and map.pgm (the grid as planned on: grown by the robot's radius),
plan.json (problem, path, times, details), sketch.npy (the tree or roadmap, thinned), row.json. Every column but the times
of this machine follows from map and plan.json (rhs.metrics.planning); so does the picture plan.png.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.contracts import Context, FeatureSettings, WorldFacts
from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov
from rhs.api.records import PlanningProblem
from rhs.config.compose import RunConfig, identity
from rhs.config.parts import generator
from rhs.patrol.task_row import run_task
from rhs.runfolder.plan_files import question_of, write_plan
from rhs.worlds.planning_question import Arena, load_arena


def run_planning_config(config: RunConfig, folder: FilePath) -> dict[str, Any]:
    """Plan one problem as a run of the command line, and return its row, written whatever the outcome.

    Raises ConfigError before anything ran, for what can be refused. The cause of a failure stands under `_cause`.
    """
    arena = chosen_arena(config)
    which = identity(config)
    about = {name: which[name] for name in ("task", "world", "planner", "seed", "config_hash")}
    row = run_task(about, config, folder, lambda: run_planning(config, arena, folder))
    if row["_cause"] is None:
        from rhs.reports.planning_pictures import plan_picture

        plan_picture(folder)
    return row


def run_planning(config: RunConfig, arena: Arena, folder: FilePath) -> dict[str, Any]:
    """Put the question, ask, pull the path tight, write the files, judge by the files. arena must name start and goal."""
    from rhs.estimation.paths.shorten import shortened
    from rhs.metrics.planning import evaluate_plan

    from .asking import ask_twice, times

    settings, chosen = config.planner.settings, config.planning
    question = question_of(arena, start_radius_m=chosen.start_radius_m)
    warm_up(settings, arena, folder)
    first, again = ask_twice(lambda rng: settings.build(context_of(arena, folder, rng)), question.problem(),
                             partial(generator, config.seed, "planner"))
    path = shortened(first.path, question.problem()) if chosen.shorten else first.path
    write_plan(folder, question, path, first.sketch)
    return evaluate_plan(folder) | times(first, again)


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
    return question_of(arena).problem()


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
