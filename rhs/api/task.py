"""What a task is: one kind of experiment, a plugin like every part of the chain (entry point group `rhs.task`).

The dataclass that an entry point in `rhs.task` names holds the task's settings, which stand at the top level of the
configuration (`python -m rhs task=planning start=[1,2]`), declares

    needs: ClassVar[frozenset[str]]      what it takes from the source (`driving`, ...)
    provides: ClassVar[frozenset[str]]   nothing, usually
    kinds: ClassVar[tuple[str, ...]]     the kinds of parts it is made of, in building order

and has `build(context: TaskContext) -> Job`. Whatever can be refused is refused in `build`, by a ConfigError; what fails
in `run` is a row with a reason. The configuration that a run keeps, its hash and its row cover the task, the kinds it
names and their settings, nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

from .contracts import Context, Localiser, LoopCloser, Mapper, Odometry, Planner, Replan, Sensor, Slam, Source
from .floorplan import World
from .records import FeatureSettings, Step

Value = float | int | str | bool | None


@dataclass
class Parts:
    """The parts a task asked for; those of other kinds are not there. provides: what all of them offer together.
    who: kind -> what it is called in an error: kind=name (distribution); degrade -> the typed ones that spoil pictures.
    slam: the one part behind odometry, loop closer, mapper and localiser, where there is one."""

    source: Source
    sensor: Sensor
    odometry: Odometry
    loop_closer: LoopCloser
    mapper: Mapper
    planner: Planner
    localiser: Localiser
    replan: Replan
    features: FeatureSettings
    provides: frozenset[str]
    who: dict[str, str]
    slam: Slam | None = None


class TaskContext(Protocol):
    """All that `build` of a task gets.

    seed: of every random number of the run. folder: the run folder; what is written there is kept. world: the world that
    was typed. features: settings of the features that all parts share.
    """

    seed: int
    folder: Path
    world: str
    features: FeatureSettings

    def settings(self, kind: str) -> Any:
        """The settings dataclass chosen for a kind of part, as it will be built."""

    def who(self, kind: str) -> str:
        """What the part of a kind is called in an error: kind=name (distribution)."""

    def floor_plan(self) -> World | None:
        """The true world that was typed, or None where the source is a recording."""

    def parts(self, *, world: World | None = None, seed: int | None = None,
              changes: Mapping[str, Mapping[str, Any]] | None = None) -> Parts:
        """Build the parts of the task's kinds, each with a generator of its own; they are closed when the run ends.

        world: instead of the one that was typed. seed: instead of the run's. changes: settings of a kind that differ,
        for example {"source": {"wobble_m": 0.3}}. Raises ConfigError where they do not fit each other."""

    def build_part(self, kind: str, context: Context) -> Any:
        """One part alone, built with this context: for kinds that need neither source nor sensor."""

    def lead(self, parts: Parts) -> Iterator[Step]:
        """The loop over the survey: the camera led along its route, one Step per view. It needs source, sensor and odometry;
        a mapper, where the task has one, is shown each scan."""

    def follow(self, steps: Iterable[Step], phase: str, expected: int | None = None) -> Iterator[Step]:
        """The same steps, written to the run folder and shown on the progress bar as they pass."""


class Job(Protocol):
    """A task ready to run."""

    def run(self) -> Mapping[str, Value] | None:
        """Do the work; the columns of the row that the task itself knows. Metrics add theirs from the run folder."""


class StepJob(ABC):
    """A task that goes through the loop: it is its steps."""

    @abstractmethod
    def steps(self) -> Iterator[Step]:
        """Every view, as it is taken."""

    def run(self) -> Mapping[str, Value]:
        """All of them; the columns follow from the files they leave."""
        for _ in self.steps():
            pass
        return {}


class Task(Protocol):
    """The settings dataclass of a task."""

    needs: ClassVar[frozenset[str]]
    provides: ClassVar[frozenset[str]]
    kinds: ClassVar[tuple[str, ...]]

    def build(self, context: TaskContext) -> Job: ...
