"""Settings of the task that localises in a given map."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar

from rhs.api.contracts import PartSettings
from rhs.api.errors import ConfigError, within
from rhs.api.task import Job, TaskContext


@dataclass
class Localise(PartSettings):
    """A localiser alone in a map made before, on a recording or a robot led along its route: how soon it finds itself, and
    whether it knows."""

    map: str = ""
    """where it is looked for: a ROS map (map.yaml), the folder of a run (its map, and its survey's views as places), or a
    floor plan (a world of worlds/, or its file); with a recording world= says the same"""
    start: Any = "unknown"
    """where it begins: unknown (anywhere in the map), [x_m, y_m, yaw_deg] in the frame of the map, or known: the true pose
    of the first view, where the recording or the simulator has one"""
    start_sigma_m: float = within(0.1, 1e-3, 100.0)
    """how well a start that is told is known, metres (1 sigma)"""
    start_sigma_deg: float = within(3.0, 0.01, 180.0)
    """and its heading, degrees (1 sigma)"""
    restart_every_m: float = within(0.0, 0.0, 1e6)
    """after so much way (as the odometry has it) everything is forgotten and the localiser starts from nothing, metres: many
    trials of one recording; 0: never"""
    kidnap_every_m: float = within(0.0, 0.0, 1e6)
    """after so much true way the robot is carried off: the views of a stretch are left out, and nobody is told, metres; 0:
    never"""
    kidnap_skip_m: float = within(5.0, 0.1, 1e6)
    """length of the stretch that is left out then, metres"""

    kinds: ClassVar[tuple[str, ...]] = ("source", "sensor", "odometry", "localiser")

    def __post_init__(self) -> None:
        self.start = checked_start(self.start)
        super().__post_init__()
        if self.restart_every_m and self.start != "unknown":
            raise ConfigError(f"restart_every_m={self.restart_every_m:g} starts from nothing again and again; leave out "
                              "start=")

    def build(self, context: TaskContext) -> Job:
        from .task import LocaliseJob

        return LocaliseJob(self, context)


def checked_start(start: Any) -> Any:
    """`unknown`, `known`, or three finite numbers; anything else is refused."""
    if start in ("unknown", "known"):
        return start
    try:
        numbers = [float(value) for value in start] if not isinstance(start, str) else []
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != 3 or not all(map(isfinite, numbers)):
        raise ConfigError(f"start={start}: expected unknown, known, or [x_m,y_m,yaw_deg], for example start=[1.0,2.0,90]; "
                          "to be carried off on the way: kidnap_every_m=10")
    return numbers
