"""The survey that nobody leads: look round, go where most unknown ground is seen for the way, until nothing is left; home.

The explorer is a sentinel whose places are found as it goes: the same planner, margin, guard, looking, backing off. Its
belief is the sum of the odometry, each scan laid onto the map drawn so far: it drives by that map, which bends where the
odometry drifts. It is not redrawn on the way; at the end the loop is closed and it is drawn anew, as after every survey.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.belief import moved
from rhs.api.contracts import Blockage, Blocked, Source
from rhs.api.errors import ConfigError
from rhs.api.frozen import freeze
from rhs.api.geometry import planar, se2, wrap
from rhs.api.grid import OccupancyGrid, inflate, nearest_open
from rhs.api.records import Belief, Capture, Event, MissionStatus, Motion, Observation, Scan, Step, Twist
from rhs.api.task import Parts
from rhs.estimation.scans.settings import MatchSettings, VoteSettings
from rhs.estimation.survey import FURNITURE, FURNITURE_VOTES

from .control import turns
from .frontiers import Frontiers, Look
from .loop import Decision, steps
from .mission import MissionSettings, turning
from .observers import write_json
from .planning import GOAL_SLACK_M
from .sentinel import Sentinel

if TYPE_CHECKING:
    from rhs.estimation.scans.scan_match import ScanMatcher

HOME = "home"
MATCH_AFTER, REDRAW = 10, 5  # views that make a map worth matching with, and views between two drawings of it
PLANAR, OTHERS = (0, 1, 5), (2, 3, 4)  # x, y, yaw of a covariance (6, 6); height, roll, pitch
LEAST_DOUBT = np.diag([1e-4, 1e-4, 1e-4])  # since the last match: 1 cm and half a degree, odometries promise too much
ALL_DRAWN = MatchSettings(unmapped=0.0)  # a map just drawn holds what stands there
STOOD = 0.05  # chance that something stands where the robot's own body was


Place = tuple[str, float, float]  # name, x, y


class Onwards:
    """The explorer's answer to a blocked way: plan again."""

    def blocked(self, blockage: Blockage) -> Blocked:
        return Blocked.REPLAN


