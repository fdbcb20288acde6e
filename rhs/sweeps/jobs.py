"""Sweeps: every combination in a fresh process of its own, so that a crash, a kill or a hang costs one job.

Jobs are forked from a clean server process that has loaded the libraries once (multiprocessing's forkserver). A job is
done when its folder holds a final row.json; a job that cannot write its own row gets one from here, so that rows always
equal jobs. Statuses: ok, failed, refused, timeout, killed, interrupted; jobs never started are counted as skipped.

A job has a session of its own. When it is over, whatever it started is killed with it: its process group, and the orphans
that fell to the server (rhs.base.processes).
"""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import ModuleType
from typing import Any

from rhs.base.errors import RhsError
from rhs.base.processes import (
    SWEEP_PATH,
    THREADS,
    children,
    kill_group,
    kill_strays,
    resident_bytes,
    total_memory_mb,
)
from rhs.config.compose import RunConfig, identity, to_plain
from rhs.config.loose import carried
from rhs.metrics.success import with_success
from rhs.runfolder.folders import job_folder
from rhs.runfolder.row import KILLED, RUNNING, read_row, sound, write_row

from .worker import COMPILING, Task, work

GRACE_S = 10.0  # a job told to stop has so long to write down what it has
LINGER_S = 2.0  # a job that has written its row has so long to end
MEMORY_MB = 4096.0  # of one job, where the machine has as much for each
MOST_NAMED = 2_000  # jobs and reasons remembered by name
# Loaded once in the server, for every job: what all runs need. Nothing here starts threads or draws random numbers.
PRELOAD = ["rhs.patrol.run", "rhs.patrol.job", "rhs.estimation.views.features", "cv2", "numba", "scipy.ndimage",
           "scipy.spatial.transform", "rosbags.typesys", "mcap.writer", "matplotlib.backends.backend_agg",
           "matplotlib.figure", "rhs.metrics.judge_kernels", "rhs.metrics.planning", "rhs.estimation.paths.shorten",
           "rhs.sweeps.server"]


@dataclass(frozen=True)
class Job:
    """One run of a sweep: its folder's name (readable values and config hash), its configuration, its words."""

    name: str
    config: RunConfig
    words: tuple[str, ...]
    varied: Mapping[str, Any] = field(default_factory=dict)  # settings that the sweep varies, as columns of the table

    @property
    def key(self) -> str:
        """The hash of the configuration, by which a job is known again."""
        return self.name.rpartition("_")[2]


def processes() -> int:
    """Processes at a time when nothing is said: one per core this process may use."""
    return len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Limits:
    """jobs: processes at a time. timeout_s: per job, 0 for none. same_failures: stop after so many alike, 0 never.
    memory_mb: of a job and what it starts, 0 for 4096 or its share of the machine. retries: of a job that was killed."""

    jobs: int = 1
    timeout_s: float = 3600.0
    same_failures: int = 0
    memory_mb: float = 0.0
    retries: int = 1

    @property
    def memory_bytes(self) -> float:
        return 2**20 * (self.memory_mb or min(MEMORY_MB, 0.9 * total_memory_mb() / self.jobs))


@dataclass
class Outcome:
    """What became of the jobs of a sweep; jobs that were never started are missing."""

    counts: Counter = field(default_factory=Counter)  # jobs by status
    status: dict[str, str] = field(default_factory=dict)  # by name, of the first MOST_NAMED
    reasons: Counter = field(default_factory=Counter)
    stopped: str = ""  # why not every job was started
    workers: int | None = None  # alive, where somebody knows

    def count(self, name: str, status: str, reason: str) -> None:
        """Take in one job that is over."""
        self.counts[status] += 1
        if len(self.status) < MOST_NAMED:
            self.status[name] = status
        told = f"{status}: {reason}" if status != "ok" else f"ok, but {reason}"
        if status != "ok" or reason:  # it ended, without what was asked of it
            self.reasons[told if told in self.reasons or len(self.reasons) < MOST_NAMED else "other reasons"] += 1


@dataclass
class _Running:
    job: Job
    folder: Path
    process: Any
    done: Connection  # hears the server's process number, and True when the row is written
    started: float
    verdict: tuple[str, str] | None = None  # why it was told to stop: status and reason
    told: float = 0.0
    server: int = 0
    written: float = 0.0  # when it said so
    compiling: bool = False


