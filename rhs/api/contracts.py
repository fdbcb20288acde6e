"""What each kind of part must do. Plugin authors read this.

A plugin is one dataclass named by one entry point in a group `rhs.<kind>`. The dataclass holds the settings (all with
defaults, units in the names: numbers, bool, str, Path, Enum, Literal, list, tuple, dict, nested dataclasses, `| None`; what
is not finite is refused), keeps their ranges (`Bounded` and `within` of rhs.api, or checks in `__post_init__`), declares

    needs: ClassVar[frozenset[str]]      what it takes from the parts before it
    provides: ClassVar[frozenset[str]]   what it offers to the parts after it

and has `build(context) -> part`, where heavy libraries are imported. Words used by needs/provides:
`image`, `depth`, `scan`, `wheel`, `command`, `driving` (the source can be driven), `teleport`, `walls`, `gray`, `texture`
(the source has `texture(along_m, around_m)`, the true grey of its wall, for the judge of task=unroll). Any other word names
an extra modality: an array of numbers that travels by that name in `Capture.extras` and `Observation.extras` (`imu`,
`right_image`, ...), past every sensor; it is recorded and replayed (of two cameras: rhs.api.stereo). `extras` in a source's
provides: which ones is known when it is open.

Parts get randomness only from `context.rng`, and never see a true pose. Arrays they receive are read-only.
"""

from __future__ import annotations

import inspect
import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from numbers import Integral, Real
from pathlib import Path as FilePath
from typing import Any, ClassVar, Protocol, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from .engine import Engine
from .errors import Bounded, ContractError
from .floorplan import World
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

API_VERSION = 1  # of the contracts in this module; a plugin that declares a newer one is refused
# The parts of the chain, in building order ...
KINDS = ("source", "sensor", "odometry", "loop_closer", "mapper", "planner", "localiser", "replan")
# ... a part that takes the place of several of them ...
SLAM = "slam"
REPLACED_BY_SLAM = ("odometry", "loop_closer", "mapper", "localiser")
# ... what spoils captures before the sensor, none, one or several of them (degrade=a+b) ...
DEGRADE = "degrade"
# ... the kinds that a run chooses by kind=name ...
CHOICES = ("task", *KINDS, SLAM, DEGRADE)
# ... and every kind of plugin there is, each an entry point group `rhs.<kind>`.
PLUGIN_KINDS = ("task", *KINDS, SLAM, DEGRADE, "metric", "engine")


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


_Given = TypeVar("_Given", contravariant=True)
_Part = TypeVar("_Part", covariant=True)


class Plugin(Protocol[_Given, _Part]):
    """The dataclass an entry point names: `Plugin[Context, Odometry]`, of a source `Plugin[SourceContext, Source]`. It may
    also have `preload: ClassVar[tuple[str, ...]]`, heavy modules of build() that are loaded once for all jobs of a sweep."""

    needs: ClassVar[frozenset[str]]
    provides: ClassVar[frozenset[str]]

    def build(self, context: _Given) -> _Part: ...


