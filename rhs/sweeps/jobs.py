"""Sweeps: every combination in a fresh process of its own, so that a crash, a kill or a hang costs one job.

Jobs are forked from a clean server process that has loaded the libraries once (multiprocessing's forkserver). A job is
done when its folder holds row.json; a job that cannot write its own row gets one from here, so that rows always equal
jobs. Statuses: ok, failed, refused, timeout, killed, interrupted; jobs never started are counted as skipped.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from rhs.base.errors import ConfigError, RhsError
from rhs.config.compose import RunConfig, from_plain, identity, to_plain
from rhs.runfolder.folders import job_folder
from rhs.runfolder.row import read_row, write_row

GRACE_S = 10.0  # a job told to stop has so long to write down what it has
# Loaded once in the server, for every job: what all runs need. Nothing here starts threads or draws random numbers.
PRELOAD = ["rhs.patrol.run", "rhs.estimation.views.features", "cv2", "numba", "scipy.ndimage",
           "scipy.spatial.transform", "rosbags.typesys", "mcap.writer", "matplotlib.backends.backend_agg",
           "matplotlib.figure", "rhs.metrics.judge_kernels", "rhs.metrics.planning", "rhs.estimation.paths.shorten",
           "rhs.sweeps.known"]


@dataclass(frozen=True)
class Job:
    """One run of a sweep: its folder's name (readable values and config hash), its configuration, its words."""

    name: str
    config: RunConfig
    words: tuple[str, ...]

    @property
    def key(self) -> str:
        """The hash of the configuration, by which a job is known again."""
        return self.name.rpartition("_")[2]


def processes() -> int:
    """Processes at a time when nothing is said: one per core this process may use."""
    return len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Limits:
    """jobs: processes at a time. timeout_s: per job, 0 for none. same_failures: stop after so many alike, 0 never."""

    jobs: int = 1
    timeout_s: float = 0.0
    same_failures: int = 0


@dataclass
class Outcome:
    """What became of each job of a sweep, by name; jobs that were never started are missing."""

    status: dict[str, str] = field(default_factory=dict)
    reasons: Counter = field(default_factory=Counter)
    stopped: str = ""  # why not every job was started

    def count(self, name: str, status: str, reason: str) -> None:
        self.status[name] = status
        if status != "ok":
            self.reasons[f"{status}: {reason}"] += 1


@dataclass
class _Running:
    job: Job
    folder: Path
    process: Any
    started: float
    verdict: str = ""  # why it was told to stop: timeout, interrupted
    told: float = 0.0


def run_jobs(jobs: Sequence[Job], sweep: Path, limits: Limits, *, tell: Callable[[Job, str], None]) -> Outcome:
    """Run the jobs in folders under `sweep`; `tell(job, status)` after each. Ctrl-C once: what runs is asked to finish
    its files; twice: it is killed. Either way the exception is raised again when all processes are gone, with the
    outcome so far as its `outcome`."""
    outcome, waiting = Outcome(), list(jobs)[::-1]
    running: list[_Running] = []
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(PRELOAD + asked_for(jobs))
    lifeline, our_end = server.Pipe(duplex=False)  # it breaks when this process dies, and the jobs end with it
    try:
        while waiting or running:
            while waiting and len(running) < limits.jobs and not outcome.stopped:
                running.append(_start(server, waiting.pop(), sweep, lifeline))
            if outcome.stopped and not running:
                break
            wait([one.process.sentinel for one in running], timeout=0.2)
            for one in [one for one in running if _over(one, limits)]:
                running.remove(one)
                _settle(one, outcome, limits)
                tell(one.job, outcome.status[one.job.name])
            outcome.stopped = _alike(outcome, limits)
    except (KeyboardInterrupt, Exception) as error:
        _stop(running, outcome, limits)
        error.outcome = outcome  # type: ignore[union-attr]
        raise
    finally:
        our_end.close()
        lifeline.close()
    return outcome


def asked_for(jobs: Sequence[Job]) -> list[str]:
    """The modules that the jobs' plugins ask to be loaded once for all of them (rhs.contracts.Plugin.preload)."""
    chosen = {type(part.settings) for job in jobs for part in [job.config.task, *job.config.parts.values()]}
    return sorted({name for settings in chosen for name in getattr(settings, "preload", ())})


