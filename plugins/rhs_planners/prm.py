"""Probabilistic roadmaps that are learnt once per map and repaired when cells change.

OMPL grows the roadmap (growRoadmap with a counter: its own solve() never stops growing and stops by a clock); its edges
are the motions that it asked about and found free; queries search them with A*. When a query finds no way although there
is one, OMPL grows the same roadmap on, a counted number of times. When cells change (an obstacle for one mission), the
edges near them are tested again: cut edges are set aside and return with the cells.
"""

from __future__ import annotations

import time

import numpy as np
from ompl import geometric as og

from rhs.records import Path, PlanningProblem

from .ompl_space import Counter, LoggedGridMotion, definition, fresh_seed, space_over
from .problem import Ground, Task, already_there, begin, finish
from .roadmap import Roadmap

_OTHER_MAP = 0.25  # more changed cells than this share are another map, not an obstacle: the roadmap is learnt anew
_TRIES_PER_VERTEX = 200  # termination checks allowed per wanted vertex, for maps with hardly any free cell


class RoadmapPlanner:
    """rhs.contracts.Planner over one roadmap per map. kind: PRM or PRMstar."""

    def __init__(self, settings, rng: np.random.Generator, kind: str):
        self._settings, self._rng, self._kind = settings, rng, kind
        self._ground = Ground()
        self._roadmap: Roadmap | None = None
        self._version = -1  # of the ground, when the roadmap was last made or repaired
        self._grower: tuple = ()
        self._stale = False  # cells have changed since the first edges were found

    def plan(self, problem: PlanningProblem) -> Path:
        """Learn or repair, query, and grow on while start and goal are in one piece but not joined."""
        task = begin(problem, self._ground, self._settings.start_radius_m)
        if isinstance(task, Path):
            return task
        counts = {"edges_cut": 0.0, "edges_restored": 0.0, "growths": 0.0, "learnt": 0.0}
        learning = time.process_time()
        self._make_ready(task, counts)
        learn_s = time.process_time() - learning
        raw = already_there(task)
        raw = self._query(task) if raw is None else raw
        while raw is None and counts["growths"] < self._settings.growth_rounds and self._worth_growing(task):
            learning = time.process_time()
            self._grow(task, self._settings.growth)
            learn_s += time.process_time() - learning
            counts["growths"] += 1.0
            raw = self._query(task)
        counts |= {"vertices": float(len(self._roadmap.points)), "edges": float(len(self._roadmap.edges))}
        return finish(task, raw, rounds=self._settings.shorten_rounds, learn_ms=1e3 * learn_s, extras=counts,
                      sketch=self._roadmap.segments)

    def _query(self, task: Task) -> np.ndarray | None:
        return self._roadmap.query(task.grid, task.start, task.goal, links=self._settings.links)

    def _worth_growing(self, task: Task) -> bool:
        return task.ground.connected(task.start, task.goal)

    def _make_ready(self, task: Task, counts: dict) -> None:
        """A roadmap for the grid of the task: the one at hand, repaired, or a new one."""
        if self._version == self._ground.version:
            return
        self._version = self._ground.version
        if self._roadmap is None or self._roadmap.changed_share(task.grid) > _OTHER_MAP:
            fresh_seed(self._rng)
            information, motion = space_over(task.grid, LoggedGridMotion)
            planner = getattr(og, self._kind)(information)
            ends = definition(information, task.start, task.goal)  # setup() needs one; growing does not look at it
            planner.setProblemDefinition(ends)
            planner.setup()
            self._grower, self._stale = (planner, motion, information, ends), False
            self._grow(task, self._settings.milestones)
            counts["learnt"] = 1.0
            return
        cut, restored = self._roadmap.mend(task.grid)
        counts["edges_cut"], counts["edges_restored"] = float(cut), float(restored)
        self._stale = self._stale or cut + restored > 0

    def _grow(self, task: Task, vertices: int) -> None:
        """Let OMPL add vertices, then make the roadmap anew from all edges."""
        planner, motion, *_ = self._grower
        wanted = planner.milestoneCount() + vertices
        counter = Counter(_TRIES_PER_VERTEX * vertices, lambda: planner.milestoneCount() >= wanted)
        planner.growRoadmapPtc(counter.condition())
        self._roadmap = Roadmap(task.grid, np.array(motion.free_edges).reshape(-1, 4), stale=self._stale)
