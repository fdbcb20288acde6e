"""Between what the pilot wants and what the wheels do: no command leads nearer to anything seen than a margin, nor over
ground that nobody has looked at, nor faster than the robot can stop in the way it has seen."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rhs.api.errors import Bounded, within
from rhs.api.records import Event, Motion, Observation, Tracking, Twist
from rhs.api.robot_shape import Footprint
from rhs.estimation.scans.settings import VoteSettings

from .control import TURN_RATE_MAX_RADPS, Pace, turn
from .neighbours import near_any
from .surroundings import CELL_M, NOTHING, SURE, THING, Surroundings

CURVES_PER_M = np.array([-2.5, -1.6, -1.0, -0.5, 0.0, 0.5, 1.0, 1.6, 2.5])  # of the arcs tried when the wished one is barred
BEHIND_M = 0.03  # the robot goes back no nearer to anything: half a cell, and what it sees of it is some time ago
TIGHT_M = 0.04  # on a way through a gap hardly wider than the robot: half a cell of what was seen, and the noise of depth
BESIDE_M, SHORT_STEP_M, SHORT_SIGHT_M = 0.2, 0.1, 0.2  # so near to things there: steps and lookahead that keep to the way
MOST_HELD = 20  # looks and refusals on end, after which a robot that stands has looked enough
MOST_REFUSED = 6  # commands on end after which one camera looks anew from where it gets to
OFF_WALL_M = 0.3  # so far from a wall of the map one camera may have seen it (as mission.wall_tolerance_m)
LEAST_M = 0.08  # a shorter way is none
LEAST_RAD = np.radians(1.0)  # nor is a smaller turn
FEW_PATCHES = 2  # fewer patches of 10 cm unseen are seams between views
EDGE_RAD = np.radians(4.0)  # this near the edge of the view a patch is not looked at yet
PRESSED_M = 0.5  # what was touched bars commands until the robot's side has come so far from it
AGAIN_M = 0.1  # touched so near to where it was touched before, without having left it, is the same touched again


@dataclass(frozen=True)
class GuardSettings(Bounded):
    """How careful the robot drives."""

    side_m: float = within(0.05, 0.0, 2.0)
    """least distance of the robot's side to anything seen, metres: half the margin of the plans, so that a path planned with
    it can be driven; it covers the depth noise (1 cm at 2 m) and the error of a command (3 % of 0.25 m)"""
    pictured_m: float = within(0.05, 0.0, 2.0)
    """and so much further from what one camera read off pictures and the map does not know, metres; so do its plans. Such
    readings erred by 5 cm at 1.5 to 2 m (rms, a patrol of random:non_manhattan/710)"""
    look_s: float = within(15.0, 0.1, 1e6)
    """what nobody has looked at for so long is looked at before the robot drives there, seconds: people walk in.
    What is low and was out of view for so long, while something moves, is not counted on either"""
    look_moving_s: float = within(1.5, 0.1, 1e6)
    """the same while something has been seen to move, in the last remember_s: who walks 0.8 m/s is elsewhere after 2 s"""
    fade_s: float = within(4.0, 0.1, 1e6)
    """and what was seen to come, or stands where the map knows nothing, is forgotten when it was not seen for so long,
    seconds"""
    remember_s: float = within(60.0, 0.1, 1e6)
    """what was seen so long ago and not again is not counted on, seconds: the odometry drifts, people move"""
    ahead_m: float = within(0.15, 0.0, 2.0)
    """the ground is looked at this much further than the next command leads, metres"""
    brake_mps2: float = within(0.5, 0.01, 100.0)
    """braking of the robot: its speed lets it stop in the way that it sees free, metres per second squared"""
    back_off_m: float = within(0.2, 0.0, 2.0)
    """after a touch the robot goes back so far the way it came, metres"""
    still_views: int = within(3, 1, 10_000)
    """commands on end that moved it less than still_share of their way are a touch, whatever the bumper says"""
    still_share: float = within(0.25, 0.0, 1.0)
    """see still_views; wheels that slip by half still move it more"""
    votes: VoteSettings = field(default_factory=VoteSettings)


class Guard:
    """Watches over the commands of one patrol. `touched`: since the last view the robot ran into something."""

    def __init__(self, radius_m: float, pace: Pace, settings: GuardSettings, footprint: Footprint | None = None) -> None:
        self.radius_m, self.pace, self.settings = radius_m, pace, settings
        self.around = Surroundings(radius_m, settings.votes, remember_s=settings.remember_s, fade_s=settings.fade_s,
                                   low_s=settings.look_s, pictured_m=settings.pictured_m, footprint=footprint)
        self.touched = False
        self.tight = False  # whether the way leads through a gap hardly wider than the robot
        self.given: Twist | None = None
        self._still = self._refused = self._held = 0
        self.refused_for_hidden = 0  # commands refused on the way to a place for what is hidden alone
        self._here_s = -np.inf  # when the last view was taken after anything but a turn on the spot
        self._to_see = np.zeros((0, 2))  # ground to look at, in the frame of the surroundings
        self.touched_m = NOTHING  # (K, 2) what was touched in this patrol and nobody has looked through, in the body frame
        self.known_m = NOTHING  # (K, 2) all that the map and the watch over it know near by, in the body frame; monocular
        self._forgot_s = -np.inf  # when what was seen was given up for what is known
        self._hidden_m = NOTHING  # (K, 2) where the unseen rest of things may stand, in the body frame
        self._bumps: list[np.ndarray] = []  # (7, 2) marks of touches, in the frame of the surroundings
        self.lost = False  # the robot does not know where it is
        self.pressed, self._away = 0, 0.0  # touches again of the same on the way to a place; side to which it turns from it

    @property
    def sees(self) -> bool:
        """Whether anything is measured: a camera that only believes in walls cannot look at ground."""
        return self.around.sight is not None

    @property
    def _since_s(self) -> float:
        settings = self.settings
        return self.around.now_s - (min(settings.look_moving_s, settings.look_s) if self.moves else settings.look_s)

    @property
    def _looked_since_s(self) -> float:
        """The same of the ground ahead: a look round takes longer than that, so what was seen since the robot began to turn
        on the spot was seen just now; else it looks to and fro for ever."""
        return max(min(self._since_s, self._here_s), self.around.now_s - self.settings.look_s)

    @property
    def moves(self) -> bool:
        """Whether something was seen to move lately."""
        return self.around.moves

    @property
    def side_m(self) -> float:
        """Least distance asked for now."""
        return min(TIGHT_M, self.settings.side_m) if self.tight else self.settings.side_m

    @property
    def pace_here(self) -> Pace:
        """How to follow a way from here: beside things on a tight one in short steps, close to it."""
        if not self.tight or self.pace.arc_radius_m:
            return self.pace
        gaps_m = np.linalg.norm(self.around.things(), axis=1)
        if not len(gaps_m) or gaps_m.min() > self.radius_m + BESIDE_M:
            return self.pace
        return replace(self.pace, step_m=min(self.pace.step_m, SHORT_STEP_M), lookahead_m=SHORT_SIGHT_M, cut_m=0.01)

    def observe(self, observation: Observation, motion: Motion) -> None:
        """Take one view and what came of the command before it."""
        self.around.observe(observation, motion)
        if self.around.map_m is not None:  # else nobody else knows of them
            self._bumps = self.beside
        if self.given is None or self.given.forward_mps or not self.given.turn_radps:
            self._here_s = self.around.now_s
        wished_m = abs(self.given.forward_mps) * self.given.duration_s if self.given else 0.0
        moved_m = float(np.hypot(*motion.previous_from_body[:2, 3]))
        if wished_m > LEAST_M and motion.status is not Tracking.LOST:
            self._still = self._still + 1 if moved_m < self.settings.still_share * wished_m else 0
        self.touched = bool(observation.contact) or self._still >= self.settings.still_views

    def back_off(self, walls_m: np.ndarray = NOTHING) -> Twist | None:
        """Back the way it came (straight, after a turn on the spot; after a touch and with one camera turning no further
        than in any command, else no view shows what the last one did) as far as nothing is known there; None without room. A
        robot that went back already and touched nothing goes back further; where something moves, over ground that it has
        just seen or come over. walls_m (K, 2): of the map, in the body frame."""
        touched, self.touched, self._still = self.touched, False, 0
        if self.lost and self._between:
            return None  # nobody sees what is behind
        came = self.given
        if came is None or came.forward_mps == 0.0 or (came.forward_mps < 0.0 and not touched):
            came = Twist(self.pace.speed_mps, 0.0, 1.0)
        most_radps = np.inf
        if touched or self.around.monocular:
            most_radps = self.pace.turn_step_rad * abs(came.forward_mps) / max(self.settings.back_off_m, LEAST_M)
        back = Twist(-came.forward_mps, float(np.clip(-came.turn_radps, -most_radps, most_radps)), came.duration_s)
        behind = self.around.unseen(back, margin_m=0.0, up_to_m=self.settings.back_off_m, since_s=self._since_s)
        if not touched and self.moves and len(behind) >= FEW_PATCHES:
            return None  # somebody may have come up there
        walls_m = np.concatenate([walls_m, self._told_m])
        behind_m = BEHIND_M + (self.settings.pictured_m if self.around.monocular else 0.0)
        way_m = self.around.free_way_m(back, behind_m, self.settings.back_off_m, walls_m=walls_m)
        return _cut(back, way_m) if way_m >= LEAST_M else None

    def bump(self, known_m: np.ndarray = NOTHING) -> np.ndarray:
        """Mark what was touched; its (K, 2) points in the body frame, in which known_m (K, 2) is what else is known."""
        touched_m = self.around.bump(self.given.forward_mps if self.given else 1.0, known_m)
        self.pressed += bool(self.lost and near_any(touched_m, self.bumps_m, AGAIN_M).any())
        self._bumps.append(self.around.in_frame(touched_m))
        self._away = 0.0
        return touched_m

    @property
    def beside(self) -> list[np.ndarray]:
        """Marks (7, 2) of what was touched and not left since, in the frame of the surroundings."""
        near_m = self.radius_m + PRESSED_M
        return [mark for mark in self._bumps if np.hypot(*self.around.in_body(mark).T).min() < near_m]

    @property
    def bumps_m(self) -> np.ndarray:
        """(K, 2) that and, until the robot knows where it is, all that was touched, in the body frame: whatever becomes of
        votes. None for a robot that knows: its map and its votes hold them."""
        if not self.lost:
            return NOTHING
        return self.around.in_body(np.concatenate([NOTHING, *self._bumps]))

    @property
    def _between(self) -> bool:
        """Whether something was touched on two sides, 60 degrees apart or more, and neither was left."""
        marks_m = np.array([self.around.in_body(mark).mean(axis=0) for mark in self.beside]).reshape(-1, 2)
        sides = marks_m / np.hypot(*marks_m.T)[:, None]
        return bool((sides @ sides.T < 0.5).any())

    def off_touched(self, command: Twist) -> Twist:
        """The command, or in the place of one that leads against what was touched a turn on the spot away from it, the same
        way round until there is room."""
        bumps_m = self.bumps_m
        if not len(bumps_m) or command.forward_mps == 0.0:
            return command
        wished_m = abs(command.forward_mps) * command.duration_s
        way_m = self.around.way_to_m(command, bumps_m, np.full(len(bumps_m), CELL_M + BEHIND_M), wished_m)
        if way_m >= min(wished_m, LEAST_M):
            return command if way_m >= wished_m else _cut(command, way_m)
        if not self._away:
            nearest_m = bumps_m[np.argmin(np.hypot(*bumps_m.T))] * np.sign(command.forward_mps)
            self._away = -1.0 if nearest_m[1] > 0.0 else 1.0
        return turn(self._away * self.pace.turn_step_rad, Pace(turn_step_rad=self.pace.turn_step_rad))

    def allow(self, command: Twist, target_m: np.ndarray | None = None) -> tuple[Twist | None, Event | None]:
        """The command, or the one that is safe in its place, and why; None where nothing is.

        target_m (2,): where it shall lead, in the body frame, so that another arc may be taken."""
        self.around.keeps_beside = self._held < MOST_HELD
        allowed, why = self._allowed(command, target_m)
        if allowed is not None and allowed.forward_mps > 0.0:
            self._held = self._refused = 0
        elif command.forward_mps > 0.0:
            self._held += 1
        return allowed, why

    def _allowed(self, command: Twist, target_m: np.ndarray | None) -> tuple[Twist | None, Event | None]:
        if not self.sees or command.forward_mps < 0.0:
            return command, None
        wished_m = command.forward_mps * command.duration_s
        if wished_m > 0.0 and not self.around.monocular and len(self._to_see) < FEW_PATCHES and not self.pace.arc_radius_m:
            self._to_see = self.around.unseen(command, margin_m=self.settings.side_m, since_s=self._looked_since_s,
                                              up_to_m=wished_m + self.settings.ahead_m)
        if self._held < MOST_HELD and (look := self._look()) is not None:
            return self._turned(look, Event.LOOK)
        if wished_m == 0.0:
            return self._turned(command, None)
        held = self._held >= MOST_HELD or self.around.monocular or self.pace.arc_radius_m
        self._hidden_m = NOTHING if held else self.around.hidden(low=self.refused_for_hidden < MOST_HELD)
        seen_m = self._free_m(command, 1.5)
        if seen_m >= wished_m:
            return self._slowed(command, seen_m), None
        other = None if target_m is None else self._other(target_m, wished_m, seen_m)
        if other is not None:
            return other, None
        if seen_m >= LEAST_M:
            return self._slowed(_cut(command, seen_m), seen_m), None
        self._refused += 1
        self.refused_for_hidden += self._hidden_alone(command)
        if self.around.monocular and self._refused % MOST_REFUSED == 0:
            self.forget_seen()
        return None, Event.STOPPED

    def _hidden_alone(self, command: Twist) -> bool:
        """Whether nothing bars the command but what is hidden."""
        hidden_m, self._hidden_m = self._hidden_m, NOTHING
        free = self._free_m(command, LEAST_M) >= LEAST_M
        self._hidden_m = hidden_m
        return free

    def forget_seen(self) -> bool:
        """Give up what was seen near walls of the map for them, all where no map is known: pictures from one place show
        nobody whether it is still there. Whether there was any."""
        self._forgot_s = self.around.now_s
        if self.around.map_m is not None:
            return self.around.forget_near(self.around.map_m, OFF_WALL_M)
        self.around.forget()
        return True

    @property
    def _told_m(self) -> np.ndarray:
        """(K, 2) what the guard keeps from besides what it sees: what was touched, and for as long as what it forgot would
        have counted, all that is known."""
        forgot = self.around.now_s - self._forgot_s < self.settings.remember_s
        told_m = np.concatenate([self.touched_m, self.bumps_m])
        return np.concatenate([told_m, self.known_m]) if forgot else told_m

    def _turned(self, command: Twist, why: Event | None) -> tuple[Twist | None, Event | None]:
        """A turn on the spot, if the corners of the robot have room for it."""
        turned = self.turn_in_room(command)
        barred = turned is not command and abs(turned.turn_radps) * turned.duration_s < LEAST_RAD
        return (None, Event.STOPPED) if barred else (turned, why)

    def turn_in_room(self, command: Twist) -> Twist:
        """A turn on the spot as far as the corners of the robot have room; other commands as they are."""
        if command.forward_mps != 0.0 or self.around.footprint is None or not command.turn_radps:
            return command
        wished_rad = command.turn_radps * command.duration_s
        free_rad = self.around.free_turn_rad(wished_rad, BEHIND_M)
        return command if free_rad == wished_rad else Twist(0.0, free_rad / command.duration_s, command.duration_s)

    def way_out(self, bearing_rad: float) -> list[Twist]:
        """Turns on the spot and the step after them of a robot whose way is barred: the nearest to that bearing at which
        there is room ahead. Nothing where there is none."""
        most, ahead = self.pace.turn_step_rad, Twist(self.pace.speed_mps, 0.0, self.pace.step_m / self.pace.speed_mps)
        turns = most * np.arange(-int(np.pi / most), int(np.pi / most) + 1)
        for turned_rad in sorted(turns, key=lambda angle: abs(angle - bearing_rad)):
            if self._free_m(ahead, self.pace.step_m, float(turned_rad)) >= self.pace.step_m:
                spot = turn(float(np.sign(turned_rad)) * most, Pace(turn_step_rad=most))
                return [spot] * round(abs(turned_rad) / most) + [ahead]
        return []

    def _free_m(self, command: Twist, up_to_m: float, turned_rad: float = 0.0) -> float:
        least = SURE if self.tight and not self.moves else THING  # who walks up is first seen in one view
        return self.around.free_way_m(command, self.side_m, up_to_m, walls_m=self._told_m, hidden_m=self._hidden_m,
                                      least=least, turned_rad=turned_rad)

    def _look(self) -> Twist | None:
        """A turn towards ground ahead that nobody has looked at, until all of it was in the view: what is not seen then
        never will be."""
        around, sight = self.around, self.around.sight
        self._to_see = around.still_unseen(self._to_see, self._looked_since_s)
        if sight is None or len(self._to_see) < FEW_PATCHES:
            return None
        bearing = np.arctan2(*around.in_body(self._to_see).T[::-1])
        right, left = sight.bearings_rad.min() + EDGE_RAD, sight.bearings_rad.max() - EDGE_RAD
        inside = (bearing >= right) & (bearing <= left)
        around.count_as_seen(self._to_see[inside])
        self._to_see, bearing = self._to_see[~inside], bearing[~inside]
        if len(bearing) < FEW_PATCHES:
            return None
        first = float(bearing[np.argmin(np.abs(bearing))])
        beyond = first - left if first > 0 else first - right
        return turn(beyond + np.sign(first) * EDGE_RAD, Pace(turn_step_rad=self.pace.turn_step_rad))

    def _other(self, target_m: np.ndarray, wished_m: float, best_m: float) -> Twist | None:
        """The arc that leads nearest to the target of those on which the robot gets further."""
        best, least = None, np.inf
        for curve in CURVES_PER_M:
            speed = min(self.pace.speed_mps, TURN_RATE_MAX_RADPS / max(abs(curve), 1e-9))
            length_m = min(wished_m, self.pace.turn_step_rad / max(abs(curve), 1e-9))
            arc = Twist(speed, speed * curve, length_m / speed)
            way_m = self._free_m(arc, 1.5)
            if way_m < length_m or way_m < best_m + LEAST_M:
                continue
            end = length_m * np.array([np.cos(0.5 * curve * length_m), np.sin(0.5 * curve * length_m)])
            if (gap := float(np.linalg.norm(target_m - end))) < least:
                best, least = self._slowed(arc, way_m), gap
        return best

    def _slowed(self, command: Twist, seen_m: float) -> Twist:
        """The same arc no faster than the robot can stop in the way seen free."""
        most = float(np.sqrt(2.0 * self.settings.brake_mps2 * max(seen_m, LEAST_M)))
        share = min(1.0, most / command.forward_mps)
        return Twist(command.forward_mps * share, command.turn_radps * share, command.duration_s / share)


def _cut(command: Twist, way_m: float) -> Twist:
    """The command, ended after so many metres."""
    return Twist(command.forward_mps, command.turn_radps, way_m / abs(command.forward_mps))
