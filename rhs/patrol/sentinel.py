"""The sentinel: visits places in order on its own belief, watching for what the map does not know (thesis 5.5-5.6)."""

from __future__ import annotations

import numpy as np

from rhs.api.contracts import Localiser, Planner, Source
from rhs.api.geometry import planar, wrap
from rhs.api.grid import OccupancyGrid, inflate, nearest_open
from rhs.api.records import Belief, Capture, BeliefStatus, Motion, Observation, Path, PlanningProblem, Scan, Twist

from .control import Pace, ahead_on_path, closest_on_path, steer, turn
from .kidnap import Kidnapper
from .loop import Decision
from .mission import Logbook, MissionSettings
from .obstacles import ObstacleWatch
from .relocate import Search, clear_ahead_m

LOST_VIEWS = 400
LONGER = 1.2  # room is worth a way this much longer, not the other way round the building
COMFORTS = (1.0, 0.75, 0.5, 0.25, 0.0)  # shares of the wished-for room, tried in this order
GOAL_SLACK_M = 0.05  # a goal may be moved by the distance at which a place counts as visited, less this
STOP_SHORT_M = 0.15  # the robot stops this far from what it sees ahead
LOOK_AGAIN_TURNS = (1.0, 1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0)


class Sentinel:
    """Pilot of the patrol. One call of `decide` per view; the book of missions is in `book`."""

    phase = "patrol"

    def __init__(self, localiser: Localiser, planner: Planner, grid: OccupancyGrid, free: np.ndarray, *,
                 places: tuple[tuple[str, float, float], ...], radius_m: float, settings: MissionSettings) -> None:
        self.localiser, self.planner, self.settings = localiser, planner, settings
        self.grid = grid
        self.radius_m = radius_m
        least_m = radius_m + settings.margin_m
        self.grown = [(growth, inflate(~free, growth)) for growth in
                      np.unique([least_m + share * settings.comfort_m for share in COMFORTS])[::-1] / grid.resolution_m]
        self.watch = ObstacleWatch(grid, free, tolerance_m=settings.wall_tolerance_m)
        self.book = Logbook(places)
        self.pace = Pace(settings.speed_mps, settings.step_m, np.radians(settings.turn_step_deg),
                         arc_radius_m=settings.arc_radius_m if settings.turn == "arc" else 0.0)
        self.plans: list[tuple[int, Path]] = []
        self.kidnapper: Kidnapper | None = None
        self.search = Search(radius_m, self.pace)
        self._begin_place()

    def _begin_place(self) -> None:
        self.path: Path | None = None
        self.attempts = 0
        self.look_again: list[float] = []
        self.looked_again = False
        self.seen_obstacles: list[np.ndarray] = []
        self.still = 0
        self.last_pose: np.ndarray | None = None
        self.lost_steps = 0

    # --- the pilot's side of the loop -------------------------------------------------------------------------

    def first(self, source: Source) -> Capture | None:
        source.begin_patrol()
        return source.drive(Twist(0.0, 0.0, 0.05)) if self.book.places else None

    def locate(self, observation: Observation, motion: Motion) -> Belief:
        return self.localiser.update(observation, motion)

    def note(self, belief: Belief, scan: Scan) -> None:
        if belief.status is BeliefStatus.TRACKING:
            self.watch.look(belief.map_from_body, scan)

    def move(self, source: Source, command: Twist | None) -> Capture | None:
        if command is not None and self.kidnapper is not None:
            self.kidnapper.maybe(source, self.book)
        return None if command is None else source.drive(command)

    def decide(self, belief: Belief, scan: Scan | None) -> Decision:
        """Arrived? Lost? Blocked? Otherwise follow the path."""
        events = self.kidnapper.news() if self.kidnapper is not None else []
        if belief.status is not BeliefStatus.TRACKING:
            return self._find_oneself(belief, scan, events)
        self.lost_steps = 0
        self.search.begin()
        pose = planar(belief.map_from_body)
        if self.book.current is not None and self._near(pose):
            self._finish("arrived", "", events)
        while not self.book.done:
            mission = self.book.current or self.book.open(pose[:2])
            command = self._pursue(pose, belief, scan, events)
            if command is not None:
                mission.steps += 1
                return Decision(command, self.path, "+".join(events), mission.mission)
        return Decision(None, None, "+".join(events), len(self.book.missions))

    # --- one mission --------------------------------------------------------------------------------------------

    def _pursue(self, pose: np.ndarray, belief: Belief, scan: Scan | None, events: list[str]) -> Twist | None:
        """The next command of the current mission, or None when it has just ended."""
        if self.look_again:
            return turn(self.look_again.pop() * self.pace.turn_step_rad, self.pace)
        if self._stuck(pose):
            self._finish("gave_up", "no progress: commands moved the robot less than 5 cm each", events)
            return None
        if self.path is not None and self._path_blocked(pose, scan, events):
            self.path = None
        if self.path is not None and closest_gap(self.path, pose) > 0.6:
            self.path = None
            self.book.missions[-1].replans += 1
            events.append("replan")
        if self.path is None and not self._plan(pose, events):
            return self._after_failed_plan(events)
        assert self.path is not None
        return self._with_room(steer(self.path.points_m, belief.map_from_body, self.pace), scan, events)

    def _with_room(self, command: Twist, scan: Scan | None, events: list[str]) -> Twist:
        """The command, cut to what the scan shows to be free ahead; a robot without room waits, then looks elsewhere."""
        if command.forward_mps <= 0 or scan is None:
            return command
        room_m = clear_ahead_m(scan, self.radius_m) - STOP_SHORT_M
        if room_m >= command.forward_mps * command.duration_s:
            return command
        if room_m > 0.05:
            return Twist(command.forward_mps, command.turn_radps, room_m / command.forward_mps)
        events.append("stopped")
        self.path = None
        side = 1.0 if self.still % 4 < 2 else -1.0
        return turn(side * self.pace.turn_step_rad, Pace(turn_step_rad=self.pace.turn_step_rad))

    def _plan(self, pose: np.ndarray, events: list[str]) -> bool:
        self.attempts += 1
        mission = self.book.missions[-1]
        plan = self._plan_with_room(pose[:2], np.array(mission.goal_m))
        self.plans.append((mission.mission, plan))
        self.path = plan if plan.found and len(plan.points_m) >= 2 else None
        self.last_reason = plan.reason
        events.append("plan" if self.path is not None else f"no_plan:{plan.reason}")
        return self.path is not None

    def _plan_with_room(self, start_m: np.ndarray, goal_m: np.ndarray) -> Path:
        """The way with the most room that is hardly longer than the one with the least."""
        def ask(growth_cells: float, mapped: np.ndarray) -> Path:
            blocked = mapped | inflate(self.watch.cells, growth_cells)
            near_m = nearest_open(self.grid, blocked, goal_m, self.settings.arrive_m - GOAL_SLACK_M)
            return self.planner.plan(PlanningProblem(blocked, self.grid.resolution_m, self.grid.origin_m,
                                                     start_m.copy(), near_m))

        least = ask(*self.grown[-1])
        for growth_cells, mapped in self.grown[:-1] if least.found else ():
            plan = ask(growth_cells, mapped)
            if plan.found and length_m(plan) <= LONGER * length_m(least) + 0.5:
                return plan
        return least

    def _after_failed_plan(self, events: list[str]) -> Twist | None:
        """Forget what was seen and look again once; then give the place up, with the planner's reason."""
        if self.watch.cells.any() and not self.looked_again and self.attempts < self.settings.tries:
            self.looked_again = True
            self.watch.forget()
            self.look_again = list(LOOK_AGAIN_TURNS)
            return turn(-self.pace.turn_step_rad, self.pace)
        self._finish("gave_up", f"no path: {self.last_reason}", events)
        return None

    def _path_blocked(self, pose: np.ndarray, scan: Scan | None, events: list[str]) -> bool:
        """True when something unknown stands on the path ahead; a new obstacle ends the mission, a known one grows."""
        obstacles = self.watch.cells
        if not obstacles.any():
            return False
        assert self.path is not None
        ahead = ahead_on_path(self.path.points_m, pose[:2], self.settings.watch_m)
        where = self.grid.centres(np.argwhere(obstacles))
        gaps = np.linalg.norm(where[:, None, :] - ahead[None, :, :], axis=2).min(axis=1)
        hits = where[gaps < self.radius_m + 0.5 * self.grid.resolution_m]
        if len(hits) == 0:
            return False
        at = hits.mean(axis=0)
        known = any(np.linalg.norm(hits - seen, axis=1).min() < 1.5 for seen in self.seen_obstacles)
        self.seen_obstacles.append(at)
        if known:
            self.book.missions[-1].replans += 1
            events.append("replan")
        else:
            self.book.close("aborted", f"obstacle near ({at[0]:.1f}, {at[1]:.1f}) m")
            self.book.open(pose[:2]).replans += 1
            events.append("blocked")
        return True

    def _finish(self, status: str, reason: str, events: list[str]) -> None:
        self.book.close(status, reason)
        events.append(status)
        self.watch.forget()
        self._begin_place()

    def _near(self, pose: np.ndarray) -> bool:
        goal = np.array(self.book.missions[-1].goal_m)
        return float(np.linalg.norm(pose[:2] - goal)) <= self.settings.arrive_m

    def _stuck(self, pose: np.ndarray) -> bool:
        if self.last_pose is not None:
            shift = np.linalg.norm(pose[:2] - self.last_pose[:2])
            moved = shift > 0.05 or abs(wrap(pose[2] - self.last_pose[2])) > 0.03
            self.still = 0 if moved else self.still + 1
        self.last_pose = pose
        limit = self.settings.tries * 10
        return self.still >= self.settings.stuck_steps or self.attempts > limit

    def _find_oneself(self, belief: Belief, scan: Scan | None, events: list[str]) -> Decision:
        """Not knowing where it is, the robot looks for itself until it knows again, or gives the place up."""
        self.path = None
        self.lost_steps += 1
        mission = self.book.current or self.book.open(np.array([-1.0, -1.0]))
        events.append("lost")
        if self.lost_steps > LOST_VIEWS:
            self._finish("gave_up", f"lost: the robot did not find itself in {LOST_VIEWS} views", events)
            if self.book.done:
                return Decision(None, None, "+".join(events), mission.mission)
        return Decision(self.search.next(belief, scan), None, "+".join(events), mission.mission)


def length_m(path: Path) -> float:
    """Length of a path, metres."""
    return float(np.linalg.norm(np.diff(path.points_m, axis=0), axis=1).sum())


def closest_gap(path: Path, pose: np.ndarray) -> float:
    """Distance in metres from the pose to the path."""
    _, near = closest_on_path(path.points_m, pose[:2])
    return float(np.linalg.norm(near - pose[:2]))
