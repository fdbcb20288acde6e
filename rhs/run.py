"""One run as a list of verbs: compose, survey, close the loop, patrol, evaluate, write the row, draw."""

from __future__ import annotations

import json
import os
import resource
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from . import survey as surveying
from .compose import Parts, RunConfig, build_parts
from .errors import RhsError
from .maps import save_map
from .metrics import evaluate
from .patrol import Led, steps
from .provenance import provenance
from .recording import Recorder
from .records import Belief, Step
from .sentinel import Sentinel
from .steps import StepTable
from .survey import Survey, ViewCollector
from .table import write_row
from .trajectory import write_tum

Watch = Callable[[Iterable[Step], str, int | None], Iterable[Step]]


def unwatched(steps: Iterable[Step], phase: str, expected: int | None) -> Iterable[Step]:
    """The default watcher: looks away. A progress bar has the same signature."""
    return steps


@dataclass
class Notebook:
    """Everything of one run that listens to its steps: the table, the recording, the place pictures."""

    folder: Path
    table: StepTable
    recorder: Recorder
    watch: Watch
    counts: dict[str, int] = field(default_factory=dict)
    pictures: int = 0

    def follow(self, steps: Iterable[Step], phase: str, expected: int | None) -> Iterator[Step]:
        for step in self.watch(steps, phase, expected):
            self.table.add(step)
            self.recorder.step(step)
            self.counts[phase] = self.counts.get(phase, 0) + 1
            yield step

    def close(self) -> None:
        self.table.close()
        self.recorder.close()


def run_config(config: RunConfig, folder: Path, watch: Watch = unwatched) -> dict[str, Any]:
    """Run one experiment in `folder` and return its row, which is also written there whatever the outcome."""
    begin = time.perf_counter()
    row: dict[str, Any] = {"status": "ok", "reason": "", **provenance(config)}
    parts: Parts | None = None
    try:
        parts = build_parts(config, folder)
        notebook = Notebook(folder, StepTable(folder), recorder_of(config, parts, folder), watch)
        try:
            survey = lead_round(parts, config, notebook)
            if "driving" in parts.provides:
                patrol(parts, config, survey, notebook)
        finally:
            notebook.close()
    except RhsError as error:
        if error.exit_code == 2:
            raise
        row.update(status="failed", reason=f"{type(error).__name__}: {error}")
    except KeyboardInterrupt:
        row.update(status="interrupted", reason="interrupted by the user")
    except Exception as error:  # a plugin may raise anything; its run is a row with a reason
        row.update(status="failed", reason=f"{type(error).__name__}: {error}")
        row["_traceback"] = error
    finally:
        if parts is not None:
            parts.source.close()
    cause = row.pop("_traceback", None)
    row.update(evaluate(folder))
    row.update(cost(begin, notebook.counts if parts is not None else {}, row))
    write_row(folder, row)
    if cause is not None:
        row["_cause"] = cause
    return row


def recorder_of(config: RunConfig, parts: Parts, folder: Path) -> Recorder:
    return Recorder(folder / "run.mcap", config.recording, parts.source.camera, parts.source.facts)


def lead_round(parts: Parts, config: RunConfig, notebook: Notebook) -> Survey:
    """Survey, settle, close the loop, draw the map; the files of the survey are written here."""
    from .geometry import se2
    from .vision import features

    collector = ViewCollector(config.places.every, parts.features, features)
    led = Led(se2(*parts.source.facts.start), parts.mapper)
    loop = steps(parts.source, parts.sensor, parts.odometry, led)
    for _ in collector.watch(notebook.follow(loop, "survey", parts.source.views_expected)):
        pass
    if not collector.views:
        raise RhsError("the source handed out no view; expected at least one")
    views = surveying.revise(collector.views, parts.odometry)
    views, closure = surveying.close(views, parts.loop_closer)
    grid = surveying.draw(views, parts.mapper)
    stamps = np.array([view.stamp_s for view in views])
    write_tum(notebook.folder / "corrected.tum", stamps, closure.poses)
    save_map(notebook.folder / "map", grid)
    notebook.recorder.map(grid, float(stamps[-1]))
    write_json(notebook.folder / "closure.json", closure_rows(closure))
    return Survey(views, closure, grid)


def patrol(parts: Parts, config: RunConfig, survey: Survey, notebook: Notebook) -> None:
    """Visit the places in order in the surveyed map."""
    facts = parts.source.facts
    free = surveying.known_free(survey.grid, survey.views, facts.robot_radius_m)
    parts.localiser.learn(survey.views, survey.grid)
    last = survey.views[-1]
    parts.localiser.start(Belief(last.map_from_body, np.diag([1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-3])))
    sentinel = Sentinel(parts.localiser, parts.planner, survey.grid, free, places=facts.places,
                        radius_m=facts.robot_radius_m, settings=config.mission)
    loop = steps(parts.source, parts.sensor, parts.odometry, sentinel, first_index=len(survey.views))
    try:
        for step in notebook.follow(loop, "patrol", None):
            if "arrived" in step.event:
                take_picture(step, sentinel, notebook)
    finally:
        write_json(notebook.folder / "missions.json", sentinel.book.to_rows())
        write_json(notebook.folder / "plans.json", [plan_row(p["mission"], p["plan"]) for p in sentinel.plans])


def take_picture(step: Step, sentinel: Sentinel, notebook: Notebook) -> None:
    """The picture the sentinel was sent for, named after the place."""
    from .pictures import write_image

    arrived = [m for m in sentinel.book.missions if m.status == "arrived"]
    notebook.pictures += 1
    if step.observation.image is not None:
        name = f"{notebook.pictures:02d}_{arrived[-1].place}.png"
        write_image(notebook.folder / "places" / name, step.observation.image)


def closure_rows(closure) -> dict[str, Any]:
    edges = [{"earlier": e.earlier, "later": e.later, "inliers": e.inliers, "accepted": e.accepted, "reason": e.reason,
              "earlier_from_later": np.round(e.earlier_from_later, 9).tolist()} for e in closure.edges]
    return {"edges": edges, "details": dict(closure.details)}


def plan_row(mission: int, plan) -> dict[str, Any]:
    return {"mission": mission, "reason": str(plan.reason), "plan_ms": plan.plan_ms, "learn_ms": plan.learn_ms,
            "points_m": np.asarray(plan.points_m).tolist(), "raw_m": np.asarray(plan.raw_m).tolist()}


def cost(begin: float, counts: dict[str, int], row: dict[str, Any]) -> dict[str, float]:
    """Wall time, memory and how much faster than the robot the program was."""
    wall_s = time.perf_counter() - begin
    simulated = row.get("simulated_s", np.nan)
    return {"wall_ms": 1e3 * wall_s, "real_time_factor": simulated / wall_s,
            "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
            "views": float(sum(counts.values()))}


def write_json(path: Path, value: Any) -> None:
    """Written whole or not at all."""
    temporary = path.with_name(path.name + f".tmp-{os.getpid()}")
    temporary.write_text(json.dumps(value, indent=1, allow_nan=True) + "\n", encoding="utf-8")
    os.replace(temporary, path)
