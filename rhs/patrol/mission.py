"""Missions: one goal each. A patrol is a list of them; this module keeps their book and decides when one is over."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rhs.api.contracts import Odometry
from rhs.api.errors import Bounded, one_of, within
from rhs.api.records import MissionStatus

from .frontiers import ExploreSettings
from .guard import GuardSettings

ELSEWHERE_M = 0.5  # so far off places put off may be tried again


@dataclass
class MissionAdvanced(Bounded):
    """Thresholds of the patrol."""

    unseen_m: float = within(1.0, 0.0, 1000.0)
    """where no way is left, ground that nobody has looked at is tried as far as this from what was seen to be free, metres:
    what a table hides, not the outside of the building; 0: none"""
    guard: GuardSettings = field(default_factory=GuardSettings)
    explore: ExploreSettings = field(default_factory=ExploreSettings)


@dataclass
class MissionSettings(Bounded):
    """How the patrol goes about its places."""

    survey: str = one_of("route", "explore")
    """who leads the survey: route, somebody along the world's route | explore, the robot itself: frontiers, then home"""
    arrive_m: float = within(0.25, 0.05, 5.0)
    """distance from a place at which it counts as visited, metres (belief)"""
    margin_m: float = within(0.1, 0.0, 2.0)
    """added to the robot's radius when the map is grown, metres: room for the error of the belief"""
    comfort_m: float = within(0.4, 0.0, 2.0)
    """room the robot would like on top of that, metres; less is taken where there is no way with it. It keeps a robot
    whose belief has drifted off the walls: going the other way round, nothing looks as it did in the survey"""
    tries: int = within(6, 1, 1000)
    """plans per place before it is given up"""
    stuck_steps: int = within(12, 2, 10000)
    """commands without progress (less than 5 cm believed motion each) before the place is given up"""
    views_max: int = within(3000, 1, 10_000_000)
    """views spent on one place before it is given up, whatever happens"""
    watch_m: float = within(2.5, 0.2, 20.0)
    """how far ahead the path is watched for obstacles, metres"""
    wall_tolerance_m: float = within(0.3, 0.0, 2.0)
    """scan points this close to a wall of the map are the wall, metres, of far beams; of near ones less"""
    update_map: bool = False
    """between two places the map forgets what was seen through in ten views and takes in what was seen to stand for ten
    seconds; false: the map is that of the survey, and what it does not know is remembered for one place"""
    look_m: float = within(0.0, 0.0, 100.0)
    """metres between two views on the way that are compared with the survey, as those at the places are; what two of them
    say is new or gone stands in the report. 0: places only"""
    contacts: int = within(3, 1, 10_000)
    """a place on the way to which the robot touched something more often is given up"""
    lost_views: int = within(400, 1, 10_000_000)
    """views of not knowing where it is before a place is given up"""
    lost_views_total: int = within(800, 1, 10_000_000)
    """the same of the whole patrol: then every place left is given up"""
    turn: str = one_of("auto", "pivot", "arc")
    """turn on the spot, or on an arc that keeps the camera moving: pivot | arc | auto, which takes what the odometry
    wants"""
    arc_radius_m: float = within(0.7, 0.1, 5.0)
    """radius of arc turns, metres"""
    step_m: float = within(0.25, 0.02, 2.0)
    """longest way between two views while patrolling, metres"""
    turn_step_deg: float = within(12.0, 1.0, 90.0)
    """largest turn between two views while patrolling, degrees"""
    speed_mps: float = within(0.5, 0.02, 3.0)
    """forward speed, metres per second"""
    kidnap: bool = False
    """carry the robot elsewhere, without telling it, once per place"""
    advanced: MissionAdvanced = field(default_factory=MissionAdvanced)


def turning(settings: MissionSettings, odometry: Odometry) -> MissionSettings:
    """The settings with `turn` decided: on arcs where it is left to one that `keeps_moving` (rhs.contracts), and in steps as
    short as the odometry wants them."""
    arcs = odometry.keeps_moving if settings.turn == "auto" else None
    wanted = arcs or odometry.short_steps
    turn = ("arc" if arcs else "pivot") if settings.turn == "auto" else settings.turn
    if wanted is None:
        return replace(settings, turn=turn)
    step_m, turn_step_deg = wanted
    return replace(settings, turn=turn, step_m=min(settings.step_m, step_m),
                   turn_step_deg=min(settings.turn_step_deg, turn_step_deg))


@dataclass
class Mission:
    """One attempt at one place, as written to missions.json."""

    mission: int
    place: str
    goal_m: list[float]
    start_m: list[float] | None  # of a robot that does not know where it is
    status: MissionStatus = MissionStatus.ACTIVE
    reason: str = ""
    replans: int = 0
    steps: int = 0


@dataclass
class Logbook:
    """The missions of a patrol, and the places still to visit."""

    places: tuple[tuple[str, float, float], ...]
    missions: list[Mission] = field(default_factory=list)
    visited: int = 0
    put_off_here: list[tuple[str, float, float]] = field(default_factory=list)  # places put off within ELSEWHERE_M of:
    put_off_at_m: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @property
    def current(self) -> Mission | None:
        return self.missions[-1] if self.missions and self.missions[-1].status is MissionStatus.ACTIVE else None

    @property
    def done(self) -> bool:
        return self.visited >= len(self.places) and self.current is None

    def open(self, at_m: np.ndarray | None) -> Mission:
        """Begin the mission to the next place, from (2,) metres; None: nobody knows from where."""
        name, x, y = self.places[self.visited]
        mission = Mission(len(self.missions) + 1, name, [float(x), float(y)],
                          None if at_m is None else [float(v) for v in at_m])
        self.missions.append(mission)
        return mission

    def close(self, status: MissionStatus, reason: str = "") -> None:
        """End the current mission. `arrived` and `gave_up` go on to the next place; `aborted` tries the same again;
        `skipped` puts it off until the others are done."""
        mission = self.missions[-1]
        mission.status, mission.reason = status, reason
        if status in (MissionStatus.ARRIVED, MissionStatus.GAVE_UP):
            self.visited += 1
        if status is MissionStatus.SKIPPED:
            self.places = (*self.places[: self.visited], *self.places[self.visited + 1:], self.places[self.visited])

    @property
    def place(self) -> tuple[str, float, float]:
        """Of the current mission."""
        return self.places[self.visited]

    def put_off(self, at_m: np.ndarray) -> None:
        """Remember that the place is put off here, (2,) metres: that one and no other is worth a try from somewhere else."""
        if np.linalg.norm(at_m - self.put_off_at_m) > ELSEWHERE_M:
            self.put_off_at_m, self.put_off_here = at_m.copy(), []
        self.put_off_here.append(self.place)

    def others(self, at_m: np.ndarray) -> int:
        """Places left besides the current one that were not put off here, (2,) metres."""
        here = self.put_off_here if np.linalg.norm(at_m - self.put_off_at_m) <= ELSEWHERE_M else []
        return sum(place not in here for place in self.places[self.visited + 1:])

    def skipped(self) -> int:
        """How often the current place was put off."""
        name, x, y = self.place
        put_off = [one for one in self.missions if one.status is MissionStatus.SKIPPED]
        return sum((one.place, one.goal_m) == (name, [x, y]) for one in put_off)
