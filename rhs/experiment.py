"""One run as a list of verbs: compose, survey, close the loop, patrol, evaluate, write the row, draw."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from . import survey as surveying
from .allocator import keep_freed_memory
from .compose import RunConfig, build_parts, identity, to_plain, write_config
from .errors import RhsError
from .files import replacing
from .floorplan import Box, World, truth_grid
from .gating import gated
from .kidnap import Kidnapper
from .live import Audience, Listener, LiveView
from .maps import save_map
from .metrics import evaluate
from .parts import Parts, generator
from .patrol import Led, steps
from .provenance import commit, peak_memory_mb, versions
from .recording import Recorder
from .records import Belief, Step
from .records import Path as Plan
from .rowfile import write_row
from .sentinel import Sentinel
from .steps import StepTable
from .survey import Survey, ViewCollector
from .trajectory import Trajectory, write_tum
from .world import load_world

OBSTACLE_HEIGHT_M = 1.8
START_VARIANCE = np.array([1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-3])  # of the belief a patrol begins with, if not better
Watch = Callable[[Iterable[Step], str, int | None], Iterable[Step]]


def unwatched(steps: Iterable[Step], phase: str, expected: int | None) -> Iterable[Step]:
    """The default watcher: looks away. A progress bar has the same signature."""
    return steps


@dataclass
class Notebook:
    """Everything of one run that listens to its steps: the table, the recording, the progress bar."""

    folder: Path
    table: StepTable
    recorder: Listener
    watch: Watch
    counts: dict[str, int] = field(default_factory=dict)
    began_s: float | None = None
    stamp_s: float = 0.0

    def follow(self, steps: Iterable[Step], phase: str, expected: int | None) -> Iterator[Step]:
        for step in self.watch(steps, phase, expected):
            self.table.add(step)
            self.recorder.step(step)
            self.counts[phase] = self.counts.get(phase, 0) + 1
            self.stamp_s = step.stamp_s
            self.began_s = step.stamp_s if self.began_s is None else self.began_s
            yield step


def run_config(config: RunConfig, folder: Path, watch: Watch = unwatched) -> dict[str, Any]:
    """Run one experiment in `folder` and return its row, which is also written there whatever the outcome.

    Raises ConfigError, before anything ran, for what can be refused. A failure later is a row with a reason; the
    exception that caused it is chained to the returned row under the key `_cause` and not written.
    """
    if config.task == "planning":
        from .planning_task import run_planning_config

        return run_planning_config(config, folder)
    if config.task == "places":
        from .places_task import run_places_config

        return run_places_config(config, folder)
    if config.task == "unroll":
        from .unroll_task import run_unroll_config

        return run_unroll_config(config, folder)
    keep_freed_memory()
    begin = time.perf_counter()
    world = furnished(load_world(config.world), config) if "driving" in config.source.settings.provides else None
    parts = build_parts(config, world, folder)
    parts.odometry = gated(parts.odometry, config.odometry.settings.needs, config.gate)
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
    row["renderer"] = getattr(parts.source, "renderer", "")
    metric = sorted({"depth", "wheel"} & config.odometry.settings.needs)
    row["scale_from"] = getattr(parts.odometry, "scale_from", " + ".join(metric))
    row["lost"] = getattr(parts.source, "lost", "")  # of a damaged recording
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
    from . import report

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


def open_notebook(config: RunConfig, parts: Parts, world: World | None, folder: Path, watch: Watch) -> Notebook:
    """The run's files that grow with its steps, and the true plan beside them for the judge."""
    write_config(config, folder)
    facts = parts.source.facts
    places = [{"name": n, "x_m": x, "y_m": y} for n, x, y in facts.places]
    write_json(folder / "facts.json", {"name": facts.name, "start": list(facts.start), "places": places,
                                       "bounds_m": list(facts.bounds_m), "robot_radius_m": facts.robot_radius_m})
    if world is not None:
        save_map(folder / "true_map", truth_grid(world))
        if world.obstacles:
            save_map(folder / "true_map_patrol", truth_grid(world, with_obstacles=True))
    level = "full" if config.recording == "auto" else config.recording
    listeners: list[Listener] = [Recorder(folder / "run.mcap", level, parts.source.camera, facts, config=to_plain(config))]
    if config.live:
        listeners.append(LiveView(config.live, parts.source.camera, facts.name))
    return Notebook(folder, StepTable(folder), Audience(listeners), watch)


