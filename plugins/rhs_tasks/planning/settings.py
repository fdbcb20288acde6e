"""Settings of the task that plans alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import ClassVar

from rhs.api.contracts import PartSettings
from rhs.api.errors import Bounded, ConfigError, within
from rhs.api.task import Job, TaskContext


@dataclass
class Problem(Bounded):
    """What is planned for."""

    robot_radius_m: float | None = within(None, 0.0, 100.0)
    """the map is grown by this radius, metres; null: what the map or world says"""
    scenario: int = within(0, 0, 10_000_000)
    """which problem of a MovingAI .scen file, from 0"""
    shorten: bool = True
    """pull every planner's path tight before it is measured; the length it was found with stands beside"""
    start_radius_m: float = within(0.3, 0.0, 10.0)
    """a start in a blocked cell may be left over blocked cells this near, metres"""



@dataclass
class Planning(PartSettings):
    """A planner alone on a map: its path is judged and stands beside the true shortest one."""

    start: list[float] = field(default_factory=list)
    """where to start, [x_m, y_m]; empty: the world's"""
    goal: list[float] = field(default_factory=list)
    """where to go, [x_m, y_m]; empty: the world's"""
    planning: Problem = field(default_factory=Problem)

    kinds: ClassVar[tuple[str, ...]] = ("planner",)
    preload: ClassVar[tuple[str, ...]] = ("rhs_tasks.planning.task",)

    def __post_init__(self) -> None:
        for key in ("start", "goal"):
            values = getattr(self, key)
            if values and (len(values) != 2 or not all(map(isfinite, values))):
                raise ConfigError(f"{key}={list(values)}: expected 2 finite numbers")

    def build(self, context: TaskContext) -> Job:
        from .task import PlanningJob

        return PlanningJob(self, context)
