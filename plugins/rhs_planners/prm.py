"""Probabilistic roadmaps that are learnt once per map and repaired when cells change.

A grower (native_roadmap or ompl_roadmap) adds a counted number of vertices and their free edges; queries search them
with A*. When a query finds no way although there is one, the same roadmap is grown on, a counted number of times. When
cells change (an obstacle for one mission), the edges near them are tested again: cut edges are set aside and return with
the cells.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

import numpy as np

from rhs.api.records import Path

from .problem import CellPlanner, Task, already_there, finish
from .roadmap import Roadmap


class Grower(Protocol):
    """One roadmap in the making."""

    def grow(self, grid: np.ndarray, vertices: int, *, stale: bool) -> Roadmap: ...


class RoadmapPlanner(CellPlanner):
    """Over one roadmap per map. begin_growing(task, rng) gives a grower for a new map."""

    def __init__(self, settings, rng: np.random.Generator, begin_growing: Callable[[Task, np.random.Generator], Grower]):
        super().__init__(settings)
        self._rng, self._begin_growing = rng, begin_growing
        self._roadmap: Roadmap | None = None
        self._version = -1  # of the ground, when the roadmap was last made or repaired
        self._grower: Grower
        self._stale = False  # cells have changed since the first edges were found

    def solve(self, task: Task) -> Path:
        """Learn or repair, query, and grow on while start and goal are in one piece but not joined."""
        counts = {"edges_cut": 0.0, "edges_restored": 0.0, "growths": 0.0, "learnt": 0.0}
        learning = time.process_time()
        self._make_ready(task, counts)
        learn_s = time.process_time() - learning
        assert self._roadmap is not None
        raw = already_there(task)
        raw = self._query(task) if raw is None else raw
        rounds = self._settings.rounds(self._ground.free_cells)
        while raw is None and counts["growths"] < rounds and task.ground.connected(task.start, task.goal):
            learning = time.process_time()
            self._grow(task, self._settings.growth)
            learn_s += time.process_time() - learning
            counts["growths"] += 1.0
            raw = self._query(task)
        counts |= {"vertices": float(len(self._roadmap.points)), "edges": float(len(self._roadmap.edges))}
        return finish(task, raw, learn_ms=1e3 * learn_s, extras=counts, knob=("growth_rounds", rounds),
                      sketch=self._roadmap.segments)

    def _query(self, task: Task) -> np.ndarray | None:
        assert self._roadmap is not None
        return self._roadmap.query(task.grid, task.start, task.goal, links=self._settings.links)

    def _make_ready(self, task: Task, counts: dict) -> None:
        """A roadmap for the grid of the task: the one at hand, repaired, or a new one."""
        if self._version == self._ground.version:
            return
        self._version = self._ground.version
        if self._roadmap is None or self._roadmap.changed_share(task.grid) > self._settings.advanced.other_map_share:
            self._grower, self._stale = self._begin_growing(task, self._rng), False
            self._grow(task, self._settings.milestones)
            counts["learnt"] = 1.0
            return
        cut, restored = self._roadmap.mend(task.grid)
        counts["edges_cut"], counts["edges_restored"] = float(cut), float(restored)
        self._stale = self._stale or cut + restored > 0

    def _grow(self, task: Task, vertices: int) -> None:
        self._roadmap = self._grower.grow(task.grid, vertices, stale=self._stale)
