"""The tasks that go through the loop: map a building (survey; explore, where nobody leads), and patrol what was mapped
(patrol). Settings only; the work is in rhs.patrol.job."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, ClassVar, TypeGuard

from rhs.api.contracts import PartSettings
from rhs.api.errors import Bounded, ConfigError, check_range, one_of, within
from rhs.estimation.views.settings import CameraFitSettings
from rhs.worlds.world_moving import walkers

from .mission import MissionSettings

if TYPE_CHECKING:
    from .job import PatrolJob
    from .run import RunContext


@dataclass
class StoredViews(Bounded):
    """Which views are kept as places."""

    every: int = within(3, 1, 100_000)
    """a view is stored every so many steps of the survey (thesis 5.2: 3)"""
    most_mb: float = within(60.0, 1.0, 1e6)
    """what their key-points may take, megabytes (0.07 a view at 320x240, 0.2 at 640x480): beyond it those whose place
    another view shows as well are given up"""


@dataclass
class Gate(Bounded):
    """When vision is not believed."""

    act: str = one_of("contradiction", "off")
    """contradiction: wheels (or the last speed) replace a motion that contradicts them; off: an odometry is believed.
    Only odometries that need depth are gated: those of one camera weave wheels and commands in themselves"""
    probability: float = within(0.999999, 0.5, 1.0 - 1e-12)
    """chance that a good motion passes; the rest, one in a million, is replaced by the wheels"""
    wheel_share: float = within(0.1, 0.0, 1.0)
    """error of the wheels (1 sigma) as a share of distance and turn: wider than encoders are, for time stamps that do not
    fit and floors that are not flat"""
    wheel_least_m: float = within(0.02, 1e-6, 10.0)
    """and of the distance at least so much, metres (1 sigma)"""
    wheel_least_rad: float = within(0.02, 1e-6, 3.0)
    """and of the turn at least so much, radians (1 sigma)"""
    slip_share: float = within(0.5, 0.0, 1.0)
    """wheels that spin may count up to this share of their travel without moving the robot"""
    patience: int = within(10, 1, 1_000_000)
    """after so many contradictions on end the wheels are doubted, not vision"""
    leap_mps: float = within(3.0, 0.01, 1000.0)
    """without wheels: greatest change of speed between two views, m/s; hands and robots stay far below"""
    leap_radps: float = within(6.0, 0.01, 1000.0)
    """and of turn rate, rad/s"""


@dataclass
class Survey(PartSettings):
    """Map only: the camera is led along its route, the loop closed, the map drawn."""

    places: StoredViews = field(default_factory=StoredViews)
    gate: Gate = field(default_factory=Gate)
    camera_fit: CameraFitSettings = field(default_factory=CameraFitSettings)

    kinds: ClassVar[tuple[str, ...]] = ("source", "sensor", "odometry", "loop_closer", "mapper")

    def build(self, context: RunContext) -> PatrolJob:
        from .job import PatrolJob, world_of

        context.draw_beside()
        return PatrolJob(self, context, world_of(self, context))


@dataclass
class Patrol(Survey):
    """Map, then visit the places of the world in order on the robot's own belief; of a recording the map alone."""

    obstacles: list[list[float]] = field(default_factory=list)
    """boxes the map does not know, put in when the patrol begins: [[x_m, y_m, width_m, depth_m], ...]"""
    people: list[list[float]] = field(default_factory=list)
    """people who walk about during the patrol, besides those of the world, each a closed path: [[x1, y1, x2, y2, ...], ...],
    metres; 0.8 m/s, standing for a robot in their way"""
    obstacle_count: int = within(0, 0, 1000)
    """besides these so many boxes of 0.3 to 0.6 m that the survey did not see, drawn by the seed beside its way and behind
    corners; none closes a way (`python -m rhs break obstacle_count=0..12`)"""
    moved_count: int = within(0, 0, 1000)
    """so many chairs, crates, bins and the like of the world stand elsewhere when the patrol begins, or are gone, drawn by
    the seed"""
    people_count: int = within(0, 0, 1000)
    """besides these so many people (a quarter are pets) who walk there and back during the patrol, drawn by the seed"""
    mission: MissionSettings = field(default_factory=MissionSettings)

    kinds: ClassVar[tuple[str, ...]] = (*Survey.kinds, "planner", "localiser", "replan")

    def __post_init__(self) -> None:
        super().__post_init__()
        for box in self.obstacles:
            if len(box) != 4 or not all(map(isfinite, box)):
                raise ConfigError(f"obstacles={list(box)}: expected 4 finite numbers: x_m, y_m, width_m, depth_m")
            check_range("obstacles", "width_m", box[2], low=0.01, high=1000.0, unit="m")
            check_range("obstacles", "depth_m", box[3], low=0.01, high=1000.0, unit="m")
        walkers(self.people)


@dataclass
class Explore(Survey):
    """Map only, and nobody leads: the robot looks where most is left to see until nothing is, and drives home."""

    mission: MissionSettings = field(default_factory=lambda: MissionSettings(survey="explore"))

    needs: ClassVar[frozenset[str]] = frozenset({"driving"})
    kinds: ClassVar[tuple[str, ...]] = (*Survey.kinds, "planner")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mission.survey != "explore":
            raise ConfigError(f"mission.survey={self.mission.survey}: task=explore explores; type task=survey for a survey "
                              "that is led")


def explores(settings: Survey) -> TypeGuard[Patrol | Explore]:
    """Whether the robot draws its map by itself."""
    return isinstance(settings, Patrol | Explore) and settings.mission.survey == "explore"
