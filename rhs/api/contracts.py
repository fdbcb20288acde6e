"""What each kind of part must do. Plugin authors read this.

A plugin is one dataclass named by one entry point in a group `rhs.<kind>`. The dataclass holds the settings (all with
defaults, units in the names), checks their ranges in `__post_init__`, declares

    needs: ClassVar[frozenset[str]]      what it takes from the parts before it
    provides: ClassVar[frozenset[str]]   what it offers to the parts after it

and has `build(context) -> part`, where heavy libraries are imported. Words used by needs/provides:
`image`, `depth`, `scan`, `wheel`, `command`, `driving` (the source can be driven), `teleport`, `walls`, `gray`, `texture`
(the source has `texture(along_m, around_m)`, the true grey of its wall, for the judge of task=unroll).

Parts get randomness only from `context.rng`, and never see a true pose. Arrays they receive are read-only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, ClassVar, Protocol

import numpy as np

from rhs.worlds.world import World

from .geometry import Camera
from .grid import OccupancyGrid
from .records import (
    Belief,
    Capture,
    Closure,
    FeatureSettings,
    Motion,
    Observation,
    Path,
    PlanningProblem,
    Revision,
    Scan,
    Twist,
    View,
    WorldFacts,
)

KINDS = ("source", "sensor", "odometry", "loop_closer", "mapper", "planner", "localiser")


@dataclass(frozen=True)
class Context:
    """All that `build` gets: its own random generator, the camera, the world's public facts, a folder for files."""

    rng: np.random.Generator
    camera: Camera
    world: WorldFacts
    folder: FilePath
    features: FeatureSettings


@dataclass(frozen=True)
class SourceContext:
    """All that the `build` of a source gets: its own random generator, the whole world (None for a recording made
    elsewhere), a folder for files."""

    rng: np.random.Generator
    world: World | None
    folder: FilePath


class Plugin(Protocol):
    """The dataclass an entry point names."""

    needs: ClassVar[frozenset[str]]
    provides: ClassVar[frozenset[str]]

    def build(self, context: Context) -> Any: ...


class Source(Protocol):
    """Hands out ideal captures: a simulator or a recording. Its `build` gets a SourceContext instead."""

    camera: Camera
    facts: WorldFacts  # of the simulated world, or what a recording tells (no places, bounds round its start)
    views_expected: int | None  # length of the survey for the progress bar, None when unknown

    def lead(self) -> Capture | None:
        """The next view of the survey: the robot led along its route, or the next recorded view. None at the end."""

    def begin_patrol(self) -> None:
        """The survey is over: put in the obstacles that the map must not know."""

    def drive(self, command: Twist) -> Capture:
        """Drive on a command, then look. Only sources that provide `driving`."""

    def teleport(self, world_from_body: np.ndarray) -> None:
        """Put the robot elsewhere without telling it. Only sources that provide `teleport`."""

    def truth(self) -> np.ndarray | None:
        """True world_from_body (4x4) of the last capture, or None when nobody knows. Never handed to an estimator."""

    def clearance_m(self) -> tuple[float, bool]:
        """Least true distance to anything since the last call, and whether the robot touched something. NaN: unknown."""

    def close(self) -> None: ...


class Sensor(Protocol):
    """Degrades a Capture into an Observation: range, noise, monocular. May be called once per capture, in order."""

    def sense(self, capture: Capture) -> Observation: ...


class Odometry(Protocol):
    """Estimates motion from one observation to the next. The first call returns the identity, status ok.

    Must survive images without features, empty depth and repeated views; must say `degenerate` or `lost` rather than
    return a confident guess; the covariance must be symmetric and positive definite. An odometry whose metres do not come
    from depth or wheels may have `scale_from`, a few words for the row: what fixes its scale. One that loses itself where
    the robot turns on the spot may have `keeps_moving = (metres, degrees)`: the patrol then turns on arcs, and goes and
    turns no further between two views."""

    def update(self, observation: Observation) -> Motion: ...

    def revise(self) -> Revision | None:
        """At the end of the survey: better poses, scans and walls for all views so far, or None."""


class LoopCloser(Protocol):
    """Finds loops in a survey and corrects its poses. Must return as many poses as views, the first unchanged."""

    def close(self, views: Sequence[View]) -> Closure: ...


class Mapper(Protocol):
    """Draws an occupancy grid from scans. `update` must not keep references to its arguments."""

    def update(self, map_from_body: np.ndarray, scan: Scan) -> None: ...

    def grid(self) -> OccupancyGrid: ...

    def reset(self) -> None: ...


class Planner(Protocol):
    """Finds a path over a grid that is already grown by the robot's radius.

    Start and goal are returned exactly as first and last point. A failure is a Path with a reason, never an exception;
    an approximate path is a failure. Budgets are counted in iterations. What was learnt on one grid may be kept for it.
    """

    def plan(self, problem: PlanningProblem) -> Path: ...


class Localiser(Protocol):
    """Keeps the belief while the robot patrols the map of its survey."""

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """Take the surveyed views (corrected poses) and the finished map."""

    def start(self, belief: Belief | None) -> None:
        """Begin from a belief, or from nothing (None: anywhere)."""

    def update(self, observation: Observation, motion: Motion) -> Belief: ...
