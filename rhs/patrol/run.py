"""One run as a list of verbs: compose, survey, close the loop, patrol, evaluate, write the row, draw."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.floorplan import Box, World
from rhs.api.records import Belief, Step
from rhs.api.trajectory import Trajectory, write_tum
from rhs.api.validate import reach_of
from rhs.base.errors import RhsError
from rhs.base.memory import keep_freed_memory
from rhs.base.provenance import commit, peak_memory_mb, versions
from rhs.config.compose import RunConfig, build_parts, identity
from rhs.config.parts import Parts, generator
from rhs.metrics.metrics import evaluate
from rhs.runfolder.row import write_row
from rhs.worlds.maps import save_map
from rhs.worlds.world import load_world

from . import survey as surveying
from .gate import gated
from .kidnap import Kidnapper
from .loop import Led, steps
from .mission import turning
from .observers import Notebook, Watch, closure_rows, open_notebook, plan_row, unwatched, write_json
from .sentinel import Sentinel
from .survey import Survey, ViewCollector

OBSTACLE_HEIGHT_M = 1.8
START_VARIANCE = np.array([1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-3])  # of the belief a patrol begins with, if not better


def run_config(config: RunConfig, folder: Path, watch: Watch = unwatched) -> dict[str, Any]:
    """Run one experiment in `folder` and return its row, which is also written there whatever the outcome.

    Raises ConfigError, before anything ran, for what can be refused. A failure later is a row with a reason; the
    exception that caused it is chained to the returned row under the key `_cause` and not written.
    """
    if config.task == "planning":
        from rhs_tasks.planning.task import run_planning_config

        return run_planning_config(config, folder)
    if config.task == "places":
        from rhs_tasks.places.task import run_places_config

        return run_places_config(config, folder)
    if config.task == "unroll":
        from rhs_tasks.unroll.task import run_unroll_config

        return run_unroll_config(config, folder)
    keep_freed_memory()
    begin = time.perf_counter()
    world = furnished(load_world(config.world), config) if "driving" in config.source.settings.provides else None
    parts = build_parts(config, world, folder)
    parts.odometry = gated(parts.odometry, config.odometry.settings.needs, config.gate, parts.who["odometry"])
    row: dict[str, Any] = {"status": "ok", "reason": "", **identity(config), "commit": commit(), "versions": versions()}
    row["world"] = parts.source.facts.name if world is None else row["world"]
    notebook: Notebook | None = None
    cause: BaseException | None = None
    try:
        notebook = open_notebook(config, parts, world, folder, watch)
        survey = lead_round(parts, config, notebook)
        if config.task == "patrol" and "driving" in config.source.settings.provides:
            patrol(parts, config, survey, notebook)
    except BaseException as error:  # a plugin may raise anything, even exit; its run is a row with a reason
        cause = error
        row.update(outcome_of(error, notebook))
    cause = put_away(parts, notebook, row) or cause
    row.update(evaluate(folder))
    row.update(cost(begin, notebook))
    if "driving" not in config.source.settings.provides:
        row["world"] = parts.source.facts.name  # of the recording
    row["renderer"] = parts.source.renderer
    metric = sorted({"depth", "wheel"} & config.odometry.settings.needs)
    row["scale_from"] = parts.odometry.scale_from or " + ".join(metric)
    row["lost"] = parts.source.lost  # of a damaged recording
    write_row(folder, row)
    draw(config, folder)
    return row | {"_cause": cause}


def outcome_of(error: BaseException, notebook: Notebook | None) -> dict[str, str]:
    """Status and reason of a run that ended early: what, and where in the run, in one line."""
    at = f" at step {sum(notebook.counts.values())}" if notebook is not None else ""
    if not isinstance(error, Exception | SystemExit):
        return {"status": "interrupted", "reason": f"interrupted{at}"}
    return {"status": "failed", "reason": " ".join(f"{type(error).__name__}{at}: {error}".split())}


def put_away(parts: Parts, notebook: Notebook | None, row: dict[str, Any]) -> Exception | None:
    """Close the source and every file, each whatever became of the others; the first refusal fails the run."""
    closers: list[Callable[[], None]] = [parts.source.close]
    if notebook is not None:
        closers += [notebook.table.close, partial(notebook.recorder.close, row["status"], row["reason"])]
    first: Exception | None = None
    for close in closers:
        try:
            close()
        except Exception as error:
            first = first or error
    if first is not None and row["status"] == "ok":
        row.update(outcome_of(first, notebook))
    return first


def draw(config: RunConfig, folder: Path) -> None:
    """The overview picture, and the video if it was asked for."""
    from rhs.reports import report

    report.overview(folder)
    report.motion(folder)
    if config.mission.kidnap:
        report.knowing(folder)
    if config.video:
        report.video(folder)


def furnished(world: World, config: RunConfig) -> World:
    """The world with the obstacles of the command line, which the survey does not see."""
    boxes = tuple(Box(f"obstacle_{i + 1}", (x, y), (width, depth, OBSTACLE_HEIGHT_M))
                  for i, (x, y, width, depth) in enumerate(config.obstacles))
    return replace(world, obstacles=world.obstacles + boxes)


def lead_round(parts: Parts, config: RunConfig, notebook: Notebook) -> Survey:
    """Survey, settle, close the loop, draw the map; the files of the survey are written here."""
    from rhs.api.contracts import FeatureSettings
    from rhs.api.geometry import se2
    from rhs.estimation.views.features import features

    shared = FeatureSettings(config.features.count, config.features.contrast, config.features.ratio)
    collector = ViewCollector(config.places.every, shared, features)
    led = Led(se2(*parts.source.facts.start), parts.mapper)
    loop = steps(parts.source, parts.sensor, parts.odometry, led, who=parts.who)
    for _ in collector.watch(notebook.follow(loop, "survey", parts.source.views_expected)):
        pass
    if not collector.views:
        raise RhsError("the source handed out no view; expected at least one")
    begin = time.perf_counter()
    reach_m, who = reach_of(parts.source.facts), parts.who
    revised, walls = surveying.revise(collector.views, parts.odometry, who=who["odometry"], reach_m=reach_m)
    views, closure = surveying.close(revised, parts.loop_closer, who=who["loop_closer"], reach_m=reach_m)
    grid = surveying.draw(views, parts.mapper, who=who["mapper"])
    closing_ms = 1e3 * (time.perf_counter() - begin)
    stamps = np.array([view.stamp_s for view in views])
    write_tum(notebook.folder / "corrected.tum", Trajectory(stamps, closure.poses))
    save_map(notebook.folder / "map", grid)
    notebook.recorder.map(grid, float(stamps[-1]))
    if walls:
        write_json(notebook.folder / "walls.json", surveying.wall_rows(surveying.carried(walls, revised, closure)))
    write_json(notebook.folder / "closure.json", closure_rows(closure) | {"closing_ms": closing_ms})
    return Survey(views, closure, grid)


def patrol(parts: Parts, config: RunConfig, survey: Survey, notebook: Notebook) -> None:
    """Visit the places in order in the surveyed map."""
    facts = parts.source.facts
    free = surveying.known_free(survey.grid, survey.views, facts.robot_radius_m)
    parts.localiser.learn(survey.views, survey.grid)
    last = survey.views[-1]
    sure = np.clip(np.diag(last.covariance), 1e-6, START_VARIANCE)
    parts.localiser.start(Belief(last.map_from_body, np.diag(sure)))
    sentinel = Sentinel(parts.localiser, parts.planner, survey.grid, free, places=facts.places,
                        radius_m=facts.robot_radius_m, settings=turning(config.mission, parts.odometry), who=parts.who)
    if config.mission.kidnap:
        sentinel.kidnapper = Kidnapper(generator(config.seed, "kidnapper"), survey.views)
    loop = steps(parts.source, parts.sensor, parts.odometry, sentinel, first_index=len(survey.views),
                 after_s=last.stamp_s, who=parts.who)
    try:
        for step in notebook.follow(loop, "patrol", None):
            if "arrived" in step.event.split("+"):
                take_picture(step, sentinel, notebook.folder / "places")
    finally:
        write_json(notebook.folder / "missions.json", sentinel.book.to_rows())
        write_json(notebook.folder / "plans.json", [plan_row(number, plan) for number, plan in sentinel.plans])


def take_picture(step: Step, sentinel: Sentinel, folder: Path) -> None:
    """The picture the sentinel was sent for, named after the place."""
    from rhs.estimation.views.features import write_image

    arrived = [mission for mission in sentinel.book.missions if mission.status == "arrived"]
    if step.observation.image is not None:
        folder.mkdir(exist_ok=True)
        write_image(folder / f"{len(arrived):02d}_{arrived[-1].place}.png", step.observation.image)


def cost(begin: float, notebook: Notebook | None) -> dict[str, float]:
    """Wall time, memory, and how much faster than the robot the program was."""
    wall_s = time.perf_counter() - begin
    began = notebook is not None and notebook.began_s is not None
    robot_s = notebook.stamp_s - notebook.began_s if began else np.nan  # type: ignore[union-attr,operator]
    return {"wall_ms": 1e3 * wall_s, "real_time_factor": robot_s / wall_s,
            "peak_memory_mb": peak_memory_mb(),
            "views": sum(notebook.counts.values()) if notebook is not None else 0}
