"""One survey for several runs of a sweep that differ only in what comes after it.

A process leads the survey; a process forked from it for each run goes on as if it had led it itself (rhs.sweeps.leader).
Parts draw from generators of their own, spawned by name, so that no survey depends on the planner, localiser or replan
part built after it: rows are those of runs alone. And one set of views for several surveys that differ in their odometry,
loop closer or mapper, where the way of a survey depends on no estimate.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rhs.api.contracts import DEGRADE, SLAM
from rhs.api.floorplan import World
from rhs.api.records import Observation
from rhs.base.errors import RhsError
from rhs.base.memory import keep_freed_memory
from rhs.config.compose import OUTPUTS, RunConfig, to_plain
from rhs.runfolder.steps_csv import PARTIAL

from .eyes import Eyes, Looked, looks_ahead, settled
from .job import PatrolJob, lead_survey, world_of
from .loop import end_of
from .observers import unwatched
from .run import RunContext
from .shared_survey import LATER, DrawnViews, SharedSurvey, led_for_others
from .tasks import Patrol, Survey, explores

AFTER = (*LATER, "mission", *(name for name in OUTPUTS if name != "recording"))  # what a survey does not depend on

ESTIMATING = ("odometry", "loop_closer", "mapper", "gate", "places", "camera_fit")  # nor its views, if it is led
MOST_MB = 600  # of views at a time


def survey_key(config: RunConfig) -> str | None:
    """16 hex digits, the same for runs that begin with the same survey; None: of a run whose survey is not shared."""
    values = survey_values(config)
    return None if values is None else _key(values)


def _key(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def survey_values(config: RunConfig) -> dict[str, Any] | None:
    """All settings that a survey depends on. None: of a run whose survey is not shared, because there is nothing after it,
    because a robot that explores asks its planner, or because its images are kept, for the recording or to compare places
    with."""
    if type(config.task.settings) is not Patrol or not config.driving:
        return None
    if config.recording not in ("light", "off") or config.pictures != "off" or explores(config.task.settings):
        return None
    return {name: value for name, value in to_plain(config).items() if name not in AFTER}


def views_key(config: RunConfig) -> str | None:
    """16 hex digits, the same for runs whose survey shows the same views; None: of a run that does not share them, because a
    recording's are read, what an explorer sees depends on its estimates, or a SLAM is in the place of several parts."""
    settings = config.task.settings
    if type(settings) not in (Survey, Patrol) or not config.driving or explores(settings) or SLAM in config.parts:
        return None
    return _key({name: value for name, value in to_plain(config).items() if name not in (*AFTER, *ESTIMATING, "recording")})


def draw_views(config: RunConfig, folder: Path, building: World | None = None) -> DrawnViews:
    """The views of the survey that a run of `config` begins with. building: where it was read already. Raises what its
    source or sensor does, and RhsError where their views cannot be shared."""
    keep_freed_memory()
    before = _held()
    kinds = {kind: chosen for kind, chosen in config.parts.items() if kind in ("source", "sensor", DEGRADE)}
    context = RunContext(replace(config, parts=kinds, live=""), folder, unwatched, building=building)
    context.building = context.floor_plan()  # for the runs, too
    parts = context.parts(world=world_of(config.task.settings, context))
    if not looks_ahead("on", parts.source, parts.sensor):
        raise RhsError("its source or sensor wants to be asked view by view")
    eyes = Eyes(parts.source, parts.sensor, parts.who)
    seen: list[Looked] = []
    while (looked := eyes(parts.source.lead)) is not None:
        capture = replace(looked.capture, image=None, depth=None, scan=None, extras={})
        seen.append(replace(looked, capture=capture, judged=settled(looked.judged)[0]))
        size_mb = 1e-6 * _bytes(looked.observation) * max(len(seen), parts.source.views_expected or 0)
        if size_mb > MOST_MB:
            raise RhsError(f"{size_mb:.0f} MB of views are too many to be kept")
    if drawn := context.drawn():
        raise RhsError(f"its source or sensor draws from the global generator of {' and '.join(sorted(drawn))}")
    _check_forkable(before, folder)
    return DrawnViews(parts, seen, context.building, time.perf_counter() - context.began_s)


def _bytes(observation: Observation) -> int:
    """What its arrays take."""
    arrays = [observation.image, observation.depth, *observation.extras.values()]
    if observation.scan is not None:
        arrays += [observation.scan.ranges_m, observation.scan.bearings_rad]
    return sum(array.nbytes for array in arrays if array is not None)


def lead_shared(config: RunConfig, folder: Path, building: World | None = None, drawn: DrawnViews | None = None,
                ) -> SharedSurvey:
    """Lead the survey that a run of `config` begins with. building: where it was read already. drawn: its views, where they
    were. Raises what the run would have ended with, and RhsError where the parts cannot be shared by fork."""
    keep_freed_memory()
    before = _held()
    parts = {kind: chosen for kind, chosen in config.parts.items() if kind not in LATER}
    context = RunContext(replace(config, parts=parts, recording="off", live=""), folder, unwatched, building=building,
                         drawn=drawn)
    job: PatrolJob = config.task.settings.build(context)
    log = context.open_log(job.parts, job.world)
    shared: SharedSurvey = end_of(led_for_others(lead_survey(job.parts, context, job.settings, log), job.parts, context, log,
                                                 ungated=job.ungated, recorded=config.recording != "off"))
    _check_forkable(before, folder)
    return shared


def _held() -> tuple[int, set[str]]:
    """Threads of this process, and its open files."""
    files = set()
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            files.add(f"{name} {os.readlink(f'/proc/self/fd/{name}')}")
    return len(os.listdir("/proc/self/task")), files


def _check_forkable(before: tuple[int, set[str]], folder: Path) -> None:
    """Raise RhsError where a part holds what forked processes cannot have each: a thread, a connection, a device, an open
    file with one place in it. The file of the views (rhs.estimation.kept_views) has no name, and is read anywhere."""
    threads, files = _held()
    nameless = str(folder.resolve())
    more = {file for file in files - before[1] if not file.endswith("/fd") and PARTIAL not in file
            and not (nameless in file and file.endswith("(deleted)"))}
    if threads > before[0] or more:
        raise RhsError(f"not shared: its parts keep {threads - before[0]} threads and {sorted(more)} open")
