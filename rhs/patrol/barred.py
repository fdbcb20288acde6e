"""Where no way is left past what was seen: go nearer to what bars it, aside for who comes, wait, look again, give up."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rhs.api.contracts import Blockage, Blocked
from rhs.api.geometry import se2, wrap
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Event, MissionStatus, Path, PlanReason, Scan, Twist, View
from rhs.api.robot_shape import Footprint
from rhs.api.task import Parts
from rhs.api.validate import check_blocked
from rhs.estimation.survey import known_free

from .aside import PATIENCE_VIEWS, Aside, Trails
from .changed_map import STAYS_S, ChangedMap
from .control import Pace, Progress, ahead_on_path, first_on_way, short_of, steer, target_on, turn, turns
from .guard import Guard
from .kidnap import Kidnapper
from .loop import names
from .mission import Logbook, MissionSettings
from .neighbours import near_any
from .obstacles import ObstacleWatch, in_body, in_map
from .planning import RoomyPlanner, with_unseen
from .relocate import Search
from .surroundings import CAME_NEAR_M, SURE

WAIT_S = 0.5  # one view of waiting
WAIT_VIEWS = 40  # for what bars every way and may go, as something moves there
WATCH_M, MOST_APPROACH = 0.8, 200  # what bars the way is looked at from so near; commands to get there, a place
WATCH_RAD = np.radians(15.0)  # what is waited for is kept this near the middle of the view
MOST_BARRED = 6  # commands refused on end after which a gap hardly wider than the robot is not tried again
MOST_BACK, MOST_BACK_TO_SEE, MOST_RETURNS = 2, 5, 3  # times a place: back to find a way, to see, to what barred a way before
LOOK_AGAIN_TURNS = (1.0, 1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0)  # forth and back


class Barred:
    """What a sentinel holds, and the part of it that knows what to do then. rebuffed: it touched something on a way over
    unseen ground."""

    rebuffed = False
    phase: str
    _finish: Callable[[MissionStatus, str, list[Event]], None]
    _plan: Callable[[np.ndarray, list[Event]], bool]

    def __init__(self, parts: Parts, grid: OccupancyGrid, views: Sequence[View], *,
                 places: tuple[tuple[str, float, float], ...], radius_m: float, settings: MissionSettings,
                 footprint: Footprint | None = None) -> None:
        self.localiser, self.planner, self.replan, self.settings = parts.localiser, parts.planner, parts.replan, settings
        self.who = parts.who or names(source="driven", planner=parts.planner, replan=parts.replan,
                                       localiser=parts.localiser)
        self.radius_m, self.views, self.slam = radius_m, tuple(views), parts.slam  # which draws a new map all the time
        updates = settings.update_map and self.phase == "patrol" and self.slam is None
        self.changed = ChangedMap(grid, settings.advanced.guard.votes) if updates else None
        self._take_map(grid)
        self.book = Logbook(places)
        self.pace = Pace(settings.speed_mps, settings.step_m, np.radians(settings.turn_step_deg),
                         arc_radius_m=settings.arc_radius_m if settings.turn == "arc" else 0.0)
        self.guard = Guard(radius_m, self.pace, settings.advanced.guard, footprint)
        self.obstacle: Scan | None = None  # of the last view
        self.lost_in_all, self.trails = 0, Trails()
        self.expected = np.full((4, 4), np.nan)  # map_from_body by the last sure belief, if any, and the motions since
        self.plans: list[tuple[int, Path]] = []
        self.kidnapper: Kidnapper | None = None
        self.search = Search(radius_m, self.pace)
        self._begin_place()

    def _take_map(self, grid: OccupancyGrid) -> None:
        """Plan and watch on this map from now on."""
        self.grid, self.free = grid, known_free(grid, self.views, self.radius_m, self.settings.margin_m)
        self.watch = ObstacleWatch(grid, self.free, tolerance_m=self.settings.wall_tolerance_m,
                                   votes=self.settings.advanced.guard.votes, changed=self.changed)
        self._drive_on(self.free)

    def _drive_on(self, free: np.ndarray) -> None:
        """Plan over these cells (H, W), and watch for things on them."""
        self.roads = RoomyPlanner(self.planner, self.grid, free, radius_m=self.radius_m, settings=self.settings,
                                  who=self.who["planner"])
        self.watch.watch_on(free)

    def _begin_place(self) -> None:
        self.path: Path | None = None
        self.seen_obstacles: list[np.ndarray] = []
        self.queued: list[Twist] = []  # commands before anything else is planned
        self.looked_again, self.ventured, self.last_reason, self.bars = False, False, "", ""
        self.progress, self.aside, self.guard.refused_for_hidden, self.guard.pressed = Progress(), Aside(), 0, 0
        self.attempts = self.waited = self.contacts = self.barred = self.backed = self.returned = self.approached = 0

    def _back(self, pose: np.ndarray) -> Twist | None:
        """A little back the way the robot came, if the map and what it has seen leave room there."""
        return self.guard.back_off(self.watch.walls_near(pose))

    def _after_failed_plan(self, pose: np.ndarray, events: list[Event]) -> Twist | None:
        """A robot that stands too near to things to set off goes back a little. Where something seen bars every way, ask the
        replan part. Else, or if it wants to go on: forget what was seen and look again once; then try ground that nobody has
        looked at; then give the place up, with the planner's reason."""
        if self.barred and self.backed < MOST_BACK and (back := self._back(pose)) is not None:
            self.backed += 1
            return back
        way, leaves_room = self._way_left(pose)
        if self.barred and leaves_room and not self.contacts and self.guard.around.monocular and self.guard.forget_seen():
            self.barred = 0
            return None  # planned anew by what is known
        bars = self.watch.cells & ~self._stays if leaves_room else self.watch.cells
        seen = self.grid.centres(np.argwhere(bars if bars.any() else self.watch.cells))
        if self.barred:
            seen = np.concatenate([seen, self._near_things(pose)])
        at = first_on_way(way, seen, pose[:2], self.radius_m + self.settings.margin_m) if len(seen) else pose[:2]
        if len(seen):
            if self.aside.goal_m is None and (nearer := self._approach(way, at, pose, events)) is not None:
                return nearer
            if self._goes_aside(at, pose) or self._may_have_gone(at, pose):
                return self._wait(at, pose, events)
            mission = self.book.current
            command = self._answer(self._told(at, pose, no_way=True), pose, events)
            if command is not None or self.book.current is not mission:
                return command
        if len(seen) and (leaves_room or self.guard.moves) and self.waited < WAIT_VIEWS:
            return self._wait(at, pose, events)
        if self.watch.cells.any() and not self.looked_again and self.attempts < self.settings.tries:
            self.looked_again = True
            self.watch.forget()
            self.guard.around.forget_specks()
            self.queued = turns(LOOK_AGAIN_TURNS, self.pace)
            return turn(-self.pace.turn_step_rad, self.pace)
        if not self.ventured and len(seen):  # what is met on ground that nobody has looked at is not what closed the way
            self.bars = self._what_bars(first_on_way(way, seen, pose[:2], self.grid.resolution_m, else_m=at))
        if self._ventures(pose, events):
            return None  # there is a path now
        self._leave(f"no path: {self.last_reason}{self.bars}{self._touches}", pose, events, later=len(seen) > 0)
        return None

    @property
    def _touches(self) -> str:
        """Of this place so far, for the reason why it is given up."""
        return f" (touches: {self.contacts})" if self.contacts else ""

    def _what_bars(self, at_m: np.ndarray) -> str:
        """What stands in the way at (2,), in words: somebody, where somebody was seen to walk in this patrol."""
        walked = near_any(at_m[None], self.trails.points_m, CAME_NEAR_M).any()
        return f", {'somebody' if walked else 'something new'} stands near ({at_m[0]:.1f}, {at_m[1]:.1f}) m"

    def _ventures(self, pose: np.ndarray, events: list[Event]) -> bool:
        """Whether there is a way over ground that nobody has looked at: the guard lets the robot go as far as it sees, and
        what stands there becomes an obstacle. Tried once a mission, when the other places are done or the robot could not
        set off for them either, and no more once something was touched there."""
        if self.ventured or self.rebuffed or self.phase != "patrol" or not self.guard.sees or not self._squeezes:
            return False
        cannot_set_off = self.last_reason is PlanReason.START_BLOCKED
        if self.book.others(pose[:2]) and not self.book.skipped() and not cannot_set_off:
            return False  # first those that can be reached without
        wider = with_unseen(self.grid, self.free, self.settings.advanced.unseen_m)
        if not (wider & ~self.free).any():
            return False
        self.ventured, reason, planned = True, self.last_reason, list[Event]()
        self._drive_on(wider)
        if self._plan(pose, planned):
            events += [Event.VENTURE, *planned]
            return True
        self._drive_on(self.free)
        self.last_reason = reason
        return False

    @property
    def _blind_m(self) -> float:
        """Metres within which the camera looks over the floor."""
        return self.obstacle.blind_m if self.obstacle is not None else 0.0

    def _unseen_m(self, at_m: np.ndarray) -> float:
        """Metres within which what stands at (2,) would not be seen to go: none where it is as high as the camera."""
        return self._blind_m if self.watch.low(at_m) else 0.0

    def _way_left(self, pose: np.ndarray) -> tuple[Path, bool]:
        """The way past what was seen to stay, as if nothing else stood there, and whether there is one: what bars it may go.
        The map's if there is none."""
        stays = self._stays
        seen_m = in_map(self.guard.around.things(least=SURE), pose)
        cells = np.clip(self.grid.cells(seen_m), 0, np.array(self.grid.shape) - 1)  # some may lie beside the map
        there = ~self.watch.unknown(seen_m) | stays[tuple(cells.T)]
        goal_m, nothing = np.array(self.book.missions[-1].goal_m), np.zeros((0, 2))
        way = self.roads.plan(pose[:2], goal_m, squeeze=self.guard.sees, obstacles=stays, things_m=nothing,
                              seen_m=seen_m[there] if self._squeezes else None)
        if way.found:
            return way, True
        return self.roads.plan(pose[:2], goal_m, squeeze=self.guard.sees, obstacles=np.zeros_like(stays),
                               things_m=nothing), False

    @property
    def _stays(self) -> np.ndarray:
        """(H, W) bool: where something was seen to stand for long."""
        return self.watch.stood_s >= STAYS_S

    @property
    def _squeezes(self) -> bool:
        """Whether a gap hardly wider than the robot is tried."""
        return self.barred <= MOST_BARRED and not self.contacts and not self.guard.around.monocular

    def _approach(self, way: Path, at_m: np.ndarray, pose: np.ndarray, events: list[Event]) -> Twist | None:
        """Where something moves, along the way that is left up to what bars it: seen from near it may leave room, and who
        walks off is followed. None where the robot is there already, or where all stands still."""
        if not self.guard.moves:
            return None
        stop_m = max(self._unseen_m(at_m), WATCH_M) + self.pace.step_m
        stretch = short_of(way.points_m, pose[:2], at_m, stop_m) if way.found else np.zeros((0, 2))
        if len(stretch) < 2 or np.linalg.norm(stretch[-1] - pose[:2]) < self.pace.step_m or self.approached >= MOST_APPROACH:
            return None
        self.approached += 1
        target_m = in_body(target_on(stretch, pose[:2], self.pace), pose)
        command, why = self.guard.allow(steer(stretch, se2(*pose), self.pace), target_m)
        if command is not None:
            self.attempts -= not self.guard.moves
            events.extend([why] if why is not None else [])
        return command

    def _goes_aside(self, at_m: np.ndarray, pose: np.ndarray) -> bool:
        """Whether the robot makes room for who stands there, who may be waiting for it; elsewhere if no way leads there."""
        waits = self.guard.moves and self.waited >= PATIENCE_VIEWS
        goes = (waits or self.aside.goal_m is not None) and self.aside.go(
            pose[:2], at_m, self.grid, self.roads.blocked(self.watch.cells), self.trails.points_m)
        self.waited = 0 if goes else self.waited
        return goes

    def _may_have_gone(self, at_m: np.ndarray, pose: np.ndarray) -> bool:
        """Whether anything that was seen before may have gone, and is forgotten: where something moves, and else a few times
        a place. Who is seen to come and stands in the way here is waited for first."""
        comes = self.guard.moves and self.waited < WAIT_VIEWS and self.guard.around.came_near(in_body(at_m, pose))
        if comes or not self.guard.moves and self.returned >= MOST_RETURNS:
            return False
        gone = self.watch.forget_gone(self.guard.around.now_s, pose[:2], self._blind_m, self.trails.points_m)
        self.returned += gone
        return gone

    def _wait(self, at_m: np.ndarray, pose: np.ndarray, events: list[Event], *, event: Event = Event.WAIT) -> Twist:
        """Stand for a view before what is in the way; the plan that failed is tried again."""
        self.waited, self.progress.still = self.waited + 1, 0
        self.attempts -= self.path is None and not self.guard.moves
        events.append(event)
        return self._watching(at_m, pose)

    def _watching(self, at_m: np.ndarray, pose: np.ndarray) -> Twist:
        """Stand still for a view, turned to what is waited for, and back from it as far as the camera sees the floor there:
        else nobody sees it go."""
        near = np.linalg.norm(at_m - pose[:2]) < self._unseen_m(at_m)
        if near and self.backed < MOST_BACK_TO_SEE and (back := self._back(pose)) is not None:
            self.backed += 1
            return back
        bearing = float(wrap(np.arctan2(at_m[1] - pose[1], at_m[0] - pose[0]) - pose[2]))
        if abs(bearing) > WATCH_RAD and self.guard.sees and not self.pace.arc_radius_m:
            return turn(bearing, self.pace)
        return Twist(0.0, 0.0, WAIT_S)

    def _near_things(self, pose: np.ndarray, *, walls: bool = False) -> np.ndarray:
        """(K, 2) metres in the map: what the robot has seen round itself lately and the map does not know; walls: or knows
        nearly there, as one camera is off by as much as its way keeps from a wall. Where things move, what it has not looked
        at for a while may have gone; not what its guard refuses to pass again and again."""
        lately_s = self.settings.advanced.guard.fade_s if self.guard.moves and self.barred < MOST_BARRED else np.inf
        points = in_map(self.guard.around.things(lately_s), pose)
        return points if walls else points[self.watch.unknown(points, 0.5 * self.settings.wall_tolerance_m)]

    def _told(self, at_m: np.ndarray, pose: np.ndarray, *, known: bool = True, no_way: bool = False) -> Blockage:
        """What the replan part is told of something in the way there."""
        return Blockage(at_m, known, self.waited, self.book.skipped(), self.book.others(pose[:2]), no_way)

    def _blockage(self, pose: np.ndarray) -> Blockage | None:
        """What the map does not know and stands on the path ahead."""
        assert self.path is not None
        ahead = ahead_on_path(self.path.points_m, pose[:2], self.settings.watch_m)
        hits = self.watch.on_way(ahead, self.radius_m + self.settings.margin_m - 0.5 * self.grid.resolution_m)
        if len(hits) == 0:
            return None
        known = any(np.linalg.norm(hits - seen, axis=1).min() < 1.5 for seen in self.seen_obstacles)
        return self._told(hits.mean(axis=0), pose, known=known)

    def _answer(self, blockage: Blockage, pose: np.ndarray, events: list[Event]) -> Twist | None:
        """Do what the replan part says of the blockage: a command to wait, or None and no path any more."""
        answer, at = check_blocked(self.replan.blocked(blockage), who=self.who.get("replan", "replan")), blockage.at_m
        if answer in (Blocked.WAIT, Blocked.ASK):
            return self._wait(at, pose, events, event=Event.WAIT if answer is Blocked.WAIT else Event.ASK)
        if blockage.no_way and answer in (Blocked.REPLAN, Blocked.NEW_MISSION):
            return None  # it is looked at once more
        self.path, self.waited = None, 0
        self.seen_obstacles.append(at)
        near = f"obstacle near ({at[0]:.1f}, {at[1]:.1f}) m"
        if answer is Blocked.SKIP and blockage.others and blockage.skipped < self.settings.tries:
            self.book.put_off(pose[:2])
            self._finish(MissionStatus.SKIPPED, near, events)
        elif answer in (Blocked.GIVE_UP, Blocked.SKIP):
            self._finish(MissionStatus.GAVE_UP, near, events)
        elif answer is Blocked.NEW_MISSION:
            self.book.close(MissionStatus.ABORTED, near)
            self.book.open(pose[:2]).replans += 1
            events.append(Event.BLOCKED)
        else:
            self.book.missions[-1].replans += 1
            events.append(Event.REPLAN)
        return None

    def _leave(self, reason: str, pose: np.ndarray, events: list[Event], *, later: bool = True) -> None:
        """Give the place up; later: it is tried again, after the others if any: what is in the way may go. Once, or where
        something moves as often as a place is planned anew."""
        goes_on, often = (True, self.settings.tries) if self.guard.moves else (self.book.others(pose[:2]) > 0, 1)
        if later := later and goes_on and self.book.skipped() < often:
            self.book.put_off(pose[:2])
        self._finish(MissionStatus.SKIPPED if later else MissionStatus.GAVE_UP, reason, events)