def run_jobs(jobs: Iterable[Job], sweep: Path, limits: Limits, *, tell: Callable[[Job, str], None],
             preload: Sequence[str] = (), outcome: Outcome | None = None) -> Outcome:
    """Run the jobs in folders under `sweep`, taking the next one when it may start; `tell(job, status)` after each.
    preload: what `asked_for` says of them. outcome: to be added to. Ctrl-C once: what runs is asked to finish its files;
    twice: it is killed. Either way the exception is raised again when all processes are gone."""
    pool = _Pool(iter(jobs), sweep, limits, tell)
    pool.outcome = outcome or pool.outcome
    pool.context.set_forkserver_preload([*PRELOAD, *preload])
    try:
        while True:
            pool.fill()
            if not pool.running:
                break
            wait([one.process.sentinel for one in pool.running], timeout=0.2)
            pool.collect()
            pool.outcome.stopped = alike(pool.outcome, limits.same_failures)
    except (KeyboardInterrupt, Exception):
        pool.stop()
        raise
    finally:
        pool.close()
    return pool.outcome


def asked_for(jobs: Sequence[Job]) -> list[str]:
    """The modules that the jobs' plugins ask to be loaded once for all of them (rhs.contracts.Plugin.preload)."""
    chosen = {type(part.settings) for job in jobs for part in [job.config.task, *job.config.parts.values()]}
    return sorted({name for settings in chosen for name in getattr(settings, "preload", ())})


class _Pool:
    """The jobs that wait and those that run."""

    def __init__(self, coming: Iterator[Job], sweep: Path, limits: Limits, tell: Callable[[Job, str], None]) -> None:
        self.coming, self.sweep, self.limits, self.tell = coming, sweep, limits, tell
        self.next: list[Job] = []  # to be started before what comes
        self.last: list[Job] = []  # and after it
        self.running: list[_Running] = []
        self.left = _left_by_key(sweep)
        self.outcome = Outcome()
        self.compiling = False
        self.tries: Counter = Counter()
        self.suspects: set[str] = set()  # ran when the server was killed: they are tried again, last and alone
        self.context = multiprocessing.get_context("forkserver")
        self.lifeline, self.our_end = self.context.Pipe(duplex=False)  # breaks when this process dies: the jobs end with it

    def fill(self) -> None:
        """Start as many as may run."""
        while len(self.running) < self.limits.jobs and not self.outcome.stopped and self._look_ahead():
            if self.running and self.suspects & {self.next[-1].name, *(one.job.name for one in self.running)}:
                return
            job = self.next.pop()
            self.tries[job.name] += 1
            try:
                self.running.append(self._start(job))
            except (OSError, EOFError, RhsError) as error:  # no room on the disk, or the server was killed just now
                self._conclude(job, "killed", f"it could not be started: {type(error).__name__}: {error}")

    def _look_ahead(self) -> bool:
        """Whether there is a job to start; it is the last of `next`."""
        if not self.next:
            self.next.extend(itertools.islice(self.coming, 1))
        if not self.next and self.last:
            self.next.append(self.last.pop(0))
        return bool(self.next)

    def _start(self, job: Job) -> _Running:
        folder = job_folder(self.sweep, job.name)
        for earlier in {folder, *self.left.pop(job.key, ())}:  # what an earlier attempt left
            shutil.rmtree(earlier, ignore_errors=True)
        folder.mkdir(parents=True)
        ours, theirs = self.context.Pipe(duplex=False)
        chosen = {(kind, one.name) for kind, one in {"task": job.config.task, **job.config.parts}.items()}
        task = Task(to_plain(job.config), identity(job.config), carried(chosen))
        arguments = (task, str(folder), self.lifeline, theirs)
        process = self.context.Process(target=work, args=arguments, daemon=False)
        with _as_on_the_command_line():
            process.start()
        theirs.close()
        return _Running(job, folder, process, ours, time.monotonic())

    def collect(self) -> None:
        """Take in those that are over."""
        for one in [one for one in self.running if _over(one, self.limits)]:
            self.running.remove(one)
            self._settle(one)
        for one in [one for one in self.running if one.compiling][: not self.compiling]:
            self.compiling = True
            self.tell(one.job, COMPILING)

    def stop(self) -> None:
        """Ask all to stop and wait for their files; a second Ctrl-C kills them."""
        self.coming, self.next, self.last = iter(()), [], []
        try:
            for one in self.running:
                one.verdict = one.verdict or ("interrupted", "interrupted")
                one.process.terminate()
            end = time.monotonic() + GRACE_S
            for one in self.running:
                one.process.join(max(0.0, end - time.monotonic()))
        finally:
            for one in self.running:
                self._settle(one)

    def close(self) -> None:
        self.our_end.close()
        self.lifeline.close()

    def _settle(self, one: _Running) -> None:
        """See that nothing is left of the job but its row, and count it. Raises nothing, whatever the job did."""
        _end(one, keep=[other.process.pid for other in self.running])
        try:
            status, reason = _row_of(one)
        except Exception as error:  # a disk that is full, a folder that is no folder any more
            status, reason = "failed", f"its row cannot be written: {type(error).__name__}: {error}"
        self._conclude(one.job, status, reason)

    def _conclude(self, job: Job, status: str, reason: str) -> None:
        again = status == "killed" and not reason.startswith(TOO_MUCH) and not self.outcome.stopped and self.limits.retries
        if again and reason == LOST and job.name not in self.suspects:
            self.suspects.add(job.name)
            self.last.append(job)
            return
        if again and self.tries[job.name] <= self.limits.retries:
            self.next.append(job)
            return
        self.tries.pop(job.name, None)
        self.outcome.count(job.name, status, reason)
        with contextlib.suppress(Exception):
            self.tell(job, status)


