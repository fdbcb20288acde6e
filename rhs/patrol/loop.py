"""THE loop: sense, odometry, localise, map, plan, drive; one Step per captured view.

The same loop leads the camera round the survey and drives the patrol; only the pilot differs. Recorders, metrics,
pictures and the progress bar consume the steps it yields; they never reach into it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rhs.api.belief import moved
from rhs.api.contracts import Mapper, Odometry, Sensor, Slam, Source
from rhs.api.records import Belief, Capture, Event, Motion, Observation, Path, Scan, Step, Twist
from rhs.api.validate import check_belief, check_motion, reach_of

from .eyes import Ahead, Eyes, Looked, Remembered
from .gate import GatedOdometry


@dataclass(frozen=True)
class Decision:
    """What the pilot wants: a command (None ends the loop for a driven robot), the path it follows, what happened."""

    command: Twist | None = None
    path: Path | None = None
    events: tuple[Event, ...] = ()
    mission: int = 0


class Pilot(Protocol):
    """Who moves the robot: the person leading it round the survey, or the sentinel on patrol."""

    phase: str
    believer: str  # the kind of part whose belief it hands on, to be named if that is no belief

    def first(self, source: Source) -> Capture | None: ...

    def locate(self, observation: Observation, motion: Motion) -> Belief: ...

    def note(self, belief: Belief, scan: Scan) -> None: ...

    def decide(self, belief: Belief, scan: Scan | None) -> Decision: ...

    def move(self, source: Source, command: Twist | None) -> Capture | None: ...


def steps(source: Source, sensor: Sensor, odometry: Odometry, pilot: Pilot, *, first_index: int = 0,
          after_s: float = -np.inf, who: Mapping[str, str] | None = None,
          eyes: Eyes | Ahead | Remembered | None = None) -> Iterator[Step]:
    """Yield one Step per view until the pilot stops. What a part hands over is checked before it goes on (rhs.api.validate).

    after_s: stamp of the last view before. who: kind -> the part as a person typed it, for errors. eyes: that take the views
    of this source and sensor; closed at the end."""
    named = who or names(source=source, sensor=sensor, odometry=odometry, localiser=getattr(pilot, "localiser", pilot))
    look, index = eyes or Eyes(source, sensor, named, after_s=after_s), first_index
    try:
        looked = look(lambda: pilot.first(source))
        while looked is not None:
            step, command = estimated(looked, odometry, pilot, index=index, who=named, reach_m=reach_of(source.facts))
            yield step
            index += 1
            looked = look(lambda command=command: pilot.move(source, command))  # type: ignore[misc]
    finally:
        look.close()


def estimated(looked: Looked, odometry: Odometry, pilot: Pilot, *, index: int, who: Mapping[str, str],
              reach_m: float) -> tuple[Step, Twist | None]:
    """What is made of a view: odometry, localise, map, plan; the step and the pilot's command."""
    capture, observation, clock = looked.capture, looked.observation, looked.clock
    with clock("odometry"):
        motion = check_motion(odometry.update(observation), who=who["odometry"], reach_m=reach_m,
                              gated=isinstance(odometry, GatedOdometry))
    with clock("localise"):
        belief = check_belief(pilot.locate(observation, motion), who=who[pilot.believer], reach_m=reach_m)
    scan = observation.scan if observation.scan is not None else motion.scan
    with clock("map"):
        if scan is not None:
            pilot.note(belief, scan)
    with clock("plan"):
        decision = pilot.decide(belief, scan)
    true = looked.judged()
    step = Step(index, pilot.phase, capture.stamp_s, observation, motion, belief, scan, true.truth, decision.path,
                decision.mission, decision.events, capture.command, clock.timings_ms, true.clearance_m, true.collided)
    return step, decision.command


def end_of(steps: Iterator[Step]) -> Any:
    """What a generator of steps returns at its end; the steps go by."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def names(**parts: object) -> dict[str, str]:
    """Kind -> what to call a part whose name on the command line is not known."""
    return {kind: f"{kind} {type(part).__name__}" for kind, part in parts.items()}


class Led:
    """The survey: somebody leads the camera along its route; the belief is the sum of the odometry, or a SLAM's own. mapper:
    None where nothing is drawn."""

    phase, believer = "survey", "odometry"

    def __init__(self, start: np.ndarray, mapper: Mapper | None, slam: Slam | None = None) -> None:
        self.belief = Belief(start, np.diag([1e-6] * 6))
        self.mapper, self.slam = mapper, slam
        self.begun = False

    def first(self, source: Source) -> Capture | None:
        return source.lead()

    def locate(self, observation: Observation, motion: Motion) -> Belief:
        if self.slam is not None:
            return self.slam.belief()
        self.belief = moved(self.belief, motion) if self.begun else self.belief
        self.begun = True
        return self.belief

    def note(self, belief: Belief, scan: Scan) -> None:
        if self.mapper is not None:
            self.mapper.update(belief.map_from_body, scan)

    def decide(self, belief: Belief, scan: Scan | None) -> Decision:
        return Decision()

    def move(self, source: Source, command: Twist | None) -> Capture | None:
        return source.lead()