def _start(server: Any, job: Job, sweep: Path, lifeline: Connection) -> _Running:
    folder = job_folder(sweep, job.name)
    for earlier in sweep.glob(f"*{job.key}"):  # what an earlier attempt left
        shutil.rmtree(earlier, ignore_errors=True)
    folder.mkdir()
    process = server.Process(target=_work, args=(to_plain(job.config), str(folder), lifeline), daemon=False)
    process.start()
    return _Running(job, folder, process, time.monotonic())


def _over(one: _Running, limits: Limits) -> bool:
    """Whether the process has ended; one over its time is asked to stop, then killed."""
    if not one.process.is_alive():
        return True
    now = time.monotonic()
    if not one.verdict and limits.timeout_s and now - one.started > limits.timeout_s:
        one.verdict, one.told = "timeout", now
        one.process.terminate()
    if one.verdict and now - one.told > GRACE_S:
        one.process.kill()
    return False


def _settle(one: _Running, outcome: Outcome, limits: Limits) -> None:
    """See that the job has a row, and count it."""
    one.process.join()
    code, path = one.process.exitcode, one.folder / "row.json"
    try:
        row = read_row(path) if path.exists() else {}
    except RhsError:
        row = {}
    limit = f"took longer than the {limits.timeout_s:g} s of --timeout"
    if not row:
        status, reason = one.verdict or _fate(code)[0], limit if one.verdict == "timeout" else _fate(code)[1]
        row = {**identity(one.job.config), "status": status, "reason": reason}
        write_row(one.folder, row)
    elif one.verdict == "timeout" and row.get("status") != "ok":
        row |= {"status": "timeout", "reason": limit}
        write_row(one.folder, row)
    one.process.close()
    outcome.count(one.job.name, str(row["status"]), str(row.get("reason", "")))
    if row["status"] == "ok" and row.get("lost"):  # it did what it could with what was left of a recording
        outcome.reasons[f"ok, but lost: {row['lost']}"] += 1


def _fate(code: int) -> tuple[str, str]:
    if code < 0:
        with contextlib.suppress(ValueError):
            return "killed", f"the process was killed by {signal.Signals(-code).name}"
        return "killed", f"the process was killed by signal {-code}"
    return "failed", f"the process ended with exit code {code} before it wrote a row; see job.log"


def _stop(running: list[_Running], outcome: Outcome, limits: Limits) -> None:
    """Ask all to stop and wait for their files; a second Ctrl-C kills them."""
    try:
        for one in running:
            one.verdict = one.verdict or "interrupted"
            one.process.terminate()
        end = time.monotonic() + GRACE_S
        for one in running:
            one.process.join(max(0.0, end - time.monotonic()))
    finally:
        for one in running:
            if one.process.is_alive():
                one.process.kill()
            _settle(one, outcome, limits)


def _alike(outcome: Outcome, limits: Limits) -> str:
    if limits.same_failures and outcome.reasons:
        reason, count = outcome.reasons.most_common(1)[0]
        if count >= limits.same_failures:
            return f"stopped after {count} jobs ended alike: {reason}"
    return ""


def _work(values: dict[str, Any], folder: str, lifeline: Connection) -> None:
    """In the job's process: run it; everything printed goes to job.log."""
    import threading
    import traceback

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    signal.signal(signal.SIGTERM, _interrupt)
    threading.Thread(target=_die_with_parent, args=(lifeline,), daemon=True).start()
    log = os.open(os.path.join(folder, "job.log"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    sys.stdout.flush()
    for descriptor in (1, 2):
        os.dup2(log, descriptor)
    config = from_plain(values)
    try:
        from rhs.patrol.run import run_config

        cause = run_config(config, Path(folder)).pop("_cause", None)
    except ConfigError as error:
        cause = error
        write_row(Path(folder), {**identity(config), "status": "refused", "reason": str(error)})
    except KeyboardInterrupt:
        return
    except BaseException as error:  # sys.exit() of a plugin ends here too
        cause = error
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        write_row(Path(folder), {**identity(config), "status": "failed", "reason": reason})
    if cause is not None:
        traceback.print_exception(cause)


def _interrupt(number: int, frame: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


def _die_with_parent(lifeline: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        lifeline.recv()
    os.kill(os.getpid(), signal.SIGKILL)
