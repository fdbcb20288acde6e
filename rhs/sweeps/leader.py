"""One survey for several jobs, in a process that leads it and is then forked for each of them.

The sweep sends a job and two pipes; the answer is the number of the job's process. A job forked here is like any other
(rhs.sweeps.worker): its own session, log, limits and row. What kills this process kills its jobs; the sweep tries them
again, each alone.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path
from typing import Any

from rhs.api.jit import on_compile
from rhs.base.errors import RhsError
from rhs.config.compose import from_plain
from rhs.config.loose import take_over
from rhs.patrol.shared import SharedSurvey, lead_shared

from .worker import COMPILING, JOB_LOG, KEPT, Task, kept_survey, log_text, redirect, settle_in, work

READY = "ready"  # said when the survey is led
ANSWER_S = 60.0  # within which a leader forks


def lead(task: Task, folder: str, lifeline: Connection, orders: Connection) -> None:
    """Lead the survey that `task` begins with, in `folder`, and serve; `orders` hears the number of the process that
    forked this one, and READY. A survey that fails ends the process: each job then finds out alone."""
    orders.send(os.getppid())
    settle_in(lifeline)
    redirect(os.path.join(folder, JOB_LOG))
    own = os.getpid()
    on_compile(lambda: orders.send(COMPILING) if os.getpid() == own else None)
    take_over(task.plugins)
    config, log = from_plain(task.values), Path(folder) / JOB_LOG
    shared, keep, building = kept_survey(config, log, lambda: orders.send(KEPT)) if task.cache else (None, None, None)
    if shared is None:
        shared = lead_shared(config, Path(folder), building)
        shared = replace(shared, said=log_text(log))
        if keep is not None:
            keep(shared)
    orders.send(READY)
    serve(shared, lifeline, orders)


def serve(shared: SharedSurvey, lifeline: Connection, orders: Connection) -> None:
    """Fork a process for each job that is sent, and say how it ended, until nobody sends any more."""
    context = multiprocessing.get_context("fork")
    running: dict[Any, tuple[Any, Connection]] = {}
    while True:
        for ready in wait([orders, *running]):
            if ready is not orders:
                process, gone = running.pop(ready)
                process.join()
                with contextlib.suppress(OSError):
                    gone.send(process.exitcode)
                gone.close()
                continue
            try:
                task, folder = orders.recv()
                done, gone = (Connection(recv_handle(orders), readable=False) for _ in range(2))
            except EOFError:
                return
            others = [orders, gone, *(one for _, one in running.values())]
            process = context.Process(target=_go_on, args=(task, folder, lifeline, done, shared, others))
            process.start()
            done.close()
            running[process.sentinel] = process, gone
            orders.send(process.pid)


def _go_on(task: Task, folder: str, lifeline: Connection, done: Connection, shared: SharedSurvey,
           others: Sequence[Connection]) -> None:
    """The job, in a process forked from the survey's."""
    for one in others:
        one.close()
    work(task, folder, lifeline, done, shared)


class Forked:
    """A job's process as the sweep sees it, in the words of multiprocessing.Process. sentinel: to be waited for."""

    def __init__(self, orders: Connection, task: Task, folder: Path, done: Connection) -> None:
        """Have it forked. Raises RhsError, OSError or EOFError where nobody answers."""
        self.sentinel, theirs = multiprocessing.Pipe(duplex=False)
        self._code: int | None = None
        self._over = False
        orders.send((task, str(folder)))
        for pipe in (done, theirs):
            send_handle(orders, pipe.fileno(), None)
        theirs.close()
        if not orders.poll(ANSWER_S):
            raise RhsError("the process of its survey does not answer")
        self.pid: int = orders.recv()

    @property
    def exitcode(self) -> int | None:
        """As of multiprocessing; None also where it was lost with the process of its survey."""
        self.is_alive()
        return self._code

    def is_alive(self) -> bool:
        if not self._over and self.sentinel.poll():
            self._over = True
            with contextlib.suppress(EOFError, OSError):
                self._code = int(self.sentinel.recv())
        return not self._over

    def join(self, timeout: float | None = None) -> None:
        if not self._over:
            self.sentinel.poll(timeout)

    def terminate(self) -> None:
        if self.is_alive():
            with contextlib.suppress(OSError):
                os.kill(self.pid, signal.SIGTERM)

    def close(self) -> None:
        self.sentinel.close()
