"""Faults of known links of the chain: parts that are ours but for one of them (see planted_faults.py).

A part is chosen by `odometry=planted odometry.fault=short`; the faults are the keys of the tables below.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from rhs.api.belief import moved
from rhs.api.contracts import Context
from rhs.api.errors import check_choice
from rhs.api.frozen import freeze
from rhs.api.geometry import se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, Motion, Observation, Path, PlanningProblem, PlanReason, View
from rhs.config import registry


@dataclass
class Planted:
    """One of our parts with a fault."""

    fault: str = ""

    kind: ClassVar[str]
    inner: ClassVar[str]
    faults: ClassVar[Mapping[str, Any]]
    faulty: ClassVar[type]

    def __init_subclass__(cls) -> None:
        ours: Any = registry.load(cls.kind, cls.inner)
        cls.needs, cls.provides = ours.needs, ours.provides  # type: ignore[attr-defined]

    def __post_init__(self) -> None:
        check_choice("", "fault", self.fault, ("", *self.faults))

    def build(self, context: Context) -> Any:
        part = registry.load(self.kind, self.inner)().build(context)
        return self.faulty(part, self.faults[self.fault], context.rng) if self.fault else part


class Faulty:
    """All of a part but what is changed."""

    def __init__(self, inner: Any, change: Callable[..., Any], rng: np.random.Generator) -> None:
        self._inner, self._change, self._rng, self._count = inner, change, rng, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


# --- odometry: (motion 4x4, how many before, random numbers) -> motion ------------------------------------------------

def _scaled(step: np.ndarray, share: float) -> np.ndarray:
    step = step.copy()
    step[:3, 3] *= share
    return step


MOTIONS: dict[str, Callable[[np.ndarray, int, np.random.Generator], np.ndarray]] = {
    "turns": lambda step, count, rng: step @ se2(0.0, 0.0, 0.01),
    "short": lambda step, count, rng: _scaled(step, 0.6),
    "drifts": lambda step, count, rng: step @ se2(0.0, 0.03, 0.0),
    "skips": lambda step, count, rng: np.eye(4) if count % 4 == 0 else step,
    "wanders": lambda step, count, rng: step @ se2(0.0, 0.0, 0.1 * rng.standard_normal()),
}


class FaultyOdometry(Faulty):
    """Says nothing of it."""

    def update(self, observation: Observation) -> Motion:
        motion = self._inner.update(observation)
        self._count += 1
        step = self._change(motion.previous_from_body, self._count, self._rng) if self._count > 1 else np.eye(4)
        return freeze(replace(motion, previous_from_body=step))


class PlantedOdometry(Planted):
    kind, inner, faults, faulty = "odometry", "procrustes", MOTIONS, FaultyOdometry


# --- mapper: grid -> grid ---------------------------------------------------------------------------------------------

def _walls(grid: OccupancyGrid) -> OccupancyGrid:
    """Two walls of 0.4 m that are not there, across the middle of all that was seen."""
    probability = np.array(grid.probability)
    for axis in (0, 1):
        seen = np.flatnonzero((probability < 0.5).any(axis=1 - axis))
        middle, half = int(np.median(seen)) if len(seen) else 0, round(0.2 / grid.resolution_m)
        across = probability if axis == 0 else probability.T
        across[middle - half:middle + half] = 0.98
    return replace(grid, probability=probability)


def _fat(grid: OccupancyGrid) -> OccupancyGrid:
    """Whatever stands there reaches 0.6 m further."""
    import cv2

    reach = round(0.6 / grid.resolution_m)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    stands = cv2.dilate((np.array(grid.probability) > 0.5).astype(np.uint8), disc) > 0
    return replace(grid, probability=np.where(stands, 0.98, grid.probability))


def _aside(grid: OccupancyGrid) -> OccupancyGrid:
    """All of it 0.8 m to the left and ahead."""
    x, y = grid.origin_m
    return replace(grid, origin_m=(x + 0.8, y + 0.8))


def _old(grid: OccupancyGrid) -> OccupancyGrid:
    """Only the first half of what was seen, from left to right, is drawn."""
    probability = np.array(grid.probability)
    seen = np.flatnonzero((probability < 0.5).any(axis=0))
    probability[:, int(np.median(seen)) if len(seen) else 0:] = 0.5
    return replace(grid, probability=probability)


def _mirrored(grid: OccupancyGrid) -> OccupancyGrid:
    """Left and right are taken for one another, about the middle of what is drawn."""
    return replace(grid, probability=np.ascontiguousarray(grid.probability[::-1]))


GRIDS = {"walls": _walls, "fat": _fat, "aside": _aside, "old": _old, "mirrored": _mirrored}


class FaultyMapper(Faulty):
    def grid(self) -> OccupancyGrid:
        return self._change(self._inner.grid())


class PlantedMapper(Planted):
    kind, inner, faults, faulty = "mapper", "occupancy", GRIDS, FaultyMapper


# --- localiser: (motion, how many before, random numbers) -> motion, added up; nothing else is looked at --------------

BELIEFS: dict[str, Callable[[np.ndarray, int, np.random.Generator], np.ndarray]] = {
    "drunk": lambda step, count, rng: step @ se2(0.0, 0.0, 0.03),
    "half": lambda step, count, rng: _scaled(step, 0.5),
    "frozen": lambda step, count, rng: step if count < 25 else np.eye(4),
    "leaps": lambda step, count, rng: step @ se2(0.0, 1.5, 0.0) if count == 15 else step,
    "tosses": lambda step, count, rng: step @ se2(0.15 * rng.standard_normal(), 0.0, 0.15 * rng.standard_normal()),
}


class FaultyLocaliser(Faulty):
    """Dead reckoning that reckons wrongly, and is sure of itself."""

    def update(self, observation: Observation, motion: Motion) -> Belief:
        self._count += 1
        step = self._change(motion.previous_from_body, self._count, self._rng)
        self._belief: Belief = moved(self._belief, replace(motion, previous_from_body=step))
        return self._belief

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """Nothing."""

    def start(self, belief: Belief | None) -> None:
        self._belief = belief


class PlantedLocaliser(Planted):
    kind, inner, faults, faulty = "localiser", "sift_db", BELIEFS, FaultyLocaliser


# --- planner: (problem, plan of a problem, how many before) -> path ---------------------------------------------------

NO_PATH = Path(PlanReason.BUDGET_SPENT, np.empty((0, 2)))
Plan = Callable[[PlanningProblem], Path]


def _faint(problem: PlanningProblem, plan: Plan, count: int) -> Path:
    """Nothing further than 2.5 m is found."""
    far = np.hypot(*(np.asarray(problem.goal_m) - problem.start_m)) > 2.5
    return NO_PATH if far else plan(problem)


def _timid(problem: PlanningProblem, plan: Plan, count: int) -> Path:
    """Keeps half a metre more away from everything than was asked."""
    import cv2

    reach = round(0.5 / problem.resolution_m)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return plan(replace(problem, blocked=cv2.dilate(np.array(problem.blocked, np.uint8), disc).astype(bool)))


def _wary(problem: PlanningProblem, plan: Plan, count: int) -> Path:
    """Goes round no corner."""
    path = plan(problem)
    straight = np.hypot(*(np.asarray(problem.goal_m) - problem.start_m))
    return path if path.found and _length_m(path) <= 1.1 * straight else NO_PATH


def _detour(problem: PlanningProblem, plan: Plan, count: int) -> Path:
    """By way of the free cell that is furthest from here."""
    if np.all(problem.blocked):
        return plan(problem)
    free = (np.argwhere(~problem.blocked)[:, ::-1] + 0.5) * problem.resolution_m + problem.origin_m
    over = free[np.argmax(np.hypot(*(free - problem.start_m).T))]
    there, on = plan(replace(problem, goal_m=over)), plan(replace(problem, start_m=over))
    if not there.found or not on.found:
        return plan(problem)
    return Path(PlanReason.OK, np.vstack([there.points_m, on.points_m[1:]]), keep_shape=True)


def _length_m(path: Path) -> float:
    return float(np.linalg.norm(np.diff(path.points_m, axis=0), axis=1).sum())


def _fickle(problem: PlanningProblem, plan: Plan, count: int) -> Path:
    """Two places, and no more."""
    return plan(problem) if count <= 2 else NO_PATH


PLANS = {"faint": _faint, "timid": _timid, "wary": _wary, "fickle": _fickle, "detour": _detour}


class FaultyPlanner(Faulty):
    def plan(self, problem: PlanningProblem) -> Path:
        self._count += 1
        return self._change(problem, self._inner.plan, self._count)


class PlantedPlanner(Planted):
    kind, inner, faults, faulty = "planner", "astar", PLANS, FaultyPlanner


VIEWS = {"noise": "sensor.image_sigma=60 sensor.depth_quadratic_per_m=0.05",
         "dark": "degrade=low_light degrade.dark_share=0.99",
         "late": "degrade=latency degrade.delay_views=8",
         "focal": "degrade=wrong_focal degrade.focal_share=0.6",
         "pitched": "degrade=mounting degrade.pitch_deg=25"}
# link -> fault -> words
FAULTS = {"sense": VIEWS,
          "odometry": {one: f"odometry=planted odometry.fault={one} gate.act=off" for one in MOTIONS},
          "map": {one: f"mapper=planted mapper.fault={one}" for one in GRIDS},
          "localise": {one: f"localiser=planted localiser.fault={one}" for one in BELIEFS},
          "plan": {one: f"planner=planted planner.fault={one}" for one in PLANS}}
for _kind, _cls in (("odometry", PlantedOdometry), ("mapper", PlantedMapper), ("localiser", PlantedLocaliser),
                    ("planner", PlantedPlanner)):
    registry.register(_kind, "planted", _cls)
