"""Which job is next: those that share a survey come one after the other, as soon as it is led, and so do surveys of the same
views."""

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
from rhs.patrol.shared import survey_key, views_key

from .job import Job

WINDOW = 100  # jobs looked at together; a larger sweep is composed while it runs
END_S = 5.0  # a process with nothing to do has so long to end


@dataclass
class Group:
    """Jobs that begin with the same survey. process: that leads it, once one does; orders: the pipe to it. views: what draws
    the views of several surveys is such a group too, without jobs of its own."""

    jobs: deque[Job]
    views: Group | None = None
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
    """The jobs that wait, and the groups under way. again: to be started alone before the others; last: after them. workers:
    so many processes at most hold views."""

    def __init__(self, coming: Iterator[Job], *, share: bool, workers: int = 1) -> None:
        self.coming, self.share, self.workers = coming, share, workers
        self.again: list[Job] = []
        self.last: list[Job] = []
        self.groups: list[Group] = []
        self.drawing: dict[str, Group] = {}  # by the key of their views
        self._units: list[Group] = []

    @property
    def every(self) -> list[Group]:
        """Those of surveys, then those of views."""
        return [*self.groups, *self.drawing.values()]

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
            group = self._next_unit()
            job = group.jobs.popleft()
            if group.jobs:
                self.groups.append(group)
            return job, group if group.jobs or group.views is not None else None
        return (self.last.pop(0), None) if self.last and not any(group.jobs for group in self.groups) else None

    def give_up(self, group: Group) -> None:
        """Its survey is led by each of its jobs alone; or its views are drawn by each of those surveys alone."""
        for other in [*self._units, *self.groups]:
            other.views = None if other.views is group and other.process is None else other.views
        self.drawing = {key: one for key, one in self.drawing.items() if one is not group}
        self.again.extend(reversed(group.jobs))
        group.jobs.clear()
        if not group.running:
            self.groups = [one for one in self.groups if one is not group]
            group.end()

    def tidy(self) -> None:
        """End the groups that have no job left; the jobs of those that were killed go alone."""
        for group in [one for one in self.groups if one.ready and (not one.alive or not one.jobs)]:
            if group.jobs or not group.running:
                self.give_up(group)
        for group in [one for one in self.drawing.values() if one.ready and not one.running]:
            if not group.alive or not any(one.views is group for one in [*self._units, *self.groups]):
                self.give_up(group)

    def clear(self) -> None:
        """No job is started any more."""
        self.coming, self.again, self.last = iter(()), [], []
        self._units.clear()
        for group in self.groups:
            group.jobs.clear()

    def _next_unit(self) -> Group:
        """The next one whose views are drawn; or one that shares none, or for which they can be drawn now. While they are
        being drawn for all that is left, one draws its own."""
        held = sum(one.process is not None for one in self.drawing.values())
        ready = (one for one in self._units if one.views is not None and one.views.ready)
        other = (one for one in self._units
                 if one.views is None or (one.views.process is None and held < self.workers))
        group = next(ready, None) or next(other, None)
        if group is None:
            group = self._units[0]
            group.views = None
        self._units.remove(group)
        return group

    def _look_ahead(self) -> None:
        """Put those that come next into units: one job, or several with the same survey; some have the same views."""
        first = next(self.coming, None)
        if first is None:
            return
        shared = self.share and bool(survey_key(first.config) or views_key(first.config))
        units: dict[str, Group] = {}
        by_views: dict[str, list[Group]] = {}
        for job in itertools.chain([first], itertools.islice(self.coming, WINDOW - 1) if shared else ()):
            key = (survey_key(job.config) if shared else None) or job.name
            if key not in units:
                units[key] = Group(deque())
                if shared and (views := views_key(job.config)):
                    by_views.setdefault(views, []).append(units[key])
            units[key].jobs.append(job)
        for views, groups in by_views.items():
            if len(groups) > 1 or views in self.drawing:
                held = self.drawing.setdefault(views, Group(deque()))
                for group in groups:
                    group.views = held
        self._units.extend(units.values())
