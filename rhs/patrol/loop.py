"""THE loop: sense, odometry, localise, map, plan, drive; one Step per captured view.

The same loop leads the camera round the survey and drives the patrol; only the pilot differs. Recorders, metrics,
pictures and the progress bar consume the steps it yields; they never reach into it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rhs.api.belief import moved
from rhs.api.contracts import Odometry, Sensor, Source
from rhs.api.frozen import freeze, with_frozen_copies
from rhs.api.records import Belief, Capture, Motion, Observation, Path, Scan, Step, Twist
from rhs.base.errors import ContractError


@dataclass(frozen=True)
class Decision:
    """What the pilot wants: a command (None ends the loop for a driven robot), the path it follows, what happened."""

    command: Twist | None = None
    path: Path | None = None
    event: str = ""
    mission: int = 0


class Pilot(Protocol):
    """Who moves the robot: the person leading it round the survey, or the sentinel on patrol."""

    phase: str

    def first(self, source: Source) -> Capture | None: ...

    def locate(self, observation: Observation, motion: Motion) -> Belief: ...

    def note(self, belief: Belief, scan: Scan) -> None: ...

    def decide(self, belief: Belief, scan: Scan | None) -> Decision: ...

    def move(self, source: Source, command: Twist | None) -> Capture | None: ...


def steps(source: Source, sensor: Sensor, odometry: Odometry, pilot: Pilot, *, first_index: int = 0) -> Iterator[Step]:
    """Yield one Step per view until the pilot stops."""
    clock, index = Stopwatch(), first_index
    with clock("capture"):
        capture = pilot.first(source)
    while capture is not None:
        with clock("sense"):
            observation = freeze(sensor.sense(freeze(capture)))
        with clock("odometry"):
            motion = checked_motion(odometry.update(observation), odometry)
        with clock("localise"):
            belief = checked_belief(pilot.locate(observation, motion), pilot)
        scan = observation.scan if observation.scan is not None else motion.scan
        with clock("map"):
            if scan is not None:
                pilot.note(belief, scan)
        with clock("plan"):
            decision = pilot.decide(belief, scan)
        clearance_m, collided = source.clearance_m()
        yield Step(index, pilot.phase, capture.stamp_s, observation, motion, belief, scan, source.truth(),
                   decision.path, decision.mission, decision.event, capture.command, clock.timings_ms,
                   clearance_m, collided)
        clock, index = Stopwatch(), index + 1
        with clock("capture"):
            capture = pilot.move(source, decision.command)


class Led:
    """The survey: somebody leads the camera along its route; the belief is the sum of the odometry."""

    phase = "survey"

    def __init__(self, start: np.ndarray, mapper) -> None:
        self.belief = Belief(start, np.diag([1e-6] * 6))
        self.mapper = mapper
        self.begun = False

    def first(self, source: Source) -> Capture | None:
        return source.lead()

    def locate(self, observation: Observation, motion: Motion) -> Belief:
        self.belief = moved(self.belief, motion) if self.begun else self.belief
        self.begun = True
        return self.belief

    def note(self, belief: Belief, scan: Scan) -> None:
        self.mapper.update(belief.map_from_body, scan)

    def decide(self, belief: Belief, scan: Scan | None) -> Decision:
        return Decision()

    def move(self, source: Source, command: Twist | None) -> Capture | None:
        return source.lead()


def checked_motion(motion: Motion, part: object) -> Motion:
    """The motion, or ContractError naming the part and the field: a bad value never reaches a table."""
    if not isinstance(motion, Motion):
        raise ContractError(f"odometry {type(part).__name__} returned {type(motion).__name__}, expected a Motion")
    _check_pose(motion.previous_from_body, part, "previous_from_body")
    _check_covariance(motion.covariance, part)
    return with_frozen_copies(motion, "previous_from_body", "covariance")


def checked_belief(belief: Belief, part: object) -> Belief:
    """The belief, or ContractError naming the part and the field."""
    if not isinstance(belief, Belief):
        raise ContractError(f"localiser {type(part).__name__} returned {type(belief).__name__}, expected a Belief")
    _check_pose(belief.map_from_body, part, "map_from_body")
    _check_covariance(belief.covariance, part)
    return with_frozen_copies(belief, "map_from_body", "covariance")


def _check_pose(pose: np.ndarray, part: object, name: str) -> None:
    who = type(part).__name__
    if np.shape(pose) != (4, 4) or not np.all(np.isfinite(pose)):
        raise ContractError(f"{who}.{name} must be a finite 4x4 pose, got shape {np.shape(pose)}: {np.asarray(pose)}")
    if abs(np.linalg.det(pose[:3, :3]) - 1.0) > 1e-3:
        raise ContractError(f"{who}.{name} has a rotation with determinant {np.linalg.det(pose[:3, :3]):.4g}, not 1")


def _check_covariance(covariance: np.ndarray, part: object) -> None:
    if np.shape(covariance) != (6, 6) or not np.all(np.isfinite(covariance)):
        raise ContractError(f"{type(part).__name__}.covariance must be finite 6x6, got shape {np.shape(covariance)}")


class Stopwatch:
    """Collects the milliseconds spent in named stages."""

    def __init__(self) -> None:
        self.timings_ms: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self.timings_ms[stage] = self.timings_ms.get(stage, 0.0) + 1e3 * (time.perf_counter() - begin)
