"""One job of a sweep, in the process that is its own: what it prints goes to job.log, what becomes of it to row.json."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import shutil
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.api.jit import on_compile
from rhs.base.commands import plain
from rhs.base.errors import ConfigError, RhsError
from rhs.base.processes import adopt_orphans, descendants, die_with_parent, kill, raises
from rhs.config.compose import RunConfig, from_plain
from rhs.config.loose import take_over
from rhs.metrics.success import with_success
from rhs.runfolder.folders import lock
from rhs.runfolder.row import sound, write_row

if TYPE_CHECKING:
    from rhs.api.floorplan import World
    from rhs.patrol.shared import DrawnViews, SharedSurvey

JOB_LOG = "job.log"
COMPILING = "compiling"  # said by a job that has to wait for the compiler
KEPT = "kept"  # and by one whose survey an earlier sweep led


@dataclass(frozen=True)
class Task:
    """What a job's process is sent: its plain configuration, the columns that say what it is, the plugins registered by
    hand where the sweep was started, and whether surveys are kept for other sweeps."""

    values: dict[str, Any]
    identity: dict[str, Any]
    plugins: list[dict[str, str]]
    cache: bool = False


def work(task: Task, folder: str, lifeline: Connection, done: Connection,
         begun: SharedSurvey | DrawnViews | None = None) -> None:
    """Run the job; `done` hears the number of the process that forked this one, and True when all is written. begun: the
    survey it begins with, led already, or its views, drawn already."""
    done.send(os.getppid())
    settle_in(lifeline)
    redirect(os.path.join(folder, JOB_LOG))
    held = lock(Path(folder))
    on_compile(lambda: done.send(COMPILING))
    try:
        cause = _run(task, Path(folder), begun, told=lambda: done.send(KEPT))
        if cause is not None:
            traceback.print_exception(cause)
    except KeyboardInterrupt:
        pass
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os.close(held)
        done.send(True)


def _run(task: Task, folder: Path, begun: SharedSurvey | DrawnViews | None, told: Callable[[], None],
         ) -> BaseException | None:
    """Whatever happens there is a row. told: a survey was kept."""
    try:
        take_over(task.plugins)
        from rhs.patrol.run import run_config
        from rhs.patrol.shared import DrawnViews

        config = replace(from_plain(task.values), presets=task.identity.get("presets", ""))
        drawn = begun if isinstance(begun, DrawnViews) else None
        shared = None if isinstance(begun, DrawnViews) else begun
        keep, building = None, None if drawn is None else drawn.building
        if shared is None and task.cache:
            shared, keep, building = kept_survey(config, folder / JOB_LOG, told, building)
        if shared is not None:
            sys.stderr.write(shared.said)
        row = run_config(config, folder, shared=shared, keep=keep, building=building, drawn=drawn)
        if row["status"] == "failed" and shared is not None and shared.kept:  # is it because of where the survey comes from?
            sys.stderr.write(f"{row['reason']}; the survey was that of an earlier sweep, it is led anew\n")
            empty(folder)
            row = run_config(config, folder)
        cause: BaseException | None = row.pop("_cause", None)
        return cause
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        reason = str(error) if isinstance(error, RhsError) else f"{type(error).__name__}: {error}"
        status = "refused" if isinstance(error, ConfigError) else "failed"
        write_row(folder, sound(with_success({**task.identity, "status": status, "reason": plain(reason)})))
        return error


def kept_survey(config: RunConfig, log: Path, told: Callable[[], None], building: World | None = None,
                ) -> tuple[SharedSurvey | None, Callable[[SharedSurvey], None] | None, World | None]:
    """The survey that an earlier sweep led, which is told, or what keeps the one to be led, with what is in the log by
    then. And the building, where it was read; building: where it was already."""
    from . import survey_cache

    building = building or survey_cache.building_read(config)
    key = survey_cache.key_of(config, building)
    if key is None:
        return None, None, building
    if (shared := survey_cache.load(key)) is not None:
        told()
        return shared, None, building
    return None, lambda led: survey_cache.keep(key, config, replace(led, said=log_text(log))), building


def empty(folder: Path) -> None:
    """Delete what a run wrote, but for the log."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name != JOB_LOG and not path.name.startswith("."):
            path.unlink()


def log_text(log: Path) -> str:
    """What this process has printed."""
    sys.stdout.flush()
    sys.stderr.flush()
    return log.read_text("utf-8", "replace")


def settle_in(lifeline: Connection) -> None:
    """A session of its own, so that it can be ended with all it started; the parent decides when."""
    with contextlib.suppress(OSError):
        os.setsid()
    adopt_orphans()
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, raises(KeyboardInterrupt, once=True))
    threading.Thread(target=_die_with_sweep, args=(lifeline,), daemon=True).start()


def redirect(path: str) -> None:
    """What this process prints goes to a file."""
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    sys.stdout.flush()
    for descriptor in (1, 2):
        os.dup2(log, descriptor)
    faulthandler.enable(2, all_threads=False)  # where a part crashed the process


def _die_with_sweep(lifeline: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        lifeline.recv()
    kill([*descendants(os.getpid()), os.getpid()])
