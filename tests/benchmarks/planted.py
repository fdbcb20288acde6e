"""One fault for each link of the chain: parts that are ours but for it (see planted_faults.py)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from rhs.api.belief import moved
from rhs.api.contracts import Context
from rhs.api.frozen import freeze
from rhs.api.geometry import se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, Motion, Observation, Path, PlanningProblem, PlanReason, View
from rhs.config import registry


class _Inner:
    """All of a part but what is changed."""

    def __init__(self, inner: Any, settings: Any) -> None:
        self._inner, self._settings = inner, settings

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


@dataclass
class Crooked:
    """procrustes whose every motion turns too far to the left, and says nothing of it."""

    turn_rad: float = 0.004

    needs: ClassVar[frozenset[str]] = registry.load("odometry", "procrustes").needs
    provides: ClassVar[frozenset[str]] = registry.load("odometry", "procrustes").provides

    def build(self, context: Context) -> Any:
        return CrookedOdometry(registry.load("odometry", "procrustes")().build(context), self)


class CrookedOdometry(_Inner):
    def update(self, observation: Observation) -> Motion:
        motion = self._inner.update(observation)
        return freeze(replace(motion, previous_from_body=motion.previous_from_body @ se2(0.0, 0.0, self._settings.turn_rad)))


@dataclass
class Walled:
    """occupancy that draws two walls that are not there, across the middle of all it saw."""

    thick_m: float = 0.4

    needs: ClassVar[frozenset[str]] = registry.load("mapper", "occupancy").needs
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Any:
        return WalledMapper(registry.load("mapper", "occupancy")().build(context), self)


class WalledMapper(_Inner):
    def grid(self) -> OccupancyGrid:
        grid = self._inner.grid()
        probability = np.array(grid.probability)
        for axis in (0, 1):
            seen = np.flatnonzero((probability < 0.5).any(axis=1 - axis))
            middle, half = int(np.median(seen)) if len(seen) else 0, round(self._settings.thick_m / grid.resolution_m / 2)
            across = probability if axis == 0 else probability.T
            across[middle - half:middle + half] = 0.98
        return OccupancyGrid(probability, grid.resolution_m, grid.origin_m)


@dataclass
class Drunk:
    """odometry_only that turns a little with every view, and is sure of itself."""

    turn_rad: float = 0.01

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Any:
        return DrunkLocaliser(registry.load("localiser", "odometry_only")().build(context), self)


class DrunkLocaliser(_Inner):
    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """Nothing."""

    def start(self, belief: Belief | None) -> None:
        self._belief = belief

    def update(self, observation: Observation, motion: Motion) -> Belief:
        turned = motion.previous_from_body @ se2(0.0, 0.0, self._settings.turn_rad)
        self._belief = moved(self._belief, replace(motion, previous_from_body=turned))
        return self._belief


@dataclass
class Faint:
    """astar that finds no way to what is far."""

    reach_m: float = 4.0

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Any:
        return FaintPlanner(registry.load("planner", "astar")().build(context), self)


class FaintPlanner(_Inner):
    def plan(self, problem: PlanningProblem) -> Path:
        if float(np.hypot(*(np.asarray(problem.goal_m) - problem.start_m))) > self._settings.reach_m:
            return Path(PlanReason.BUDGET_SPENT, np.empty((0, 2)))
        return self._inner.plan(problem)


PARTS = {"odometry": ("crooked", Crooked), "mapper": ("walled", Walled), "localiser": ("drunk", Drunk),
         "planner": ("faint", Faint)}
for _kind, (_name, _cls) in PARTS.items():
    registry.register(_kind, _name, _cls)
