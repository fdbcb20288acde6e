"""Dask as an engine: `Client.get_executor`.

Dask repeats ordinary exceptions where told to retry, so it is told not to; a task whose worker dies is moved by its
scheduler. A scheduler that is killed cancels its futures without waking who waits for them: the sweep asks each. The
terminal's Ctrl-C reaches the workers of this machine too, which would then print their own ends: they ignore it.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

import dask
from distributed import Client, LocalCluster

from rhs.api.engine import Engine, EngineContext
from rhs.api.errors import EngineError

from .dask_config import Dask

IGNORE_INTERRUPTS = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
BATCH = {"slurm": "SLURMCluster", "pbs": "PBSCluster", "htcondor": "HTCondorCluster", "lsf": "LSFCluster",
         "sge": "SGECluster", "oar": "OARCluster"}
PATIENCE_S = 10.0  # to find a scheduler, and to close


class Answer(logging.Handler):
    """Why a batch system refused a job: dask-jobqueue raises it in a task of its own, whose loop only logs it."""

    text = ""

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        lines = str(error or record.getMessage()).splitlines()
        said = [line.strip() for line in lines if "error" in line.lower()] or lines
        self.text = self.text or (said[-1] if said else "no reason given")

    @contextlib.contextmanager
    def heard(self) -> Iterator[None]:
        """Take what the loop logs meanwhile."""
        log = logging.getLogger("tornado.application")
        log.addHandler(self)
        before, log.propagate = log.propagate, False
        try:
            yield
        finally:
            log.removeHandler(self)
            log.propagate = before


class DaskEngine(Engine):
    """A client, and the cluster if it is ours."""

    def __init__(self, settings: Dask, context: EngineContext) -> None:
        self.settings, self.context = settings, context
        self.width, self.chunk_s = context.jobs, settings.chunk_s
        self.cluster: Any = None
        self.client: Any = None

    def open(self) -> Executor:
        """Start or join the cluster."""
        dask.config.set({"distributed.scheduler.allowed-failures": 3,
                         "distributed.worker.preload": [IGNORE_INTERRUPTS]})
        for name in [name for name in logging.root.manager.loggerDict if name.split(".")[0] == "distributed"]:
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what fails is said by the sweep, in one line
        if not self.settings.address:
            self.cluster = self._batch() if self.settings.cluster else LocalCluster(
                n_workers=self.width, threads_per_worker=1, memory_limit=0, dashboard_address=None,
                silence_logs=logging.CRITICAL)
        self.client = Client(self.cluster or self.settings.address, timeout=PATIENCE_S)
        executor: Executor = self.client.get_executor(pure=False, retries=0)
        return executor

    def _batch(self) -> Any:
        import dask_jobqueue

        asked: dict[str, Any] = {"cores": 1, "processes": 1, "memory": self.settings.memory}
        if self.settings.cluster != "htcondor":
            asked |= {"walltime": self.settings.walltime, "queue": self.settings.queue or None}
        cluster = getattr(dask_jobqueue, BATCH[self.settings.cluster])(
            interface=self.settings.interface or None, log_directory=str(self.context.folder / ".dask"), **asked)
        answer = Answer()
        with answer.heard():
            cluster.scale(jobs=self.width)
            end = time.monotonic() + PATIENCE_S
            while not (taken := any(job.job_id for job in cluster.workers.values())) and not answer.text:
                if time.monotonic() > end:
                    break
                time.sleep(0.1)
        if not taken:
            with contextlib.suppress(Exception):
                cluster.close(timeout=PATIENCE_S / 2)
            raise EngineError(f"{self.settings.cluster} took no job: {answer.text or 'no answer'}; "
                              "see engine.queue, memory, walltime")
        return cluster

    def alive(self) -> bool:
        """Whether the scheduler answers; a client that lost it is `connecting`."""
        return self.client is not None and self.client.status == "running"

    def workers(self) -> int | None:
        """As the scheduler said last. In a cluster of somebody else's, its size is how much may be out."""
        if not self.alive():
            return None
        threads = [one["nthreads"] for one in self.client.scheduler_info(n_workers=-1)["workers"].values()]
        if self.settings.address:
            self.width = max(1, sum(threads))
        return len(threads)

    def close(self, now: bool) -> None:
        """Leave the cluster; end it if it is ours."""
        for one in (self.client, self.cluster):
            if one is not None:
                with contextlib.suppress(Exception):
                    one.close(timeout=PATIENCE_S / 2 if now else PATIENCE_S)
