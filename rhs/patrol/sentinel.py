"""The sentinel: visits places in order on its own belief, watching for what the map does not know (thesis 5.5-5.6)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rhs.api.contracts import Blockage, Blocked, Source
from rhs.api.frozen import freeze
from rhs.api.geometry import planar, wrap
from rhs.api.grid import OccupancyGrid, configuration_space, inflate, nearest_open
from rhs.api.records import (
    Belief,
    BeliefStatus,
    Capture,
    Event,
    MissionStatus,
    Motion,
    Observation,
    Path,
    PlanningProblem,
    Scan,
    Twist,
    View,
)
from rhs.api.task import Parts
from rhs.api.validate import check_capture, check_path
from rhs.estimation.survey import known_free

from .control import Pace, ahead_on_path, closest_on_path, steer, turn
from .kidnap import Kidnapper
from .loop import Decision, names
from .mission import Logbook, MissionSettings
from .obstacles import ObstacleWatch
from .relocate import Search, clear_ahead_m

LOST_VIEWS = 400
LONGER = 1.2  # room is worth a way this much longer, not the other way round the building
COMFORTS = (1.0, 0.75, 0.5, 0.25, 0.0)  # shares of the wished-for room, tried in this order
GOAL_SLACK_M = 0.05  # a goal may be moved by the distance at which a place counts as visited, less this
MOST_TURNING_RAD = 4.0 * np.pi  # turning on the spot is progress twice round, not for ever
WAIT_S = 0.5  # one view of waiting
STOP_SHORT_M = 0.15  # the robot stops this far from what it sees ahead
LOOK_AGAIN_TURNS = (1.0, 1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0)


class Sentinel:
    """Pilot of the patrol. One call of `decide` per view; the book of missions is in `book`."""

    phase, believer = "patrol", "localiser"

    def __init__(self, parts: Parts, grid: OccupancyGrid, views: Sequence[View], *,
                 places: tuple[tuple[str, float, float], ...], radius_m: float, settings: MissionSettings) -> None:
        self.localiser, self.planner, self.replan, self.settings = parts.localiser, parts.planner, parts.replan, settings
        self.slam = parts.slam  # draws a new map all the time
        self.who = parts.who or names(source="driven", planner=parts.planner, replan=parts.replan)
        self.radius_m, self.views = radius_m, tuple(views)
        self._take_map(grid)
        self.book = Logbook(places)
        self.pace = Pace(settings.speed_mps, settings.step_m, np.radians(settings.turn_step_deg),
                         arc_radius_m=settings.arc_radius_m if settings.turn == "arc" else 0.0)
        self.plans: list[tuple[int, Path]] = []
        self.kidnapper: Kidnapper | None = None
        self.search = Search(radius_m, self.pace)
        self._begin_place()

    def _take_map(self, grid: OccupancyGrid) -> None:
        """Plan and watch on this map from now on."""
        free, settings = known_free(grid, self.views, self.radius_m), self.settings
        least_m = self.radius_m + settings.margin_m
        self.grid = grid
        self.grown = [(growth, configuration_space(~free, growth)) for growth in
                      np.unique([least_m + share * settings.comfort_m for share in COMFORTS])[::-1] / grid.resolution_m]
        self.watch = ObstacleWatch(grid, free, tolerance_m=settings.wall_tolerance_m)

    def _begin_place(self) -> None:
        self.path: Path | None = None
        self.attempts = 0
        self.look_again: list[float] = []
        self.looked_again = False
        self.seen_obstacles: list[np.ndarray] = []
        self.still = 0
        self.turned_rad = 0.0
        self.waited = 0
        self.views_spent = 0
        self.last_pose: np.ndarray | None = None
        self.lost_steps = 0

    # --- the pilot's side of the loop -------------------------------------------------------------------------

    def first(self, source: Source) -> Capture | None:
        source.begin_patrol()
        return self._driven(source, Twist(0.0, 0.0, 0.05)) if self.book.places else None

    def locate(self, observation: Observation, motion: Motion) -> Belief:
        return self.localiser.update(observation, motion)

    def note(self, belief: Belief, scan: Scan) -> None:
        if belief.status is BeliefStatus.TRACKING:
            self.watch.look(belief.map_from_body, scan)

    def move(self, source: Source, command: Twist | None) -> Capture | None:
        if command is not None and self.kidnapper is not None:
            self.kidnapper.maybe(source, self.book)
        return None if command is None else self._driven(source, command)

    def _driven(self, source: Source, command: Twist) -> Capture:
        """What the source shows after a command; nothing at all would end the patrol as if it were over."""
        return check_capture(source.drive(command), who=self.who["source"])

    def decide(self, belief: Belief, scan: Scan | None) -> Decision:
        """Arrived? Lost? Blocked? Otherwise follow the path."""
        events = self.kidnapper.news() if self.kidnapper is not None else []
        self.views_spent += 1
        if belief.status is not BeliefStatus.TRACKING:
            return self._find_oneself(belief, scan, events)
        self.lost_steps = 0
        self.search.begin()
        pose = planar(belief.map_from_body)
        if self.book.current is not None and self._near(pose):
            self._finish(MissionStatus.ARRIVED, "", events)
        while not self.book.done:
            mission = self.book.current or self.book.open(pose[:2])
            command = self._pursue(pose, belief, scan, events)
            if command is not None:
                mission.steps += 1
                return Decision(command, self.path, tuple(events), mission.mission)
        return Decision(None, None, tuple(events), len(self.book.missions))

    # --- one mission --------------------------------------------------------------------------------------------

    def _pursue(self, pose: np.ndarray, belief: Belief, scan: Scan | None, events: list[Event]) -> Twist | None:
        """The next command of the current mission, or None when it has just ended."""
        if self.look_again:
            return turn(self.look_again.pop() * self.pace.turn_step_rad, self.pace)
        if self._stuck(pose):
            self._finish(MissionStatus.GAVE_UP, "no progress: commands moved the robot less than 5 cm each", events)
            return None
        if self.views_spent > self.settings.views_max:
            self._finish(MissionStatus.GAVE_UP, f"budget spent: mission.views_max={self.settings.views_max} views", events)
            return None
        if self.path is not None and (blockage := self._blockage(pose)) is not None:
            command = self._answer(blockage, pose, events)
            if command is not None or self.book.current is None:
                return command
        if self.path is not None and closest_gap(self.path, pose) > 0.6:
            self.path = None
            self.book.missions[-1].replans += 1
            events.append(Event.REPLAN)
        if self.path is None and not self._plan(pose, events):
            return self._after_failed_plan(events)
        assert self.path is not None
        return self._with_room(steer(self.path.points_m, belief.map_from_body, self.pace), scan, events)

    def _with_room(self, command: Twist, scan: Scan | None, events: list[Event]) -> Twist:
        """The command, cut to what the scan shows to be free ahead; a robot without room waits, then looks elsewhere."""
        if command.forward_mps <= 0 or scan is None:
            return command
        room_m = clear_ahead_m(scan, self.radius_m) - STOP_SHORT_M
        if room_m >= command.forward_mps * command.duration_s:
            return command
        if room_m > 0.05:
            return Twist(command.forward_mps, command.turn_radps, room_m / command.forward_mps)
        events.append(Event.STOPPED)
        self.path = None
        side = 1.0 if self.still % 4 < 2 else -1.0
        return turn(side * self.pace.turn_step_rad, Pace(turn_step_rad=self.pace.turn_step_rad))

    def _plan(self, pose: np.ndarray, events: list[Event]) -> bool:
        self.attempts += 1
        mission = self.book.missions[-1]
        plan = self._plan_with_room(pose[:2], np.array(mission.goal_m))
        self.plans.append((mission.mission, plan))
        self.path = plan if plan.found and len(plan.points_m) >= 2 else None
        self.last_reason = plan.reason
        events.append(Event.PLAN if self.path is not None else Event.NO_PLAN)
        return self.path is not None

    def _plan_with_room(self, start_m: np.ndarray, goal_m: np.ndarray) -> Path:
        """The way with the most room that is hardly longer than the one with the least."""
        from rhs.estimation.paths.shorten import shortened  # compiled code, half a second to load

        def ask(growth_cells: float, mapped: np.ndarray) -> Path:
            blocked = mapped | inflate(self.watch.cells, growth_cells)
            near_m = nearest_open(self.grid, blocked, goal_m, self.settings.arrive_m - GOAL_SLACK_M)
            problem = freeze(PlanningProblem(blocked, self.grid.resolution_m, self.grid.origin_m, start_m.copy(), near_m))
            began_s = time.process_time()
            plan = self.planner.plan(problem)
            plan_ms = 1e3 * (time.process_time() - began_s)
            plan = check_path(plan, problem, who=self.who["planner"])
            return shortened(replace(plan, plan_ms=plan_ms), problem)

        least = ask(*self.grown[-1])
        for growth_cells, mapped in self.grown[:-1] if least.found else ():
            plan = ask(growth_cells, mapped)
            if plan.found and length_m(plan) <= LONGER * length_m(least) + 0.5:
                return plan
        return least

    def _after_failed_plan(self, events: list[Event]) -> Twist | None:
        """Forget what was seen and look again once; then give the place up, with the planner's reason."""
        if self.watch.cells.any() and not self.looked_again and self.attempts < self.settings.tries:
            self.looked_again = True
            self.watch.forget()
            self.look_again = list(LOOK_AGAIN_TURNS)
            return turn(-self.pace.turn_step_rad, self.pace)
        self._finish(MissionStatus.GAVE_UP, f"no path: {self.last_reason}", events)
        return None

    def _blockage(self, pose: np.ndarray) -> Blockage | None:
        """What the map does not know and stands on the path ahead."""
        obstacles = self.watch.cells
        if not obstacles.any():
            return None
        assert self.path is not None
        ahead = ahead_on_path(self.path.points_m, pose[:2], self.settings.watch_m)
        where = self.grid.centres(np.argwhere(obstacles))
        gaps = np.linalg.norm(where[:, None, :] - ahead[None, :, :], axis=2).min(axis=1)
        hits = where[gaps < self.radius_m + 0.5 * self.grid.resolution_m]
        if len(hits) == 0:
            return None
        known = any(np.linalg.norm(hits - seen, axis=1).min() < 1.5 for seen in self.seen_obstacles)
        return Blockage(hits.mean(axis=0), known, self.waited)

    def _answer(self, blockage: Blockage, pose: np.ndarray, events: list[Event]) -> Twist | None:
        """Do what the replan part says of the blockage: a command to wait, or None and no path any more."""
        answer, at = self.replan.blocked(blockage), blockage.at_m
        if answer is Blocked.WAIT:
            self.waited += 1
            events.append(Event.WAIT)
            return Twist(0.0, 0.0, WAIT_S)
        self.path, self.waited = None, 0
        self.seen_obstacles.append(at)
        near = f"obstacle near ({at[0]:.1f}, {at[1]:.1f}) m"
        if answer is Blocked.GIVE_UP:
            self._finish(MissionStatus.GAVE_UP, near, events)
        elif answer is Blocked.NEW_MISSION:
            self.book.close(MissionStatus.ABORTED, near)
            self.book.open(pose[:2]).replans += 1
            events.append(Event.BLOCKED)
        else:
            self.book.missions[-1].replans += 1
            events.append(Event.REPLAN)
        return None

    def _finish(self, status: MissionStatus, reason: str, events: list[Event]) -> None:
        self.book.close(status, reason)
        events.append(Event(status))
        self.watch.forget()
        if self.slam is not None:
            self._take_map(self.slam.grid())
        self._begin_place()

    def _near(self, pose: np.ndarray) -> bool:
        goal = np.array(self.book.missions[-1].goal_m)
        return float(np.linalg.norm(pose[:2] - goal)) <= self.settings.arrive_m

    def _stuck(self, pose: np.ndarray) -> bool:
        if self.last_pose is not None:
            shift = np.linalg.norm(pose[:2] - self.last_pose[:2])
            turned = abs(wrap(pose[2] - self.last_pose[2]))
            self.turned_rad = 0.0 if shift > 0.05 else self.turned_rad + turned
            moved = shift > 0.05 or (turned > 0.03 and self.turned_rad < MOST_TURNING_RAD)
            self.still = 0 if moved else self.still + 1
        self.last_pose = pose
        limit = self.settings.tries * 10
        return self.still >= self.settings.stuck_steps or self.attempts > limit

    def _find_oneself(self, belief: Belief, scan: Scan | None, events: list[Event]) -> Decision:
        """Not knowing where it is, the robot looks for itself until it knows again, or gives the place up."""
        self.path = None
        self.lost_steps += 1
        mission = self.book.current or self.book.open(np.array([-1.0, -1.0]))
        events.append(Event.LOST)
        if self.lost_steps > LOST_VIEWS:
            self._finish(MissionStatus.GAVE_UP, f"lost: the robot did not find itself in {LOST_VIEWS} views", events)
            if self.book.done:
                return Decision(None, None, tuple(events), mission.mission)
        return Decision(self.search.next(belief, scan), None, tuple(events), mission.mission)


def length_m(path: Path) -> float:
    """Length of a path, metres."""
    return float(np.linalg.norm(np.diff(path.points_m, axis=0), axis=1).sum())


def closest_gap(path: Path, pose: np.ndarray) -> float:
    """Distance in metres from the pose to the path."""
    _, near = closest_on_path(path.points_m, pose[:2])
    return float(np.linalg.norm(near - pose[:2]))
