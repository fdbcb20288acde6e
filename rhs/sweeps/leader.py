"""What several jobs begin with, in a process that does it once and is then forked for each of them: the survey, or the views
of several surveys.

The sweep sends a job and two pipes; the answer is the number of the job's process. A job forked here is like any other
(rhs.sweeps.worker): its own session, log, limits and row. What kills this process kills its jobs; the sweep tries them
again, each alone. From a process that holds views another is forked that leads a survey.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path
from typing import Any

from rhs.api.jit import on_compile
from rhs.base.errors import RhsError
from rhs.config.compose import RunConfig, from_plain
from rhs.config.loose import take_over
from rhs.patrol.shared import DrawnViews, SharedSurvey, draw_views, lead_shared

from . import survey_cache
from .worker import COMPILING, JOB_LOG, KEPT, Task, kept_survey, log_text, redirect, settle_in

READY = "ready"  # said when the survey is led, or the views are drawn
ANSWER_S = 60.0  # within which a leader forks


def draw(task: Task, folder: str, lifeline: Connection, orders: Connection) -> None:
    """Draw the views of the survey that `task` begins with, in `folder`, and serve; `orders` hears the number of the process
    that forked this one, and READY. Views that cannot be drawn end the process: each job then finds out alone."""
    config = _begun(task, folder, lifeline, orders)
    building = survey_cache.building_read(config) if task.cache else None
    if task.cache and survey_cache.holds(survey_cache.key_of(config, building)):
        raise RhsError("an earlier sweep led its survey")
    drawn = draw_views(config, Path(folder), building)
    orders.send(READY)
    serve(drawn, lifeline, orders)


def lead(task: Task, folder: str, lifeline: Connection, orders: Connection, drawn: DrawnViews | None = None) -> None:
    """Lead the survey that `task` begins with, in `folder`, and serve, as `draw` does. drawn: its views, where they were."""
    config, log = _begun(task, folder, lifeline, orders), Path(folder) / JOB_LOG
    shared, keep, building = None, None, None if drawn is None else drawn.building
    if task.cache:
        shared, keep, building = kept_survey(config, log, lambda: orders.send(KEPT), building)
    if shared is None:
        shared = lead_shared(config, Path(folder), building, drawn)
        shared = replace(shared, said=log_text(log))
        if keep is not None:
            keep(shared)
    orders.send(READY)
    serve(shared, lifeline, orders)


def _begun(task: Task, folder: str, lifeline: Connection, orders: Connection) -> RunConfig:
    """This process settled in; the configuration of the task."""
    orders.send(os.getppid())
    settle_in(lifeline)
    redirect(os.path.join(folder, JOB_LOG))
    own = os.getpid()
    on_compile(lambda: orders.send(COMPILING) if os.getpid() == own else None)
    take_over(task.plugins)
    return from_plain(task.values)


def serve(begun: SharedSurvey | DrawnViews, lifeline: Connection, orders: Connection) -> None:
    """Fork a process for each job that is sent, or for what leads its survey, and say how it ended, until nobody sends any
    more."""
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
                target, task, folder = orders.recv()
                done, gone = (Connection(recv_handle(orders)) for _ in range(2))
            except EOFError:
                return
            others = [orders, gone, *(one for _, one in running.values())]
            process = context.Process(target=_go_on, args=(target, task, folder, lifeline, done, begun, others))
            process.start()
            done.close()
            running[process.sentinel] = process, gone
            orders.send(process.pid)


def _go_on(target: Callable[..., None], task: Task, folder: str, lifeline: Connection, done: Connection,
           begun: SharedSurvey | DrawnViews, others: Sequence[Connection]) -> None:
    """The job, or what leads its survey, in a process forked from that of the survey or of the views."""
    for one in others:
        one.close()
    target(task, folder, lifeline, done, begun)


class Forked:
    """A job's process as the sweep sees it, in the words of multiprocessing.Process. sentinel: to be waited for."""

    def __init__(self, orders: Connection, target: Callable[..., None], task: Task, folder: Path, done: Connection) -> None:
        """Have it forked. target: `work` or `lead`. Raises RhsError, OSError or EOFError where nobody answers."""
        self.sentinel, theirs = multiprocessing.Pipe(duplex=False)
        self._code: int | None = None
        self._over = False
        orders.send((target, task, str(folder)))
        for pipe in (done, theirs):
            send_handle(orders, pipe.fileno(), None)
        theirs.close()
        if not orders.poll(ANSWER_S):
            raise RhsError("the process that it is forked from does not answer")
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