class Explorer(Sentinel):
    """Pilot of a survey that nobody leads. `stop`: why it went home; `explored_views`: after how many views."""

    phase, believer = "survey", "odometry"
    faced: bool  # whether it has turned to what is to be seen from where it was going

    def __init__(self, parts: Parts, settings: MissionSettings, *, visit: Sequence[Place] = ()) -> None:
        """visit: places to look round at once nothing is left to see, before it goes home."""
        from rhs.estimation.scans.votes import Votes  # compiled code

        facts = parts.source.facts
        self.mapper, self.explore = parts.mapper, settings.advanced.explore
        grid = self.mapper.grid()
        self.low = Votes(grid.shape, grid.resolution_m, grid.origin_m, VoteSettings())
        self.looks: list[Look] = []  # in vain
        self.stood = np.zeros(grid.shape, bool)
        self.hemmed_in = False  # no plan leads away from where it began: what nobody saw beside its body is free, then
        self.inside = _within(grid, facts.bounds_m)
        self.matcher: ScanMatcher | None = None
        self.views_in_all = 0
        self.belief, self.begun = Belief(se2(*facts.start), np.diag([1e-6] * 6)), False
        self.start, self.stop, self.explored_views = np.array(facts.start), "", 0
        self.to_visit = [place for place in visit if self.explore.places]
        self.been = [np.array(facts.start[:2])]  # where it looked round
        super().__init__(parts, grid, (), places=(("start", *facts.start[:2]),), radius_m=facts.robot_radius_m,
                         footprint=facts.footprint, settings=settings)
        self.replan = Onwards()
        self.facing_rad = float(facts.start[2])
        self.queued = turns(self._round(), self.pace)

    # --- the pilot's side of the loop -------------------------------------------------------------------------------

    def first(self, source: Source) -> Capture | None:
        return self._driven(source, Twist(0.0, 0.0, 0.05))

    def locate(self, observation: Observation, motion: Motion) -> Belief:
        self.guard.observe(observation, motion)
        self.obstacle = observation.obstacle
        self.belief = self._on_map(moved(self.belief, motion), observation.scan) if self.begun else self.belief
        self.begun = True
        return self.belief

    def _on_map(self, belief: Belief, scan: Scan | None) -> Belief:
        """The belief with the scan laid onto the map drawn so far; as it is where the scan does not fit there."""
        from rhs.estimation.scans.scan_match import ScanMatcher  # compiled code

        self.views_in_all += 1
        if scan is None or self.views_in_all < MATCH_AFTER:
            return belief
        if self.matcher is None or self.views_in_all % REDRAW == 0:
            self.matcher = ScanMatcher(self.mapper.grid(), ALL_DRAWN)
        planar_of = np.ix_(PLANAR, PLANAR)
        match = self.matcher.match(scan, planar(belief.map_from_body), belief.covariance[planar_of] + LEAST_DOUBT)
        if match is None:
            return belief
        covariance = measured_anew(belief.covariance, match.covariance)
        return Belief(freeze(se2(*match.state)), freeze(covariance), belief.status)

    def note(self, belief: Belief, scan: Scan) -> None:
        from rhs.estimation.scans.votes import low_only

        super().note(belief, scan)
        self.explore = self.explore.seeing(np.asarray(scan.bearings_rad))
        self.mapper.update(belief.map_from_body, scan)
        if self.obstacle is not None:
            self.low.look(belief.map_from_body, self.obstacle, hits=low_only(self.obstacle, scan), within_m=np.inf)

    def decide(self, belief: Belief, scan: Scan | None) -> Decision:
        pose = planar(belief.map_from_body)
        self.stood |= self._covered(pose[:2])
        self.explored_views += not self.stop
        if self.book.current is not None and not self.stop and not self.queued and self._seen_already():
            self._finish(MissionStatus.ARRIVED, "seen on the way", [])
        return replace(super().decide(belief, scan), mission=0)

    # --- what is left to see -----------------------------------------------------------------------------------------

    def _more(self, pose: np.ndarray) -> bool:
        """Whether there is somewhere to go: the next viewpoint is put into the book, in the end home."""
        if not self.book.done:
            return True
        if self.book.places[-1][0] == HOME:
            return False
        frontiers = self._frontiers()
        view = None if self.stop else frontiers.best(pose)
        if view is None and not self.stop and not self.hemmed_in and self._never_arrived():
            self.hemmed_in, self.looks = True, []
            frontiers = self._frontiers()
            view = frontiers.best(pose)
        self.stop = self.stop or self._why_stop(frontiers, left=view is not None)
        self._take_map(frontiers.grid)
        if view is None or self.stop:
            place = self._unseen_place(frontiers, pose) or (HOME, float(self.start[0]), float(self.start[1]))
            self.facing_rad = float(self.start[2])
        else:
            place = (f"view {len(self.book.places)}", float(view.at_m[0]), float(view.at_m[1]))
        self.book.places = (*self.book.places, place)
        return True

    def _never_arrived(self) -> bool:
        """Whether it got to none of the viewpoints that it chose."""
        chosen = self.book.missions[1:]
        return bool(chosen) and all(mission.status is not MissionStatus.ARRIVED for mission in chosen)

    def _unseen_place(self, frontiers: Frontiers, pose: np.ndarray) -> Place | None:
        """The nearest place to visit that the robot has not been near; None where there is none it can get to."""
        ways_m, slack_m = frontiers.ways_m(pose[:2]), self.settings.arrive_m - GOAL_SLACK_M
        left = []
        for place in self.to_visit:
            at_m = np.array(place[1:])
            gap_m = min(float(np.linalg.norm(at_m - been)) for been in self.been)
            if self.grid.inside(at_m[None])[0] and gap_m >= self.explore.place_m:
                stand_m = nearest_open(self.grid, ~frontiers.open_, at_m, slack_m)
                left.append((float(ways_m[tuple(self.grid.cells(stand_m[None])[0])]), place))
        way_m, nearest = min(left, default=(np.inf, None))
        if nearest is None or not np.isfinite(way_m):
            return None
        self.to_visit.remove(nearest)
        return f"at {nearest[0]}", nearest[1], nearest[2]

    def _round(self) -> list[float]:
        """Turns once round, as shares of the largest turn between two views."""
        return [1.0] * int(np.ceil(2.0 * np.pi / self.pace.turn_step_rad))

    def _why_stop(self, frontiers: Frontiers, *, left: bool) -> str:
        known = float((~frontiers.unknown)[self.inside].mean())
        if not left:
            return "no frontier"
        if self.explored_views >= self.explore.views:
            return f"budget: mission.advanced.explore.views={self.explore.views}"
        return f"coverage: {known:.3f} of the bounds known" if known >= self.explore.coverage < 1.0 else ""

    def _frontiers(self) -> Frontiers:
        return Frontiers(self._drawn(), self.radius_m + self.settings.margin_m, self.looks, self.explore)

    def _drawn(self) -> OccupancyGrid:
        """The map so far, with what stands below the camera, what was touched, and where the robot has been."""
        grid = self.mapper.grid()
        probability = grid.probability.copy()
        if self.hemmed_in:
            beside = inflate(self.stood, self.settings.margin_m / grid.resolution_m + 1.0)
            probability[beside & ~grid.occupied()] = STOOD
        probability[self.stood] = STOOD
        probability[self.low.votes >= FURNITURE_VOTES] = FURNITURE
        return replace(grid, probability=probability)

    def _covered(self, at_m: np.ndarray) -> np.ndarray:
        """(H, W) bool: the cells under the robot's body."""
        rows, columns = np.ogrid[:self.grid.shape[0], :self.grid.shape[1]]
        x, y = (at_m - np.array(self.grid.origin_m)) / self.grid.resolution_m - 0.5
        return (columns - x) ** 2 + (rows - y) ** 2 <= (self.radius_m / self.grid.resolution_m) ** 2

    def _seen_already(self) -> bool:
        """Whether the viewpoint that the robot is driving to shows nothing new any more, or the budget is spent."""
        frontiers, goal = self._frontiers(), np.array(self.book.missions[-1].goal_m)
        gain, _ = frontiers.seen_m2(self.grid.cells(goal[None]))
        return bool(gain[0] < self.explore.least_m2) or self.explored_views >= self.explore.views

    def _near(self, pose: np.ndarray) -> bool:
        """At the viewpoint, and turned to what is to be seen from it."""
        if self.queued or not super()._near(pose):
            return False
        if not self.faced:
            self.faced = True
            place = self.book.missions[-1].place
            if place != HOME and self.stop:
                self.been.append(pose[:2])
                self.queued = turns(self._round(), self.pace)
                return False
            if not self.stop:
                self.facing_rad = self._best_facing(self._frontiers(), pose[:2])
            off = float(wrap(self.facing_rad - pose[2])) / self.pace.turn_step_rad
            count = int(np.ceil(abs(off) - 0.25))
            self.queued = turns([off / count] * count if count > 0 else [], self.pace)
        return not self.queued

    def _best_facing(self, frontiers: Frontiers, at_m: np.ndarray) -> float:
        """The heading in which most unknown ground is seen from at_m (2,), radians."""
        return float(frontiers.seen_m2(self.grid.cells(at_m[None]))[1][0])

    # --- the sentinel's missions -------------------------------------------------------------------------------------

    def _begin_place(self) -> None:
        super()._begin_place()
        self.faced = False

    def _finish(self, status: MissionStatus, reason: str, events: list[Event]) -> None:
        """What was touched goes into the map; frontiers looked at in vain are not looked at again."""
        self.low.votes = np.maximum(self.low.votes, self.watch.below.votes * (self.contacts > 0))
        goal_m = np.array(self.book.missions[-1].goal_m)
        if self.book.missions[-1].place == HOME and status is not MissionStatus.ARRIVED:
            self.stop += f"; home not reached: {reason}"
        elif not self.stop and (self.faced or status is not MissionStatus.ARRIVED):
            frontiers = self._frontiers()
            if not self.faced:  # it did not get there; what it would have turned to is not worth another try from there
                self.facing_rad = self._best_facing(frontiers, goal_m)
            self.looks.append(Look(goal_m, frontiers.looked_at(goal_m, self.facing_rad)))
        super()._finish(status, reason, events)


