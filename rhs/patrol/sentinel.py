"""The sentinel: visits places in order on its own belief, watching for what the map does not know (thesis 5.5-5.6)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rhs.api.contracts import Source
from rhs.api.geometry import inverse, planar
from rhs.api.records import Belief, Capture, Event, MissionStatus, Motion, Observation, Path, Scan, Twist
from rhs.api.validate import check_belief, check_capture, check_grid

from .aside import PASSED_M
from .barred import Barred
from .control import Pace, closest_on_path, steer, target_on, turn
from .guard import OFF_WALL_M
from .loop import Decision
from .mission import ELSEWHERE_M, Mission
from .obstacles import in_body, in_map, spread
from .planning import LONGER, length_m
from .relocate import cut_to_room
from .surroundings import HIDES_M, NEAR_M, NOTHING, SURE

DEPTHS_M = (HIDES_M, 0.7 * HIDES_M)  # a box of which one camera saw one face is as deep as that, tried in this order
ELSEWHERE_RAD = 0.5  # and ELSEWHERE_M: what was seen so far off was not seen here


class Sentinel(Barred):
    """Pilot of the patrol. One call of `decide` per view; the book of missions is in `book`."""

    phase, believer = "patrol", "localiser"

    def _begin_place(self) -> None:
        super()._begin_place()
        self.views_spent = self.lost_steps = 0

    # --- the pilot's side of the loop -------------------------------------------------------------------------

    def first(self, source: Source) -> Capture | None:
        source.begin_patrol()
        return self._driven(source, Twist(0.0, 0.0, 0.05)) if self.book.places else None

    def locate(self, observation: Observation, motion: Motion) -> Belief:
        self.guard.observe(observation, motion)
        self.obstacle = observation.obstacle
        belief = check_belief(self.localiser.update(observation, motion), who=self.who["localiser"],
                              reach_m=np.inf)  # how far away it may be the loop knows
        self.expected = self.expected @ motion.previous_from_body
        if belief.status.on_map:
            off = planar(inverse(self.expected) @ belief.map_from_body)
            if np.hypot(*off[:2]) > ELSEWHERE_M or abs(off[2]) > ELSEWHERE_RAD:  # what was seen was seen elsewhere
                self.guard.around.forget()
                self.watch.forget()
            self.expected = belief.map_from_body
        return belief

    def note(self, belief: Belief, scan: Scan) -> None:
        sure, pose, around = belief.status.on_map, planar(belief.map_from_body), self.guard.around
        around.map_m = self.watch.walls_near(pose, NEAR_M if around.monocular else 1.0) if sure else None
        if sure:
            shown = scan if around.monocular else self.obstacle  # pictures show a thing from its foot on the floor upwards
            self.watch.look(belief.map_from_body, scan, shown, now_s=around.now_s, moves=around.moves)
            self.trails.note(in_map(around.came_now(), pose))
        self.guard.touched_m = in_body(self.watch.touched_m, pose) if sure else NOTHING
        self.guard.known_m = self.watch.known_near(pose) if sure and around.monocular else NOTHING

    def move(self, source: Source, command: Twist | None) -> Capture | None:
        if command is not None and self.kidnapper is not None:
            self.kidnapper.maybe(source, self.book, command)
        return None if command is None else self._driven(source, command)

    def _driven(self, source: Source, command: Twist) -> Capture:
        """What the source shows after a command; nothing at all would end the patrol as if it were over."""
        command = self.guard.given = self.guard.turn_in_room(self.guard.off_touched(command))
        return check_capture(source.drive(command), who=self.who["source"])

    def decide(self, belief: Belief, scan: Scan | None) -> Decision:
        """Touched? Arrived? Lost? Blocked? Otherwise follow the path."""
        events = self.kidnapper.news() if self.kidnapper is not None else []
        self.views_spent += 1
        self.guard.lost = not belief.status.on_map
        if self.guard.touched and (back := self._back_off(belief, events)) is not None:
            mission = self._mission(belief)
            return Decision(back, None, tuple(events), mission.mission)
        if not belief.status.on_map:
            return self._find_oneself(belief, scan, events)
        self.lost_steps = 0
        self.search.begin()
        pose = planar(belief.map_from_body)
        if self.book.current is not None and self._near(pose):
            self._finish(MissionStatus.ARRIVED, "", events)
        while self._more(pose):
            mission = self.book.current or self.book.open(pose[:2])
            command = self._pursue(pose, belief, scan, events)
            if command is not None:
                mission.steps += 1
                return Decision(command, self.path, tuple(events), mission.mission)
        return Decision(None, None, tuple(events), len(self.book.missions))

    def _more(self, pose: np.ndarray) -> bool:
        """Whether there is somewhere to go."""
        return not self.book.done

    def _mission(self, belief: Belief) -> Mission:
        """The mission of a robot that cannot say where it begins: the current one, or the next."""
        if self.book.current is None:
            self._more(planar(belief.map_from_body))  # whoever finds its places as it goes chooses one
        return self.book.current or self.book.open(None)

    # --- one mission --------------------------------------------------------------------------------------------

    def _back_off(self, belief: Belief, events: list[Event]) -> Twist | None:
        """After a touch: mark what was not seen, go back the way the robot came, plan anew; None without room behind."""
        events.append(Event.CONTACT)
        self.contacts += 1
        self.path, self.rebuffed = None, self.rebuffed or self.ventured
        self.search.turn_away()
        if not belief.status.on_map:
            self.guard.bump()
            return self.guard.back_off()
        pose = planar(belief.map_from_body)
        self.watch.bump(in_map(self.guard.bump(self.watch.known_near(pose)), pose))
        self.guard.touched_m = in_body(self.watch.touched_m, pose)
        return self._back(pose)

    def _pursue(self, pose: np.ndarray, belief: Belief, scan: Scan | None, events: list[Event]) -> Twist | None:
        """The next command of the current mission, or None when it has just ended."""
        if self.queued:
            queued, straight_m = self.queued.pop(0), np.array([1.0, 0.0])
            return queued if queued.turn_radps else self._safely(queued, straight_m, pose, events)
        if (why := self._stuck(pose)) is not None:
            self._leave(f"no progress: {why}{self._touches}", pose, events)
            return None
        if self.views_spent > self.settings.views_max:
            self._finish(MissionStatus.GAVE_UP, f"budget spent: mission.views_max={self.settings.views_max} views", events)
            return None
        if (why := self._touched_often()) is not None:
            self._finish(MissionStatus.GAVE_UP, why, events)
            return None
        passed = bool((np.hypot(*self.guard.around.came_now().T) < PASSED_M).any())
        if self.aside.resting(pose[:2], self.settings.arrive_m, passed=passed):
            self.path = None
            return self._wait(self.aside.for_m, pose, events)
        if self.path is not None and (blockage := self._blockage(pose)) is not None:
            command = self._answer(blockage, pose, events)
            if command is not None or self.book.current is None:
                return command
        if self.path is not None and np.linalg.norm(closest_on_path(self.path.points_m, pose[:2])[1] - pose[:2]) > 0.6:
            self.path = None
            self.book.missions[-1].replans += 1
            events.append(Event.REPLAN)
        if self.path is None and not self._plan(pose, events):
            return self._after_failed_plan(pose, events)
        assert self.path is not None
        pace = self.guard.pace_here
        command = steer(self.path.points_m, belief.map_from_body, pace)
        if not self.guard.sees:
            return self._with_room(command, scan, events)
        return self._safely(command, in_body(target_on(self.path.points_m, pose[:2], pace), pose), pose, events)

    def _safely(self, command: Twist, target_m: np.ndarray, pose: np.ndarray, events: list[Event]) -> Twist:
        """The command as far as what was seen allows it; a robot without room plans anew, and goes back if that does not
        help. target_m (2,): where it shall lead, in the body frame."""
        allowed, why = self.guard.allow(command, target_m)
        if why is not None:
            events.append(why)
        if allowed is not None:
            self.barred = 0 if allowed.forward_mps else self.barred  # who only turns has not come past
            return allowed
        self.path, self.barred = None, self.barred + 1
        if self.barred % 3 == 0:
            if (back := self._back(pose)) is not None:
                return back
            self.queued = self.guard.way_out(float(np.arctan2(target_m[1], target_m[0])))
        side = 1.0 if target_m[1] > 0 else -1.0
        on_the_spot = turn(side * self.pace.turn_step_rad, Pace(turn_step_rad=self.pace.turn_step_rad))
        return self.queued.pop(0) if self.queued else on_the_spot

    def _with_room(self, command: Twist, scan: Scan | None, events: list[Event]) -> Twist:
        """The command of a robot that believes in walls without measuring them, cut to what is free ahead among them."""
        if (cut := cut_to_room(command, scan, self.radius_m)) is not None:
            return cut
        events.append(Event.STOPPED)
        self.path = None
        side = 1.0 if self.progress.still % 4 < 2 else -1.0
        return turn(side * self.pace.turn_step_rad, Pace(turn_step_rad=self.pace.turn_step_rad))

    def _plan(self, pose: np.ndarray, events: list[Event]) -> bool:
        """Plan the way to the current place; whether there is one."""
        self.attempts += not self.guard.moves  # who walks there goes on; views_max ends that
        mission, aside_m = self.book.missions[-1], self.aside.goal_m
        monocular = self.guard.around.monocular  # which may not see again from near what it saw from afar
        near = self._near_things(pose, walls=monocular) if self.barred else NOTHING
        besides = [NOTHING]
        if monocular:  # as far as its pictures err; where no way does, what its guard keeps has to do
            besides.insert(0, spread(self._near_things(pose), self.settings.advanced.guard.pictured_m))
        elif self.guard.refused_for_hidden and not self.guard.moves:  # round what its guard refuses, if it can
            besides.insert(0, in_map(self.guard.around.hidden(), pose))
        seen = in_map(self.guard.around.things(least=SURE), pose) if self._squeezes else None
        goal_m = np.array(mission.goal_m) if aside_m is None else aside_m

        def ask(more: np.ndarray) -> Path:
            return self.roads.plan(pose[:2], goal_m, obstacles=self.watch.cells, things_m=np.concatenate([near, more]),
                                   squeeze=self.guard.sees, seen_m=None if seen is None else np.concatenate([seen, more]))

        for more in besides if len(besides[0]) else [NOTHING]:
            plan = ask(more)
            if plan.found:
                break
        if monocular and plan.found:
            plan = self._round_hidden(plan, lambda hidden_m: ask(np.concatenate([more, hidden_m])), pose)
        self.watch.planned(squeezed=plan.found and self.roads.side_m < self.settings.margin_m)
        self.guard.tight = plan.found and self.roads.side_m < self.settings.advanced.guard.side_m
        self.plans.append((mission.mission, plan))
        self.path = plan if plan.found and len(plan.points_m) >= 2 else None
        self.last_reason = plan.reason
        events.append(Event.PLAN if self.path is not None else Event.NO_PLAN)
        return self.path is not None

    def _round_hidden(self, plan: Path, ask: Callable[[np.ndarray], Path], pose: np.ndarray) -> Path:
        """For one camera, which sees nothing by turning to a side it has not seen: the way round it, where that is hardly
        longer than the plan. ask: the way round further points (K, 2) of the map."""
        side_m = self.roads.side_m
        for deep_m in DEPTHS_M:
            hidden_m = in_map(self.guard.around.hidden(within_m=NEAR_M, deep_m=deep_m, mapped_m=OFF_WALL_M), pose)
            if len(hidden_m) and (wider := ask(hidden_m)).found and length_m(wider) <= LONGER * length_m(plan):
                return wider
        self.roads.side_m = side_m
        return plan

    def _finish(self, status: MissionStatus, reason: str, events: list[Event]) -> None:
        """End the mission."""
        self.book.close(status, reason)
        events.append(Event(status))
        grid = self.watch.redrawn() if self.slam is None else check_grid(self.slam.grid(), who=self.who["localiser"])
        self.watch.forget()
        if grid is not None:
            touched_m = self.watch.touched_m
            self._take_map(grid)
            self.watch.bump(touched_m)
        elif self.ventured:
            self._drive_on(self.free)
        self._begin_place()

    def _near(self, pose: np.ndarray) -> bool:
        return bool(np.linalg.norm(pose[:2] - self.book.missions[-1].goal_m) <= self.settings.arrive_m)

    def _stuck(self, pose: np.ndarray) -> str | None:
        """Why the place is given up, if it is."""
        self.waited = 0 if self.progress.note(pose) else self.waited
        if self.progress.still >= self.settings.stuck_steps:
            return "commands moved the robot less than 5 cm each"
        return f"planned {self.attempts} times" if self.attempts > self.settings.tries * 10 else None

    def _touched_often(self) -> str | None:
        """Why the place is given up for what was touched on the way to it, if it is."""
        if self.guard.pressed and self.contacts > 1:
            return f"contact: touched the same thing again and had not left it ({self.contacts} touches)"
        return f"contact: touched something unseen {self.contacts} times" if self.contacts > self.settings.contacts else None

    def _no_way_on(self) -> str | None:
        """The same of a lost robot beside what it touched, that has not come away from it either."""
        if not self.guard.beside:
            return None
        stuck = self._stuck(planar(self.guard.around.pose))
        return self._touched_often() or (f"{stuck} beside what it touched" if stuck else None)

    def _find_oneself(self, belief: Belief, scan: Scan | None, events: list[Event]) -> Decision:
        """Not knowing where it is, the robot looks for itself until it knows again, or gives the place up."""
        self.path = None
        self.lost_steps += 1
        self.lost_in_all += 1
        mission = self._mission(belief)
        events.append(Event.LOST)
        no_way = self._no_way_on()
        too_long = self.lost_in_all > self.settings.lost_views_total
        if no_way or too_long or self.lost_steps > self.settings.lost_views:
            views = f"{self.lost_in_all - 1} views of the patrol" if too_long else f"{self.lost_steps - 1} views"
            self._finish(MissionStatus.GAVE_UP, f"lost: the robot did not find itself in {views}"
                         f"{f'; {no_way}' if no_way else ''}", events)
            if self.book.done:
                return Decision(None, None, tuple(events), mission.mission)
        command, why = self.search.guarded(belief, self.obstacle if self.obstacle is not None else scan, self.guard)
        if why is not None:
            events.append(why)
        return Decision(command, None, tuple(events), mission.mission)