class PartSettings(Bounded):
    """Settings of a part that takes nothing from the parts before it and offers nothing to those after it, unless the
    dataclass derived from this says otherwise."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()


class Source(Protocol):
    """Hands out ideal captures: a simulator or a recording. Its `build` gets a SourceContext instead.

    Stamps increase from each capture to the next, also from the survey to the patrol. `travel` is
    `previous_from_body` of the wheels: dx ahead, dy left, dyaw counter-clockwise, in the body frame of the previous view.
    Of a recording camera, facts and `lead` will do. A class that derives from Source has the defaults below; one that does
    not is given them (`complete`)."""

    camera: Camera
    facts: WorldFacts  # of the simulated world, or what a recording tells (no places, bounds round its start)
    views_expected: int | None = None  # length of the survey for the progress bar, None when unknown
    provides: frozenset[str] | None = None  # what it turned out to hold, if that is less than its settings promise
    renderer: str = ""  # for the row: what draws its images, of a simulator
    stamps_repaired: int = 0  # for the row: stamps of a recording that stepped back and were put right; no view is lost
    lost: str = ""  # for the row: what could not be read, of a damaged recording
    views_lost: int = 0  # for the row: views so far that were never handed out, unreadable ones of a recording
    timed: bool = True  # False: its stamps only count views (numbered images without times); no speed is judged by them
    # whether lead, truth and clearance_m may be called by another thread than the one that built it, one call at a time, for
    # views that nobody has asked for yet
    leads_ahead: bool = False

    def lead(self) -> Capture | None:
        """The next view of the survey: the robot led along its route, or the next recorded view. None at the end."""

    def begin_patrol(self) -> None:
        """The survey is over: put in the obstacles that the map must not know."""
        return

    def drive(self, command: Twist) -> Capture:
        """Drive on a command, then look. Only sources that provide `driving`."""
        raise ContractError(f"{type(self).__name__} has no drive(command); one that provides `driving` must have it")

    def teleport(self, world_from_body: np.ndarray) -> None:
        """Put the robot elsewhere without telling it. Only sources that provide `teleport`."""
        raise ContractError(f"{type(self).__name__} has no teleport(pose); one that provides `teleport` must have it")

    def truth(self) -> np.ndarray | None:
        """True world_from_body (4x4) of the last capture, or None when nobody knows. Never handed to an estimator."""
        return None

    def clearance_m(self) -> tuple[float, bool]:
        """Least true distance to anything since the last call, and whether the robot touched something. NaN: unknown."""
        return math.nan, False

    def close(self) -> None:
        """Let go of files and processes."""
        return


class Degradation(Protocol):
    """Spoils captures on their way from the source to the sensor: blur, darkness, delay, wheels that slip.

    Simulated and recorded captures alike. `degrade` is called once for each capture, in order. Index and stamp stay; arrays
    are replaced, never written to; randomness comes from `context.rng` only. `context.camera` is the true one. The truth
    passes by, and no part is told what was done. A class that derives from Degradation tells the camera as it is."""

    def told(self, camera: Camera) -> Camera:
        """The camera that sensor and estimators are told of."""
        return camera

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture | None:
        """The capture to hand on, or None: this view never arrives, and the robot goes on with its command.

        previous_from_body (4x4): true motion of the body since the capture before, the identity at the first; None where
        nobody knows."""


class Sensor(Protocol):
    """Degrades a Capture into an Observation: range, noise, one camera only. May be called once per capture, in order.

    Index and stamp are the capture's. Scan bearings are counted from the body's x axis, left positive; ranges are metres
    from `origin_xy_m`, which is in the body frame. Noise comes from `context.rng` only: one seed, one observation."""

    # whether sense may be called by another thread than the one that built it, before the view is asked for
    senses_ahead: bool = False

    def sense(self, capture: Capture) -> Observation: ...


class Odometry(Protocol):
    """Estimates motion from one observation to the next. The first call returns the identity, status ok.

    The motion is `previous_from_body`: the pose of the body now in the body frame of the previous observation, so a robot
    that drove 0.1 m ahead and turned left has x = +0.1 and a positive yaw. Metres and radians; never summed up since the
    start. The covariance is of the right perturbation `previous_from_body @ exp(delta)`, order (x, y, z, rx, ry, rz), so
    it is in the body frame of *this* observation; it is symmetric and positive definite, and as wide as the errors are:
    motions with status ok are held against the truth by rhs.testing and by `python -m rhs card`.

    Must survive images without features, empty depth and repeated views; must say `degenerate` or `lost` rather than
    return a confident guess. A class that derives from Odometry has the defaults below; one that does not is given them
    (`complete`)."""

    # one that loses itself where the robot turns on the spot says (metres, degrees) here: the patrol then turns on arcs, and
    # goes and turns no further between two views
    keeps_moving: tuple[float, float] | None = None
    # one that compares neighbouring views says (metres, degrees) here: the patrol goes and turns no further between two
    short_steps: tuple[float, float] | None = None
    # what fixes the scale of one whose metres do not come from depth or wheels, a few words for the row
    scale_from: str = ""

    def update(self, observation: Observation) -> Motion: ...

    def revise(self) -> Revision | None:
        """At the end of the survey: better poses, scans and walls for all views so far, or None. The poses may be in any
        frame: they are moved so that the first is where the survey began."""
        return None


class LoopCloser(Protocol):
    """Finds loops in a survey and corrects its poses. Must return as many poses `map_from_body` as views, the first
    unchanged. An edge says where the later view is seen from the earlier: `earlier_from_later`, with the covariance of
    its right perturbation (in the body frame of the later view)."""

    def close(self, views: Sequence[View]) -> Closure: ...


class Mapper(Protocol):
    """Draws an occupancy grid in the map frame from scans. `update` must not keep references to its arguments.

    A beam of a scan leaves `map_from_body @ origin_xy_m` under the body's yaw plus its bearing. Row 0 of the grid is the
    least y, column 0 the least x; cell (0, 0) has its corner at `origin_m`. Things below the scan (Observation.obstacle) are
    drawn over its grid by whoever asked for it."""

    # one that knows of things below the scan already: nothing is drawn over its grid
    draws_furniture: bool = False

    def update(self, map_from_body: np.ndarray, scan: Scan) -> None: ...

    def grid(self) -> OccupancyGrid: ...

    def reset(self) -> None: ...


class Planner(Protocol):
    """Finds a path over a grid that is already grown by the robot's radius.

    Start and goal are returned as first and last point (exactly, or as a float32 rounds them), metres in the map frame, as
    an array or a list; in between the path may touch
    blocked cells but not enter them, nor pass between two that meet corner to corner (rhs.api.segments). A start inside
    blocked cells, an obstacle seen too late, is either `start_blocked` or left by a short way; the goal must be free.
    A failure is a Path with a reason and without points, never an exception; an approximate path is a failure. Budgets are
    counted in iterations. What was learnt on one grid may be kept for it, and must not be taken for another.
    """

    def plan(self, problem: PlanningProblem) -> Path: ...


class Blocked(StrEnum):
    """What a robot does whose way is blocked by something that the map does not know."""

    REPLAN = "replan"
    """plan again from here, in the same mission"""
    NEW_MISSION = "new_mission"
    """break the mission off and begin another to the same place (thesis 5.6)"""
    WAIT = "wait"
    """stand still for this view and look again"""
    SKIP = "skip"
    """go on with the next place, come back to this one when the others are done; without another place, or after
    mission.tries of it: leave this place out"""
    ASK = "ask"
    """as wait, and say that somebody is asked what to do"""
    GIVE_UP = "give_up"
    """leave this place out"""


@dataclass(frozen=True, eq=False)
class Blockage:
    """Something stands on the path. at_m: (2,) its middle, metres in the map. known: it stood there before in the attempts
    at this place. waited: views waited for it already. skipped: times this place was put off already. others: other places
    left that were not put off here. no_way: there is no way round what was seen; new_mission and replan then look round
    once more, and leave the place out if that does not help."""

    at_m: np.ndarray
    known: bool
    waited: int
    skipped: int = 0
    others: int = 0
    no_way: bool = False


class Replan(Protocol):
    """Decides what to do when the way is blocked: asked in each view in which it is."""

    def blocked(self, blockage: Blockage) -> Blocked: ...


class Slam(Protocol):
    """One part that estimates motion, draws the map, closes loops and localises, all the time, survey and patrol alike.

    It takes the place of odometry, loop closer, mapper and localiser (`slam=NAME`). `update` is called once per view;
    `belief`, `trajectory` and `grid` then say what is believed now.
    """

    def update(self, observation: Observation) -> Motion:
        """Motion since the previous view, as an Odometry returns it."""

    def belief(self) -> Belief:
        """Where the robot is in the map of now."""

    def trajectory(self) -> np.ndarray:
        """(N, 4, 4) map_from_body of every view so far, as believed now."""

    def grid(self) -> OccupancyGrid:
        """The map of now. The patrol takes a new one at the beginning of each mission."""


class Localiser(Protocol):
    """Keeps the belief while the robot patrols the map of its survey.

    The belief is `map_from_body` with the covariance of its right perturbation, in the body frame: a motion adds to it by
    `rhs.api.geometry.compose_covariance`, adjoint included, so an error of heading grows to the side as the robot drives."""

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """Take the surveyed views (corrected poses) and the finished map."""

    def start(self, belief: Belief | None) -> None:
        """Begin from a belief, or from nothing (None: anywhere)."""

    def update(self, observation: Observation, motion: Motion) -> Belief: ...


PROTOCOLS: dict[str, type] = {"source": Source, "sensor": Sensor, "odometry": Odometry, "loop_closer": LoopCloser,
                              "mapper": Mapper, "planner": Planner, "localiser": Localiser, "replan": Replan, SLAM: Slam,
                              DEGRADE: Degradation, "engine": Engine}
OPTIONAL = {"source": ("views_expected", "provides", "renderer", "stamps_repaired", "lost", "views_lost", "timed",
                       "leads_ahead", "begin_patrol", "drive", "teleport", "truth", "clearance_m", "close"),
            "sensor": ("senses_ahead",), "mapper": ("draws_furniture",), DEGRADE: ("told",),
            "engine": ("chunk_s", "processes", "alive", "workers", "close"),
            "odometry": ("keeps_moving", "short_steps", "scale_from", "revise")}


def complete(kind: str, part: Any) -> Any:
    """The part itself, given the defaults of its Protocol for what is optional there and missing.

    Raises ContractError in words for its author: it lacks a method, has one with other arguments, says something of another
    type than the Protocol's, or takes no defaults."""
    protocol, optional = PROTOCOLS.get(kind, object), OPTIONAL.get(kind, ())
    for name in (name for name in (*protocol.__dict__.get("__annotations__", ()), *vars(protocol)) if name[0] != "_"):
        default, own = getattr(protocol, name, None), getattr(part, name, None)
        if name in optional and not hasattr(part, name):
            try:
                setattr(part, name, partial(default, part) if callable(default) else default)
            except (AttributeError, TypeError):
                raise ContractError(f"{kind} {type(part).__name__} has no {name} and takes none; derive it from "
                                    f"rhs.api.contracts.{protocol.__name__}") from None
        elif name not in optional and (not hasattr(part, name) or getattr(type(part), name, part) is default):
            raise ContractError(f"{type(part).__name__}, which build() returned, has no {_call(name, default)}")
        elif callable(default) and (wrong := _unlike(own, name, default)):
            raise ContractError(f"{type(part).__name__}.{name} {wrong}")
        elif name in optional and not callable(default) and not _is(own, get_type_hints(protocol)[name]):
            raise ContractError(f"{type(part).__name__}.{name} is {reprlib.repr(own)}; expected "
                                f"{protocol.__annotations__[name]}")
    return part


