"""One job of a sweep, in the process that is its own: what it prints goes to job.log, what becomes of it to row.json."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rhs.base.commands import plain
from rhs.base.errors import ConfigError, RhsError
from rhs.base.processes import adopt_orphans, descendants, die_with_parent, kill
from rhs.config.compose import from_plain, identity
from rhs.config.loose import load_files
from rhs.metrics.success import with_success
from rhs.runfolder.folders import lock
from rhs.runfolder.row import sound, write_row


def work(values: dict[str, Any], folder: str, lifeline: Connection, done: Connection, plugin_files: Sequence[str]) -> None:
    """Run the job; `done` hears the number of the process that forked this one, and True when all is written."""
    done.send(os.getppid())
    _settle_in(lifeline)
    _redirect(os.path.join(folder, "job.log"))
    held = lock(Path(folder))
    try:
        load_files(plugin_files, [f"{kind}={node['name']}" for kind, node in values.items() if _is_part(node)])
        cause = _run(values, Path(folder))
        if cause is not None:
            traceback.print_exception(cause)
    except KeyboardInterrupt:
        pass
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os.close(held)
        done.send(True)


def _is_part(node: object) -> bool:
    return isinstance(node, dict) and "name" in node


def _run(values: dict[str, Any], folder: Path) -> BaseException | None:
    """Whatever happens there is a row."""
    config = from_plain(values)
    try:
        from rhs.patrol.run import run_config

        cause: BaseException | None = run_config(config, folder).pop("_cause", None)
        return cause
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        reason = str(error) if isinstance(error, RhsError) else f"{type(error).__name__}: {error}"
        status = "refused" if isinstance(error, ConfigError) else "failed"
        write_row(folder, sound(with_success({**identity(config), "status": status, "reason": plain(reason)})))
        return error


def _settle_in(lifeline: Connection) -> None:
    """A session of its own, so that it can be ended with all it started; the parent decides when."""
    with contextlib.suppress(OSError):
        os.setsid()
    adopt_orphans()
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _interrupt)
    threading.Thread(target=_die_with_sweep, args=(lifeline,), daemon=True).start()


def _redirect(path: str) -> None:
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    sys.stdout.flush()
    for descriptor in (1, 2):
        os.dup2(log, descriptor)


def _interrupt(number: int, frame: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


def _die_with_sweep(lifeline: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        lifeline.recv()
    kill([*descendants(os.getpid()), os.getpid()])