def _within(grid: OccupancyGrid, bounds_m: tuple[float, float, float, float]) -> np.ndarray:
    """(H, W) bool: cells whose middle lies within the bounds (x_min, y_min, x_max, y_max)."""
    middles = grid.centres(np.argwhere(np.ones(grid.shape, bool)))
    return ((middles >= bounds_m[:2]) & (middles <= bounds_m[2:])).all(axis=1).reshape(grid.shape)


def check_explorable(parts: Parts, sensed: frozenset[str]) -> None:
    """sensed: what the sensor provides. Raises ConfigError, in one line, where a survey cannot be explored."""
    if parts.slam is not None:
        raise ConfigError("mission.survey=explore draws its map with the mapper, whose place slam= has taken; "
                          "leave slam= out")
    if "driving" not in parts.provides:
        raise ConfigError(f"mission.survey=explore drives the robot, which {parts.who['source']} cannot do; "
                          "type mission.survey=route")
    if "scan" not in sensed:
        raise ConfigError(f"mission.survey=explore needs a measured scan, which {parts.who['sensor']} does not give; "
                          "type sensor=rgbd or mission.survey=route")


def explored(parts: Parts, settings: MissionSettings, folder: Path, *, visit: Sequence[Place] = ()) -> Iterator[Step]:
    """Explore until a stated reason, look round at the places to visit, then home; explore.json says how it went."""
    explorer = Explorer(parts, turning(settings, parts.odometry), visit=visit)
    try:
        yield from steps(parts.source, parts.sensor, parts.odometry, explorer, who=parts.who)
    finally:
        write_json(folder / "explore.json", summary(explorer))


def summary(explorer: Explorer) -> dict[str, Any]:
    """Of explore.json: why it stopped, after how many views, and the viewpoints."""
    return {"stop": explorer.stop or "broken off", "views": explorer.explored_views,
            "viewpoints": [mission.goal_m for mission in explorer.book.missions]}


def measured_anew(covariance: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(6, 6) covariance of a pose whose x, y and yaw have the covariance `spread` (3, 3) from now on. Height, roll and pitch
    follow by their regression on these, as a Gaussian's do, so that it stays positive definite."""
    plane, across, rest = np.ix_(PLANAR, PLANAR), np.ix_(PLANAR, OTHERS), np.ix_(OTHERS, OTHERS)
    slope = np.linalg.solve(covariance[plane], covariance[across])
    out = covariance.copy()
    out[plane], out[across] = spread, spread @ slope
    out[np.ix_(OTHERS, PLANAR)] = out[across].T
    out[rest] += slope.T @ (spread - covariance[plane]) @ slope
    return 0.5 * (out + out.T)