def lead_round(parts: Parts, config: RunConfig, notebook: Notebook) -> Survey:
    """Survey, settle, close the loop, draw the map; the files of the survey are written here."""
    from .contracts import FeatureSettings
    from .geometry import se2
    from .vision import features

    shared = FeatureSettings(config.features.count, config.features.contrast, config.features.ratio)
    collector = ViewCollector(config.places.every, shared, features)
    led = Led(se2(*parts.source.facts.start), parts.mapper)
    loop = steps(parts.source, parts.sensor, parts.odometry, led)
    for _ in collector.watch(notebook.follow(loop, "survey", parts.source.views_expected)):
        pass
    if not collector.views:
        raise RhsError("the source handed out no view; expected at least one")
    begin = time.perf_counter()
    revised, walls = surveying.revise(collector.views, parts.odometry)
    views, closure = surveying.close(revised, parts.loop_closer)
    grid = surveying.draw(views, parts.mapper)
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
                        radius_m=facts.robot_radius_m, settings=config.mission)
    if config.mission.kidnap:
        sentinel.kidnapper = Kidnapper(generator(config.seed, "kidnapper"), survey.views)
    loop = steps(parts.source, parts.sensor, parts.odometry, sentinel, first_index=len(survey.views))
    try:
        for step in notebook.follow(loop, "patrol", None):
            if "arrived" in step.event.split("+"):
                take_picture(step, sentinel, notebook.folder / "places")
    finally:
        write_json(notebook.folder / "missions.json", sentinel.book.to_rows())
        write_json(notebook.folder / "plans.json", [plan_row(number, plan) for number, plan in sentinel.plans])


def take_picture(step: Step, sentinel: Sentinel, folder: Path) -> None:
    """The picture the sentinel was sent for, named after the place."""
    from .vision import write_image

    arrived = [mission for mission in sentinel.book.missions if mission.status == "arrived"]
    if step.observation.image is not None:
        folder.mkdir(exist_ok=True)
        write_image(folder / f"{len(arrived):02d}_{arrived[-1].place}.png", step.observation.image)


def closure_rows(closure) -> dict[str, Any]:
    edges = [{"earlier": e.earlier, "later": e.later, "inliers": e.inliers, "accepted": e.accepted, "reason": e.reason,
              "earlier_from_later": np.round(e.earlier_from_later, 9).tolist()} for e in closure.edges]
    return {"edges": edges, "details": dict(closure.details)}


def plan_row(mission: int, plan: Plan) -> dict[str, Any]:
    return {"mission": mission, "reason": str(plan.reason), "plan_ms": plan.plan_ms, "learn_ms": plan.learn_ms,
            "points_m": np.asarray(plan.points_m).tolist(), "raw_m": np.asarray(plan.raw_m).tolist()}


def cost(begin: float, notebook: Notebook | None) -> dict[str, float]:
    """Wall time, memory, and how much faster than the robot the program was."""
    wall_s = time.perf_counter() - begin
    began = notebook is not None and notebook.began_s is not None
    robot_s = notebook.stamp_s - notebook.began_s if began else np.nan  # type: ignore[union-attr,operator]
    return {"wall_ms": 1e3 * wall_s, "real_time_factor": robot_s / wall_s,
            "peak_memory_mb": peak_memory_mb(),
            "views": sum(notebook.counts.values()) if notebook is not None else 0}


def write_json(path: Path, value: Any) -> None:
    """Written whole or not at all."""
    with replacing(path) as file:
        file.write(json.dumps(value, indent=1) + "\n")
