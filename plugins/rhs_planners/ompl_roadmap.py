"""OMPL grows a roadmap: growRoadmap with a counter, for its own solve() never stops growing and stops by a clock. The
roadmap's edges are the motions that it asked about and found free."""

from __future__ import annotations

import numpy as np
from ompl import geometric as og

from .ompl_space import Counter, LoggedGridMotion, definition, fresh_seed, space_over
from .problem import Task
from .roadmap import Roadmap

_TRIES_PER_VERTEX = 200  # termination checks allowed per wanted vertex, for maps with hardly any free cell


class OmplGrower:
    """One growing roadmap over the grid of a task, which it goes on reading. star: PRM* instead of PRM."""

    def __init__(self, task: Task, rng: np.random.Generator, *, star: bool):
        fresh_seed(rng)
        self._information, self._motion = space_over(task.grid, LoggedGridMotion)
        self._planner = (og.PRMstar if star else og.PRM)(self._information)
        self._ends = definition(self._information, task.start, task.goal)  # setup() needs one; growing does not look at it
        self._planner.setProblemDefinition(self._ends)
        self._planner.setup()

    def grow(self, grid: np.ndarray, vertices: int, *, stale: bool) -> Roadmap:
        """Add vertices; the roadmap of all edges so far. stale: cells have changed since some were found."""
        wanted = self._planner.milestoneCount() + vertices
        counter = Counter(_TRIES_PER_VERTEX * vertices, lambda: self._planner.milestoneCount() >= wanted)
        self._planner.growRoadmapPtc(counter.condition())
        ends = np.array(self._motion.free_edges).reshape(-1, 2).view(np.complex128).ravel()  # sorts twice as fast as rows
        points, number = np.unique(ends, return_inverse=True)
        return Roadmap(grid, points.view(np.float64).reshape(-1, 2), number.reshape(-1, 2), stale=stale)