def _left_by_key(sweep: Path) -> dict[str, list[Path]]:
    """Folders that earlier attempts left, by the hash in their names."""
    found: dict[str, list[Path]] = {}
    for path in sweep.iterdir() if sweep.is_dir() else ():
        found.setdefault(path.name.rpartition("_")[2], []).append(path)
    return found


@contextlib.contextmanager
def _as_on_the_command_line() -> Iterator[None]:
    """For the start of a process: one thread each, whoever sweeps (sums must not depend on it), and our path for modules.
    multiprocessing runs the file of the main module again in each process; what was typed into a pipe has none."""
    main, environment = sys.modules["__main__"], dict(os.environ)
    os.environ |= dict.fromkeys(THREADS, "1") | {SWEEP_PATH: os.pathsep.join(sys.path)}
    if not os.path.exists(getattr(main, "__file__", None) or ""):
        sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        for name in (*THREADS, SWEEP_PATH):
            os.environ.pop(name)
            if name in environment:
                os.environ[name] = environment[name]


LOST = "the process was lost: it, or the one that starts the jobs, was killed"
TOO_MUCH = "took more memory than"


def _over(one: _Running, limits: Limits) -> bool:
    """Whether the job has ended, or has been given all the time it gets to do so; one over its limits is told to stop."""
    now = time.monotonic()
    with contextlib.suppress(EOFError, OSError):
        while one.done.poll():
            said = one.done.recv()
            if said == COMPILING:
                one.compiling = True
                continue
            one.server, one.written = (one.server, now) if said is True else (int(said), one.written)
    if not one.process.is_alive():
        return True
    if not one.verdict and limits.timeout_s and now - one.started > limits.timeout_s:
        one.verdict, one.told = ("timeout", f"took longer than the {limits.timeout_s:g} s of --timeout"), now
        one.process.terminate()
    if not one.verdict and resident_bytes(one.process.pid) > limits.memory_bytes:
        one.verdict = ("killed", f"{TOO_MUCH} the {limits.memory_bytes / 2**20:.0f} MB of --memory-mb")
        return True
    return bool(one.verdict and now - one.told > GRACE_S) or bool(one.written and now - one.written > LINGER_S)


def _end(one: _Running, keep: Sequence[int]) -> None:
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
    if one.server in children(os.getpid()):
        kill_strays(one.server, keep)


def _row_of(one: _Running) -> tuple[str, str]:
    """Status and reason of a job that is gone. One that left no final row gets it here."""
    path, code = one.folder / "row.json", one.process.exitcode
    one.process.close()
    one.done.close()
    try:
        row = read_row(path)
    except RhsError:
        row = {}
    status = str(row.get("status", RUNNING))
    if status in (RUNNING, KILLED):
        status, reason = one.verdict or _fate(code)
    elif one.verdict and one.verdict[0] != "interrupted" and status != "ok":
        status, reason = one.verdict
    else:
        return status, shortfall(row) if status == "ok" else str(row.get("reason") or "")
    one.folder.mkdir(parents=True, exist_ok=True)
    columns = {name: value for name, value in row.items() if name not in ("pid", "started")}
    row = with_success({**identity(one.job.config), **columns, "status": status, "reason": reason})
    write_row(one.folder, sound(row))
    return status, reason


def _fate(code: int | None) -> tuple[str, str]:
    if code is None or code == 255:  # what multiprocessing says when it lost sight of the process
        return "killed", LOST
    if code < 0:
        with contextlib.suppress(ValueError):
            return "killed", f"the process was killed by {signal.Signals(-code).name}"
        return "killed", f"the process was killed by signal {-code}"
    return "failed", f"the process ended with exit code {code} before it wrote a row; see job.log"


def alike(outcome: Outcome, same_failures: int) -> str:
    """Why the sweep is to stop: so many jobs ended alike; empty while they did not."""
    if same_failures and outcome.reasons:
        reason, count = outcome.reasons.most_common(1)[0]
        if count >= same_failures:
            return f"stopped after {count} jobs ended alike: {reason}"
    return ""


def shortfall(row: Mapping[str, object]) -> str:
    """What a run that ended well was asked for and did not do; empty where nothing is missing."""
    if row.get("lost"):
        return f"lost: {row['lost']}"
    return f"not achieved: {row.get('failure', '')}" if row.get("success") == 0 else ""