def _is(value: Any, hint: Any) -> bool:
    """Whether a value is what an annotation of a Protocol says; numbers are finite, those in pairs above 0."""
    inner = get_args(hint)
    if get_origin(hint) is tuple:
        return isinstance(value, tuple | list) and len(value) == len(inner) and all(_is(v, float) and v > 0 for v in value)
    if get_origin(hint) is frozenset:
        return isinstance(value, frozenset | set) and all(_is(one, inner[0]) for one in value)
    if inner:
        return any(_is(value, one) for one in inner)
    wanted = {float: Real, int: Integral, bool: bool | np.bool_}.get(hint, hint)
    return isinstance(value, wanted) and (hint is not float or math.isfinite(value))


def _arguments(method: Any) -> list[str]:
    return list(inspect.signature(method).parameters)[1:]


def _call(name: str, method: Any) -> str:
    """A method as it is called; an attribute by its name alone."""
    return f"{name}({', '.join(_arguments(method))})" if callable(method) else name


def _unlike(own: Any, name: str, method: Any) -> str:
    """Why `own` cannot stand for this method of a Protocol; nothing where it can, or nobody can tell."""
    if inspect.isgeneratorfunction(own) or inspect.iscoroutinefunction(own):
        return "yields or is async, so that a call runs nothing of it; write a plain method that returns"
    try:
        inspect.signature(own).bind(*_arguments(method))
    except TypeError:
        return f"cannot be called as {_call(name, method)}"
    except ValueError:
        pass
    return ""
