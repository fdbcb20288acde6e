"""A job under way, and how it ends: over its limits, told to stop, gone; nothing is left of it but its row."""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
import signal
import sysconfig
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rhs.base.errors import RhsError
from rhs.base.processes import children, kill_group, kill_strays, resident_bytes
from rhs.config.compose import identity
from rhs.metrics.success import with_success
from rhs.runfolder.row import KILLED, RUNNING, read_row, sound, write_row

from .job import Job, Limits
from .leader import READY
from .turns import Group
from .worker import COMPILING, JOB_LOG, KEPT

FULL_MB = 1.0  # a disk with less is full
GRACE_S = 10.0  # a job told to stop has so long to write down what it has
LINGER_S = 2.0  # a job that has written its row has so long to end


@dataclass
class Running:
    """done: hears the server's process number, and True when the row is written. group: of a job that shares its survey.
    leads: the process is not the job's, it leads its survey, or draws its views: then the job goes on with group `then`."""

    job: Job
    folder: Path
    process: Any
    done: Connection
    started: float
    group: Group | None = None
    leads: bool = False
    then: Group | None = None
    verdict: tuple[str, str] | None = None  # why it was told to stop: status and reason
    told: float = 0.0
    server: int = 0
    written: float = 0.0  # when it said so
    compiling: bool = False
    kept: bool = False  # its survey was that of an earlier sweep


LOST = "the process was lost: it, or the one that starts the jobs, was killed"
TOO_MUCH = "took more memory than"


def over(one: Running, limits: Limits) -> bool:
    """Whether the job has ended, or has been given all the time it gets to do so; one over its limits is told to stop.
    The survey of several jobs is over when it is led, too."""
    _hear(one)
    now = time.monotonic()
    if (one.leads and one.group is not None and one.group.ready) or not one.process.is_alive():
        return True
    if not one.verdict and limits.timeout_s and now - one.started > limits.timeout_s:
        one.verdict, one.told = ("timeout", f"took longer than the {limits.timeout_s:g} s of --timeout"), now
        one.process.terminate()
    if not one.verdict and resident_bytes(one.process.pid) > limits.memory_bytes:
        one.verdict = ("killed", f"{TOO_MUCH} the {limits.memory_bytes / 2**20:.0f} MB of --memory-mb")
        return True
    return bool(one.verdict and now - one.told > GRACE_S) or bool(one.written and now - one.written > LINGER_S)


def _hear(one: Running) -> None:
    """What its process has said."""
    with contextlib.suppress(EOFError, OSError):
        while one.done.poll():
            said = one.done.recv()
            if said == COMPILING:
                one.compiling = True
            elif said == KEPT:
                one.kept = True
            elif said == READY and one.group is not None:
                one.group.ready = True
                return
            elif said is True:
                one.written = time.monotonic()
            else:
                one.server = int(said)


def ended(one: Running, keep: Sequence[int]) -> None:
    """Kill the job if it still runs, all that it started, and what its orphans became."""
    pid = one.process.pid
    with contextlib.suppress(EOFError, OSError):
        while not one.server and one.done.poll():
            one.server = int(one.done.recv())
    if one.process.is_alive():
        kill_group(pid)
    else:
        with contextlib.suppress(OSError):
            os.killpg(pid, signal.SIGKILL)  # its group outlives it, and its number is not given away meanwhile
    one.process.join(GRACE_S)
    known = [group for group in (one.group, one.group and one.group.views) if group is not None and group.alive]
    if one.server in [group.process.pid for group in known] or one.server in children(os.getpid()):
        kill_strays(one.server, keep)


def row_of(one: Running) -> tuple[str, str]:
    """Status and reason of a job that is gone. One that left no final row gets it here."""
    path, code = one.folder / "row.json", one.process.exitcode
    if not one.leads:
        one.process.close()
        one.done.close()
    try:
        row = read_row(path)
    except RhsError:
        row = {}
    status = str(row.get("status", RUNNING))
    if status in (RUNNING, KILLED):
        status, reason = one.verdict or _fate(code, one.folder)
    elif one.verdict and one.verdict[0] != "interrupted" and status != "ok":
        status, reason = one.verdict
    else:
        return status, shortfall(row) if status == "ok" else str(row.get("reason") or "")
    write_last(one.job, one.folder, status, reason, row)
    return status, reason


def write_last(job: Job, folder: Path, status: str, reason: str, row: Mapping[str, object] | None = None) -> None:
    """The row of a job that wrote none itself, or only its first (row)."""
    folder.mkdir(parents=True, exist_ok=True)
    columns = {name: value for name, value in (row or {}).items() if name not in ("pid", "started")}
    row = with_success({**identity(job.config), **columns, "status": status, "reason": reason})
    write_row(folder, sound(row))


def _fate(code: int | None, folder: Path) -> tuple[str, str]:
    if code is None or code == 255:  # what multiprocessing says when it lost sight of the process
        return "killed", LOST
    if code < 0:
        with contextlib.suppress(ValueError):
            return "killed", f"the process was killed by {signal.Signals(-code).name}{_crashed_in(folder)}"
        return "killed", f"the process was killed by signal {-code}"
    full = free_mb(folder) < FULL_MB
    return "failed", (f"the process ended with exit code {code} before it wrote a row; see job.log"
                      + ("; no space is left on the disk: free some, then --resume" if full else ""))


def free_mb(folder: Path) -> float:
    """Of the disk that a folder is on; infinity where nobody tells."""
    with contextlib.suppress(OSError):
        return shutil.disk_usage(folder if folder.exists() else folder.parent).free / 1e6
    return math.inf


def _crashed_in(folder: Path) -> str:
    """` in file:line` of the first frame outside of Python's own library that faulthandler wrote; empty without one."""
    with contextlib.suppress(OSError):
        _, crash, frames = (folder / JOB_LOG).read_text("utf-8", "replace").rpartition("Fatal Python error")
        for file, line in re.findall(r'^  File "(.+)", line (\d+) in', frames if crash else "", re.MULTILINE):
            path = Path(file)
            if "site-packages" in path.parts or not path.is_relative_to(sysconfig.get_path("stdlib")):
                return f" in {path.parent.name}/{path.name}:{line}"
    return ""


def shortfall(row: Mapping[str, object]) -> str:
    """What a run that ended well was asked for and did not do; empty where nothing is missing."""
    if row.get("lost"):
        return f"lost: {row['lost']}"
    return f"not achieved: {row.get('failure', '')}" if row.get("success") == 0 else ""
