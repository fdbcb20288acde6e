"""One survey for several runs of a sweep that differ only in what comes after it.

A process leads the survey; a process forked from it for each run goes on as if it had led it itself (rhs.sweeps.leader).
Parts draw from generators of their own, spawned by name, so that no survey depends on the planner, localiser or replan
part built after it: rows are those of runs alone.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rhs.api.floorplan import World
from rhs.base.errors import RhsError
from rhs.base.memory import keep_freed_memory
from rhs.config.compose import OUTPUTS, RunConfig, to_plain
from rhs.runfolder.steps_csv import PARTIAL

from .job import PatrolJob, lead_survey
from .observers import unwatched
from .run import RunContext
from .shared_survey import LATER, Leading, SharedSurvey
from .tasks import Patrol, explores

AFTER = (*LATER, "mission", *(name for name in OUTPUTS if name != "recording"))  # what a survey does not depend on


def survey_key(config: RunConfig) -> str | None:
    """16 hex digits, the same for runs that begin with the same survey; None: of a run whose survey is not shared."""
    values = survey_values(config)
    return None if values is None else hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def survey_values(config: RunConfig) -> dict[str, Any] | None:
    """All settings that a survey depends on. None: of a run whose survey is not shared, because there is nothing after it,
    because a robot that explores asks its planner, or because its images are kept, for the recording or to compare places
    with."""
    if type(config.task.settings) is not Patrol or not config.driving:
        return None
    if config.recording not in ("light", "off") or config.pictures != "off" or explores(config.task.settings):
        return None
    return {name: value for name, value in to_plain(config).items() if name not in AFTER}


def lead_shared(config: RunConfig, folder: Path, building: World | None = None) -> SharedSurvey:
    """Lead the survey that a run of `config` begins with. building: where it was read already. Raises what the run would
    have ended with, and RhsError where the parts cannot be shared by fork."""
    keep_freed_memory()
    before = _held()
    parts = {kind: chosen for kind, chosen in config.parts.items() if kind not in LATER}
    context = RunContext(replace(config, parts=parts, recording="off", live=""), folder, unwatched, building=building)
    job: PatrolJob = config.task.settings.build(context)
    log = context.open_log(job.parts, job.world)
    leading = Leading(context, log, recorded=config.recording != "off")
    going = leading.follow(lead_survey(job.parts, context, job.settings, log))
    while True:
        try:
            next(going)
        except StopIteration as end:
            shared = leading.led(job.parts, job.ungated, end.value)
            break
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
        raise RhsError(f"the survey is not shared: its parts keep {threads - before[0]} threads and {sorted(more)} open")
