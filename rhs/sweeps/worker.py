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
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.api.jit import on_compile
from rhs.base.commands import plain
from rhs.base.errors import ConfigError, RhsError
from rhs.base.processes import adopt_orphans, descendants, die_with_parent, kill, raises
from rhs.config.compose import from_plain
from rhs.config.loose import take_over
from rhs.metrics.success import with_success
from rhs.runfolder.folders import lock
from rhs.runfolder.row import sound, write_row

if TYPE_CHECKING:
    from rhs.patrol.shared import SharedSurvey

JOB_LOG = "job.log"
COMPILING = "compiling"  # said by a job that has to wait for the compiler


@dataclass(frozen=True)
class Task:
    """What a job's process is sent: its plain configuration, the columns that say what it is, and the plugins registered
    by hand where the sweep was started."""

    values: dict[str, Any]
    identity: dict[str, Any]
    plugins: list[dict[str, str]]


def work(task: Task, folder: str, lifeline: Connection, done: Connection, shared: SharedSurvey | None = None) -> None:
    """Run the job; `done` hears the number of the process that forked this one, and True when all is written. shared: the
    survey it begins with, led already."""
    done.send(os.getppid())
    settle_in(lifeline)
    redirect(os.path.join(folder, JOB_LOG), after=None if shared is None else str(shared.log.folder / JOB_LOG))
    held = lock(Path(folder))
    on_compile(lambda: done.send(COMPILING))
    try:
        cause = _run(task, Path(folder), shared)
        if cause is not None:
            traceback.print_exception(cause)
    except KeyboardInterrupt:
        pass
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os.close(held)
        done.send(True)


def _run(task: Task, folder: Path, shared: SharedSurvey | None) -> BaseException | None:
    """Whatever happens there is a row."""
    try:
        take_over(task.plugins)
        from rhs.patrol.run import run_config

        config = replace(from_plain(task.values), presets=task.identity.get("presets", ""))
        cause: BaseException | None = run_config(config, folder, shared=shared).pop("_cause", None)
        return cause
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        reason = str(error) if isinstance(error, RhsError) else f"{type(error).__name__}: {error}"
        status = "refused" if isinstance(error, ConfigError) else "failed"
        write_row(folder, sound(with_success({**task.identity, "status": status, "reason": plain(reason)})))
        return error


def settle_in(lifeline: Connection) -> None:
    """A session of its own, so that it can be ended with all it started; the parent decides when."""
    with contextlib.suppress(OSError):
        os.setsid()
    adopt_orphans()
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, raises(KeyboardInterrupt, once=True))
    threading.Thread(target=_die_with_sweep, args=(lifeline,), daemon=True).start()


def redirect(path: str, after: str | None = None) -> None:
    """What this process prints goes to a file, which begins with what is in the file `after`."""
    if after is not None:
        with contextlib.suppress(OSError):
            shutil.copyfile(after, path)
    log = os.open(path, os.O_WRONLY | os.O_CREAT | (os.O_TRUNC if after is None else os.O_APPEND), 0o644)
    sys.stdout.flush()
    for descriptor in (1, 2):
        os.dup2(log, descriptor)
    faulthandler.enable(2, all_threads=False)  # where a part crashed the process


def _die_with_sweep(lifeline: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        lifeline.recv()
    kill([*descendants(os.getpid()), os.getpid()])
