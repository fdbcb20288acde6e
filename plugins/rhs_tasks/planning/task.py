"""The planning task: one planner, one problem, one row; the planners alone, without a robot.

The files of a run folder: config.yaml, map.yaml and map.pgm (the grid as planned on: grown by the robot's radius),
plan.json (problem, path, times, details), sketch.npy (the tree or roadmap, thinned), row.json. Every column but the times
of this machine follows from map and plan.json (rhs.metrics.planning); so does the picture plan.png.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.contracts import Context, Planner
from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov
from rhs.api.randomness import generator
from rhs.api.records import FeatureSettings, PlanningProblem, WorldFacts
from rhs.api.task import TaskContext, Value
from rhs.estimation.paths.shorten import shortened
from rhs.worlds.plan_files import question_of, write_plan
from rhs.worlds.planning_question import Arena, load_arena

from .asking import ask_twice, times
from .settings import Planning


class PlanningJob:
    """One planner, one problem."""

    def __init__(self, settings: Planning, context: TaskContext) -> None:
        self.settings, self.context = settings, context
        self.arena = chosen_arena(settings, context.world, context.seed)
        self.warm = context.build_part("planner", context_of(self.arena, context.folder, generator(0, "warm-up")))

    def run(self) -> Mapping[str, Value]:
        """Put the question, ask, pull the path tight, write the files: the columns follow from them, but for the times."""
        context, chosen = self.context, self.settings.planning
        question = question_of(self.arena, start_radius_m=chosen.start_radius_m)
        warm_up(self.warm)
        first, again = ask_twice(lambda rng: context.build_part("planner", context_of(self.arena, context.folder, rng)),
                                 question.problem(), partial(generator, context.seed, "planner"), who=context.who("planner"))
        path = shortened(first.path, question.problem()) if chosen.shorten else first.path
        write_plan(context.folder, question, path, first.sketch)
        return {f"plan_{key}": float(value) for key, value in path.details.items()} | times(first, again)


def chosen_arena(settings: Planning, world: str, seed: int) -> Arena:
    """The arena that was typed, with its start, goal and radius where they were typed."""
    arena = load_arena(world, scenario=settings.planning.scenario, seed=seed)
    ends: dict[str, Any] = {}
    for key in ("start", "goal"):
        typed, known = getattr(settings, key), getattr(arena, f"{key}_m")
        if not typed and known is None:
            raise ConfigError(f"{key}: the map {arena.name} names none; give one in metres, for example {key}=[1.0,2.0]")
        ends[f"{key}_m"] = np.array(typed, float) if typed else known
    radius = settings.planning.robot_radius_m
    return replace(arena, **ends, robot_radius_m=arena.robot_radius_m if radius is None else radius)


def context_of(arena: Arena, folder: FilePath, rng: np.random.Generator) -> Context:
    """What a planner is built with when there is no robot: an ordinary camera that nobody uses."""
    rows, columns = arena.grid.shape
    (x, y), step = arena.grid.origin_m, arena.grid.resolution_m
    start = (0.0, 0.0) if arena.start_m is None else tuple(map(float, arena.start_m))
    facts = WorldFacts(arena.name, (start[0], start[1], 0.0), (), (x, y, x + columns * step, y + rows * step),
                       arena.robot_radius_m)
    return Context(rng, camera_from_fov(640, 480, 60.0, height_m=1.2), facts, folder, FeatureSettings())


def warm_up(planner: Planner) -> None:
    """Plan something tiny with another planner, so that no time is spent on loading libraries."""
    blocked = np.zeros((8, 8), bool)
    blocked[4, 1:] = True
    tiny = PlanningProblem(blocked, 0.1, (0.0, 0.0), np.array([0.65, 0.15]), np.array([0.65, 0.65]))
    planner.plan(tiny)
