"""Slurm as an engine: submitit submits, a thread looks for answers.

A Slurm job that left the queue without an answer was killed. Which are queued is asked of squeue, once for all, because
submitit asks sacct, which sites without accounting do not have. Jobs outlive a sweep that is killed: their numbers stand
in the sweep's folder, and the next start cancels them, since nobody would read their rows.
"""

from __future__ import annotations

import contextlib
import getpass
import shutil
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import submitit

from rhs.api.engine import Engine, EngineContext
from rhs.api.errors import EngineError

from .slurm_config import Slurm

LATE_S = 30.0  # an answer may appear so long after its job left the queue: shared disks are slow
SILENT_S = 300.0  # without an answer from squeue, Slurm counts as gone


class SlurmEngine(Engine):
    """Submits chunks as jobs of Slurm."""

    def __init__(self, settings: Slurm, context: EngineContext) -> None:
        self.settings, self.folder = settings, context.folder / ".slurm"
        self.width, self.chunk_s, self.processes = context.jobs, settings.chunk_s, settings.cpus
        self.jobs: Submitted | None = None

    def open(self) -> Executor:
        """Cancel what a killed sweep left, then be ready."""
        self.folder.mkdir(exist_ok=True)
        ids = self.folder / "ids"
        if ids.is_file():
            cancel(ids.read_text().split())
        for left in self.folder.iterdir():
            left.unlink(missing_ok=True)
        ids.write_text("")
        submit = submitit.AutoExecutor(folder=str(self.folder), cluster="slurm")
        asked: dict[str, Any] = {"timeout_min": self.settings.time_min, "cpus_per_task": self.settings.cpus, "name": "rhs"}
        for name, value in (("slurm_partition", self.settings.partition), ("slurm_account", self.settings.account),
                            ("slurm_mem", f"{self.settings.memory_mb}MB" if self.settings.memory_mb else "")):
            asked |= {name: value} if value else {}
        submit.update_parameters(**asked)
        self.jobs = Submitted(submit, ids, self.settings.poll_s)
        return self.jobs

    def alive(self) -> bool:
        """Whether squeue answered lately."""
        return self.jobs is None or time.monotonic() - self.jobs.heard_s < SILENT_S

    def workers(self) -> int | None:
        """Our jobs that run."""
        return self.jobs.running if self.jobs is not None else None

    def close(self, now: bool) -> None:
        """Cancel what is out."""
        if self.jobs is not None:
            self.jobs.shutdown(cancel_futures=True)
        if not now:
            shutil.rmtree(self.folder, ignore_errors=True)


class Submitted(Executor):
    """An executor of Slurm jobs. running: how many run. heard_s: when squeue last answered."""

    def __init__(self, submit: submitit.AutoExecutor, ids: Path, poll_s: float) -> None:
        self._submit, self._ids, self._poll_s = submit, ids, poll_s
        self._out: dict[Future[Any], submitit.Job[Any]] = {}
        self._gone: dict[str, float] = {}  # job -> since when it is not in the queue
        self._guard, self._over = threading.Lock(), threading.Event()
        self.running, self.heard_s = 0, time.monotonic()
        threading.Thread(target=self._poll, daemon=True).start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """One Slurm job."""
        future: Future[Any] = Future()
        job = self._submit.submit(fn, *args, **kwargs)
        with self._guard:
            self._out[future] = job
            with self._ids.open("a") as file:
                file.write(f"{job.job_id}\n")
        return future

    def _poll(self) -> None:
        while not self._over.wait(self._poll_s):
            states = queue()
            if states is not None:
                self.heard_s = time.monotonic()
            with self._guard:
                out = dict(self._out)
            self.running = sum((states or {}).get(job.job_id) == "RUNNING" for job in out.values())
            for future, job in out.items():
                self._look(future, job, states)

    def _look(self, future: Future[Any], job: submitit.Job[Any], states: dict[str, str] | None) -> None:
        """Take in an answer, or that there will be none."""
        if job.paths.result_pickle.is_file():
            self._end(future, job, None)
        elif states is not None and job.job_id not in states:
            if time.monotonic() - self._gone.setdefault(job.job_id, time.monotonic()) > LATE_S:
                self._end(future, job, EngineError(f"Slurm job {job.job_id} ended without an answer"))
        elif states is not None and states[job.job_id] == "RUNNING" and not future.running() and not future.done():
            future.set_running_or_notify_cancel()

    def _end(self, future: Future[Any], job: submitit.Job[Any], error: Exception | None) -> None:
        with self._guard:
            self._out.pop(future, None)
        answer: Any = None
        try:
            if error is None:
                answer = job.result()
        except Exception as said:
            error = EngineError(f"Slurm job {job.job_id}: {' '.join(str(said).split())[-200:]}")
        with contextlib.suppress(Exception):  # the sweep may have given it up
            future.set_exception(error) if error is not None else future.set_result(answer)
        for path in self._ids.parent.glob(f"{job.job_id}_*"):
            path.unlink(missing_ok=True)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop looking; cancel what is out."""
        self._over.set()
        with self._guard:
            ids = [job.job_id for job in self._out.values()]
        cancel(ids)
        with contextlib.suppress(OSError):
            self._ids.unlink()


def queue() -> dict[str, str] | None:
    """State of each of our jobs in the queue; None when squeue does not answer."""
    try:
        told = subprocess.run(["squeue", "-h", "-u", getpass.getuser(), "-o", "%i %T"], capture_output=True, text=True,
                              timeout=60.0, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return None
    return {line.split()[0]: line.split()[1] for line in told.splitlines() if len(line.split()) == 2}


def cancel(ids: list[str]) -> None:
    """Take jobs out of the queue, running or not."""
    if ids:
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            subprocess.run(["scancel", *ids], capture_output=True, timeout=60.0, check=False)
