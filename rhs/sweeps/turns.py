"""Which job is next: those that share a survey come one after the other, as soon as it is led."""

from __future__ import annotations

import itertools
import shutil
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rhs.base.processes import kill_group
from rhs.patrol.shared import survey_key

from .job import Job

WINDOW = 100  # jobs looked at together; a larger sweep is composed while it runs
END_S = 5.0  # a process with nothing to do has so long to end


@dataclass
class Group:
    """Jobs that begin with the same survey. process: that leads it, once one does; orders: the pipe to it."""

    jobs: deque[Job]
    folder: Path | None = None
    process: Any = None
    orders: Connection | None = None
    ready: bool = False
    running: set[str] = field(default_factory=set)  # names of the jobs forked from it

    @property
    def alive(self) -> bool:
        return self.process is not None and bool(self.process.is_alive())

    def end(self) -> None:
        """End its process, and what is left of it."""
        if self.orders is not None:
            self.orders.close()
        if self.process is not None:
            self.process.join(END_S if self.ready else 0.0)
            if self.process.is_alive():
                kill_group(self.process.pid)
            self.process.join(END_S)
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


class Turns:
    """The jobs that wait, and the groups under way. again: to be started alone before the others; last: after them."""

    def __init__(self, coming: Iterator[Job], *, share: bool) -> None:
        self.coming, self.share = coming, share
        self.again: list[Job] = []
        self.last: list[Job] = []
        self.groups: list[Group] = []
        self._units: deque[deque[Job]] = deque()

    def next(self) -> tuple[Job, Group | None] | None:
        """The next job, and the group it belongs to if it is one of several; None while there is none to start."""
        if self.again:
            return self.again.pop(), None
        for group in self.groups:
            if group.jobs and group.ready:
                return group.jobs.popleft(), group
        if not self._units:
            self._look_ahead()
        if self._units:
            unit = self._units.popleft()
            job = unit.popleft()
            if not unit:
                return job, None
            self.groups.append(Group(unit))
            return job, self.groups[-1]
        return (self.last.pop(0), None) if self.last and not any(group.jobs for group in self.groups) else None

    def give_up(self, group: Group) -> None:
        """Its survey is led by each of its jobs alone."""
        self.again.extend(reversed(group.jobs))
        group.jobs.clear()
        if not group.running:
            self.groups.remove(group)
            group.end()

    def tidy(self) -> None:
        """End the groups that have no job left; the jobs of those that were killed go alone."""
        for group in [one for one in self.groups if one.ready and (not one.alive or not one.jobs)]:
            if group.jobs or not group.running:
                self.give_up(group)

    def clear(self) -> None:
        """No job is started any more."""
        self.coming, self.again, self.last = iter(()), [], []
        self._units.clear()
        for group in self.groups:
            group.jobs.clear()

    def _look_ahead(self) -> None:
        """Put those that come next into units: one job, or several with the same survey."""
        first = next(self.coming, None)
        if first is None:
            return
        shared = self.share and survey_key(first.config) is not None
        units: dict[str, deque[Job]] = {}
        for job in itertools.chain([first], itertools.islice(self.coming, WINDOW - 1) if shared else ()):
            key = survey_key(job.config) if shared else None
            units.setdefault(key or job.name, deque()).append(job)
        self._units.extend(units.values())
