"""Sweeps: every combination in a fresh process of its own, so that a crash, a kill or a hang costs one job.

Jobs are forked from a clean server process that has loaded the libraries once (multiprocessing's forkserver). A job is
done when its folder holds a final row.json; a job that cannot write its own row gets one from here, so that rows always
equal jobs. Statuses: ok, failed, refused, timeout, killed, interrupted; jobs never started are counted as skipped.

A job has a session of its own. When it is over, whatever it started is killed with it: its process group, and the orphans
that fell to the server (rhs.base.processes).
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import shutil
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from types import ModuleType

from rhs.base.errors import RhsError
from rhs.base.processes import SWEEP_PATH, SWEEP_PRELOAD, steady
from rhs.base.system import processors
from rhs.config.compose import identity, to_plain
from rhs.config.loose import carried
from rhs.runfolder.folders import job_folder

from .ending import GRACE_S, LOST, TOO_MUCH, Running, ended, over, row_of, write_last
from .job import Job, Limits, Outcome, alike
from .leader import Forked, draw, lead
from .turns import Group, Turns
from .worker import COMPILING, JOB_LOG, Task, work

__all__ = ["PRELOAD", "Job", "Limits", "Outcome", "asked_for", "processors", "run_jobs"]

_STARTING = threading.Lock()  # sweeps in threads share the environment
# Servers that no sweep uses now, and the process that they are of. None serves two sweeps at a time, who kills the orphans
# that fell to it, nor is it one that other code of this process began in an environment of its own.
_idle: list[tuple[int, forkserver.ForkServer]] = []
NOT_SHARED = "not_shared.log"  # in the sweep's folder: surveys that each job had to lead itself, and why
# Loaded once in the server, for every job: what all runs need. Nothing here starts threads or draws random numbers.
PRELOAD = ["rhs.patrol.run", "rhs.patrol.job", "rhs.estimation.views.features", "cv2", "numba", "scipy.ndimage",
           "scipy.spatial.transform", "rosbags.typesys", "mcap.writer", "matplotlib.backends.backend_agg",
           "matplotlib.figure", "rhs.metrics.judge_kernels", "rhs.metrics.planning", "rhs.estimation.paths.shorten",
           "rhs.patrol.shared", "rhs.sweeps.leader", "rhs.sweeps.server"]


def run_jobs(jobs: Iterable[Job], sweep: Path, limits: Limits, *, tell: Callable[[Job, str], None],
             preload: Sequence[str] = (), outcome: Outcome | None = None) -> Outcome:
    """Run the jobs in folders under `sweep`, taking the next one when it may start; `tell(job, status)` after each.
    preload: what `asked_for` says of them. outcome: to be added to. Ctrl-C once: what runs is asked to finish its files;
    twice: it is killed. Either way the exception is raised again when all processes are gone."""
    pool = _Pool(iter(jobs), sweep, limits, tell)
    pool.outcome = outcome or pool.outcome
    pool.server.set_forkserver_preload(PRELOAD)
    pool.preload = preload
    try:
        while True:
            pool.fill()
            if not pool.running:
                break
            wait([one.done if one.leads else one.process.sentinel for one in pool.running], timeout=0.2)
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
    """The jobs that run."""

    def __init__(self, coming: Iterator[Job], sweep: Path, limits: Limits, tell: Callable[[Job, str], None]) -> None:
        self.sweep, self.limits, self.tell = sweep, limits, tell
        for path in sweep.glob(".survey-*"):  # what a sweep that was killed left
            shutil.rmtree(path, ignore_errors=True)
        self.turns = Turns(coming, share=limits.share, workers=limits.jobs)
        self.next: list[tuple[Job, Group | None]] = []  # to be started when those that run allow it
        self.running: list[Running] = []
        self.left = _left_by_key(sweep)
        self.outcome = Outcome()
        self.compiling = False
        self.tries: Counter = Counter()
        self.preload: Sequence[str] = ()
        self.suspects: set[str] = set()  # ran when the server was killed: they are tried again, last and alone
        self.context, self.server = multiprocessing.get_context("forkserver"), _server()
        self.lifeline, self.our_end = self.context.Pipe(duplex=False)  # breaks when this process dies: the jobs end with it

    def fill(self) -> None:
        """Start as many as may run."""
        self.turns.tidy()
        while len(self.running) < self.limits.jobs and not self.outcome.stopped and self._look_ahead():
            job, group = self.next[-1]
            if self.running and self.suspects & {job.name, *(one.job.name for one in self.running)}:
                return
            self.next.pop()
            self._try(job, group, time.monotonic())

    def _look_ahead(self) -> bool:
        """Whether there is a job to start; it is the last of `next`."""
        if not self.next and (found := self.turns.next()) is not None:
            self.next.append(found)
        return bool(self.next)

    def _try(self, job: Job, group: Group | None, began: float) -> None:
        """Start a job, or what leads the survey or draws the views that it shares with others. began: when its time began to
        count."""
        self.tries[job.name] += 1
        try:
            if group is not None and group.views is not None and group.views.process is None:
                self.running.append(self._lead(job, group.views, group))
            elif group is not None and group.process is None and group.jobs:
                self.running.append(self._lead(job, group))
            else:
                self.running.append(self._start(job, group, began))
        except (OSError, EOFError, RhsError) as error:  # no room on the disk, or the server was killed just now
            if group is not None:
                self._alone(job, group)
                return
            reason = f"it could not be started: {type(error).__name__}: {error}"
            with contextlib.suppress(OSError, RhsError):
                write_last(job, self.sweep / job.name, "killed", reason)
            self._conclude(job, "killed", reason)

    def _start(self, job: Job, group: Group | None, began: float) -> Running:
        folder = job_folder(self.sweep, job.name)
        for earlier in {folder, *self.left.pop(job.key, ())}:  # what an earlier attempt left
            shutil.rmtree(earlier, ignore_errors=True)
        folder.mkdir(parents=True)
        process: multiprocessing.process.BaseProcess | Forked
        ours, theirs = self.context.Pipe(duplex=False)
        group = group if group is None or group.orders is not None else group.views
        if group is None or group.orders is None:
            process = self._process(work, self._task(job), str(folder), self.lifeline, theirs)
        else:
            process = Forked(group.orders, work, self._task(job), folder, theirs)
            group.running.add(job.name)
        theirs.close()
        return Running(job, folder, process, ours, began, group)

    def _lead(self, job: Job, group: Group, then: Group | None = None) -> Running:
        """Have the survey led that this job shares with others, or, if `then` it goes on with a group, the views drawn. That
        counts as the job meanwhile."""
        folder = self.sweep / f".survey-{job.key}{'-views' if then else ''}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        group.folder = folder
        group.orders, theirs = self.context.Pipe(duplex=True)
        if group.views is not None and group.views.orders is not None:
            group.process = Forked(group.views.orders, lead, self._task(job), folder, theirs)
        else:
            group.process = self._process(draw if then else lead, self._task(job), str(folder), self.lifeline, theirs)
        theirs.close()
        began = time.monotonic()
        return Running(job, job_folder(self.sweep, job.name), group.process, group.orders, began, group, True, then)

    def _task(self, job: Job) -> Task:
        return task_of(job, cache=self.limits.cache)

    def _process(self, target: Callable[..., None], *arguments: object) -> multiprocessing.process.BaseProcess:
        process = self.context.Process(target=target, args=arguments, daemon=False)
        with _STARTING, _as_on_the_command_line(self.server, self.preload):
            process.start()
        return process

    def collect(self) -> None:
        """Take in those that are over."""
        for one in [one for one in self.running if over(one, self.limits)]:
            self.running.remove(one)
            if one.leads:
                self._led(one)
            else:
                self._settle(one)
        for one in [one for one in self.running if one.compiling][: not self.compiling]:
            self.compiling = True
            self.tell(one.job, COMPILING)

    def _led(self, one: Running) -> None:
        """A survey is led, or its views are drawn: the job that it counted as goes on. What failed is left to each alone."""
        assert one.group is not None
        self.outcome.kept += one.kept
        if one.group.ready:
            self.tries[one.job.name] -= 1
            self._try(one.job, one.then or one.group, one.started)
            return
        ended(one, self._others())
        said = one.verdict[1] if one.verdict else last_line(one.group.folder or one.folder) or f"exit {one.process.exitcode}"
        with contextlib.suppress(OSError), (self.sweep / NOT_SHARED).open("a", encoding="utf-8") as file:
            file.write(f"{one.job.name} and {'its views' if one.then else f'{len(one.group.jobs)} more'}: {said}\n")
        if one.then is None:
            self._alone(one.job, one.group)
            return
        self.turns.give_up(one.group)
        one.then.views = None
        self.tries[one.job.name] -= 1
        self._try(one.job, one.then, one.started)

    def _alone(self, job: Job, group: Group) -> None:
        """A job that could not be started in its group, and those that wait for the same, lead their surveys themselves."""
        self.tries[job.name] -= 1
        self.turns.give_up(group)
        self.turns.again.append(job)

    def stop(self) -> None:
        """Ask all to stop and wait for their files; a second Ctrl-C kills them."""
        self.turns.clear()
        self.next = []
        try:
            for one in self.running:
                one.verdict = one.verdict or ("interrupted", "interrupted")
                one.process.terminate()
            end = time.monotonic() + GRACE_S
            for one in self.running:
                one.process.join(max(0.0, end - time.monotonic()))
        finally:
            while self.running:  # one that is settled has no number that the others could ask for
                self._settle(self.running.pop(0))

    def close(self) -> None:
        for group in self.turns.every:
            group.end()
        self.our_end.close()
        self.lifeline.close()
        _idle.append((os.getpid(), self.server))

    def _others(self) -> list[int]:
        """Processes that are to live on when another ends."""
        groups = [group.process.pid for group in self.turns.every if group.process is not None]
        return [*groups, *(other.process.pid for other in self.running)]

    def _settle(self, one: Running) -> None:
        """See that nothing is left of the job but its row, and count it. Raises nothing, whatever the job did."""
        ended(one, self._others())
        if one.group is not None:
            one.group.running.discard(one.job.name)
        try:
            self.outcome.kept += one.kept
            status, reason = row_of(one)
        except Exception as error:  # a disk that is full, a folder that is no folder any more
            status, reason = "failed", f"its row cannot be written: {type(error).__name__}: {error}"
        self._conclude(one.job, status, reason)

    def _conclude(self, job: Job, status: str, reason: str) -> None:
        again = status == "killed" and not reason.startswith(TOO_MUCH) and not self.outcome.stopped and self.limits.retries
        if again and reason == LOST and job.name not in self.suspects:
            self.suspects.add(job.name)
            self.turns.last.append(job)
            return
        if again and self.tries[job.name] <= self.limits.retries:
            self.turns.again.append(job)
            return
        self.tries.pop(job.name, None)
        self.outcome.count(job.name, status, reason)
        with contextlib.suppress(Exception):
            self.tell(job, status)


def last_line(folder: Path) -> str:
    """The last line that a process printed; empty where there is none."""
    with contextlib.suppress(OSError, IndexError):
        return (folder / JOB_LOG).read_text("utf-8", "replace").strip().splitlines()[-1][:300]
    return ""


def task_of(job: Job, *, cache: bool = False) -> Task:
    """What its process is sent."""
    chosen = {(kind, one.name) for kind, one in {"task": job.config.task, **job.config.parts}.items()}
    return Task(to_plain(job.config), identity(job.config), carried(chosen), cache)


def _server() -> forkserver.ForkServer:
    """One that is free, or new."""
    with _STARTING:
        free = next((one for one in _idle if one[0] == os.getpid()), None)
        if free is None:
            return forkserver.ForkServer()
        _idle.remove(free)
        return free[1]


def _left_by_key(sweep: Path) -> dict[str, list[Path]]:
    """Folders that earlier attempts left, by the hash in their names."""
    found: dict[str, list[Path]] = {}
    for path in sweep.iterdir() if sweep.is_dir() else ():
        found.setdefault(path.name.rpartition("_")[2], []).append(path)
    return found


@contextlib.contextmanager
def _as_on_the_command_line(server: forkserver.ForkServer, preload: Sequence[str]) -> Iterator[None]:
    """For the start of a process by this server: its sums are steady, whoever sweeps, and our path for modules.
    multiprocessing would run the file of the main module again in each process: what a job needs of it, it is sent.
    Ctrl-C waits, and is none of the server's while that loads (`server.py`)."""
    main, environment, connect = sys.modules["__main__"], dict(os.environ), forkserver.connect_to_new_process
    resource_tracker.ensure_running()  # which would take the block away again
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    ours = steady() | {SWEEP_PATH: os.pathsep.join(sys.path), SWEEP_PRELOAD: " ".join(preload)}
    os.environ |= ours
    sys.modules["__main__"], forkserver.connect_to_new_process = ModuleType("__main__"), server.connect_to_new_process
    try:
        yield
    finally:
        sys.modules["__main__"], forkserver.connect_to_new_process = main, connect
        for name in ours:
            os.environ.pop(name)
            if name in environment:
                os.environ[name] = environment[name]
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
