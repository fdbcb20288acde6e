"""How a robot that does not know where it is moves so that it finds out: look round, go on, look round again.

Views were stored in the direction of the survey only; a robot that faces the other way recognises nothing until it has
turned. And one recognised place is not enough where places look alike: what is recognised has to be driven past. So the
robot turns on the spot until something is recognised (its belief is likelier right than wrong) and then goes on that way;
when a whole turn showed nothing, it goes on for a while where there is room. So it does when what is recognised stands
before a wall or in a corner, where a robot that hopes only turns to and fro.
"""

from __future__ import annotations

import numpy as np

from rhs.api.records import Belief, Event, Scan, Twist

from .control import Pace, turn
from .guard import Guard

HOPE = 0.5  # chance of being right above which the robot goes on the way it looks
GO_ON_M = 2.0  # way between two looks round
ROOM_M = 0.6  # less room than this ahead: turn
ENOUGH_RAD = 4.0 * np.pi  # turned on end without a step ahead: the room asked for is nowhere
STOP_SHORT_M = 0.15  # the robot stops this far from what it sees ahead
OPEN_M = 5.0  # farther than this the room is as good as it gets


class Search:
    """The commands of a robot that is lost."""

    def __init__(self, radius_m: float, pace: Pace) -> None:
        self._radius_m, self._pace = radius_m, Pace(pace.speed_mps, pace.step_m, pace.turn_step_rad)
        self.begin()

    def begin(self) -> None:
        """The robot is not lost: the next search begins with a look round."""
        self._turned_rad, self._way_m, self._side, self._away = 0.0, 0.0, 0.0, 0
        self._barred_rad, self._leave_m = 0.0, 0.0  # turned where there was no way to go on; metres to go whatever is hoped
        self._spun_rad, self._out_m, self._queued = 0.0, 0.0, list[Twist]()  # turned on end; metres out of a narrow place

    def turn_away(self) -> None:
        """There is no way ahead, whatever the scan says: the next commands turn the robot by a quarter, on the same side."""
        self._away = max(self._away, round(0.5 * np.pi / self._pace.turn_step_rad))
        self._side = self._side or 1.0

    def guarded(self, belief: Belief, scan: Scan | None, guard: Guard) -> tuple[Twist, Event | None]:
        """The next command as far as the guard allows it, else a turn away; and why it is another one."""
        if guard.sees and self._spun_rad >= ENOUGH_RAD:
            self._spun_rad, self._out_m = 0.0, GO_ON_M
        command, why = guard.allow(self._out(guard) or self.next(belief, scan))
        if command is None:
            self.turn_away()
            command = self.next(belief, scan)
        self._spun_rad = 0.0 if command.forward_mps else self._spun_rad + abs(command.turn_radps) * command.duration_s
        return command, why

    def _out(self, guard: Guard) -> Twist | None:
        """The next command out of a place that leaves less room than `_go` asks for, by what the guard knows round it."""
        if self._out_m <= 0.0:
            return None
        self._queued = self._queued or guard.way_out(0.0)
        if not self._queued:
            self._out_m = 0.0
            return guard.back_off()
        command = self._queued.pop(0)
        self._out_m -= command.forward_mps * command.duration_s
        return command

    def next(self, belief: Belief, scan: Scan | None) -> Twist:
        """The next command."""
        if scan is None:
            return turn(self._pace.turn_step_rad, self._pace)
        if self._away > 0:
            self._away -= 1
            return turn(self._side * self._pace.turn_step_rad, self._pace)
        if self._leave_m > 0.0:
            command = self._go(scan)
            self._leave_m -= command.forward_mps * command.duration_s
            return command
        if belief.probability >= HOPE:
            self._turned_rad, self._way_m = 0.0, 0.0
            command = self._go(scan)
            self._barred_rad += abs(command.turn_radps) * command.duration_s if command.forward_mps == 0.0 else 0.0
            if self._barred_rad >= 2.0 * np.pi:
                self._leave_m, self._barred_rad = GO_ON_M, 0.0
            return command
        if self._turned_rad < 2.0 * np.pi - 1e-6:
            self._turned_rad += self._pace.turn_step_rad
            self._side = self._side or _open_side(scan)
            return turn(self._side * self._pace.turn_step_rad, self._pace)
        self._way_m += self._pace.step_m
        if self._way_m >= GO_ON_M:
            self._turned_rad, self._way_m = 0.0, 0.0
        return self._go(scan)

    def _go(self, scan: Scan) -> Twist:
        """Forward and towards the open; without room ahead on round to one side, the same until there is room."""
        if clear_ahead_m(scan, self._radius_m + 0.1) < ROOM_M:
            self._side = self._side or _open_side(scan)
            return turn(self._side * self._pace.turn_step_rad, self._pace)
        self._side = 0.0
        most = self._pace.turn_step_rad
        seconds = self._pace.step_m / self._pace.speed_mps
        return Twist(self._pace.speed_mps, float(np.clip(0.5 * open_bearing(scan), -most, most)) / seconds, seconds)


def open_bearing(scan: Scan) -> float:
    """Bearing in radians of the room that the scan sees: the mean over the beams, weighed by the cube of their length."""
    weight = np.minimum(_reach(scan), OPEN_M) ** 3
    return float(weight @ scan.bearings_rad / weight.sum()) if weight.sum() > 0 else 0.0


def clear_ahead_m(scan: Scan, radius_m: float) -> float:
    """Free metres in front of a round robot, from the beams inside its swath; inf when nothing is seen there."""
    seen = np.isfinite(scan.ranges_m)
    x = scan.origin_xy_m[0] + scan.ranges_m[seen] * np.cos(scan.bearings_rad[seen])
    y = scan.origin_xy_m[1] + scan.ranges_m[seen] * np.sin(scan.bearings_rad[seen])
    inside = (np.abs(y) < radius_m) & (x > 0)
    return float(x[inside].min() - radius_m) if inside.any() else np.inf


def cut_to_room(command: Twist, scan: Scan | None, radius_m: float) -> Twist | None:
    """The command, ended where the scan has something ahead; None where there is no room at all."""
    if command.forward_mps <= 0 or scan is None:
        return command
    room_m = clear_ahead_m(scan, radius_m) - STOP_SHORT_M
    if room_m >= command.forward_mps * command.duration_s:
        return command
    return Twist(command.forward_mps, command.turn_radps, room_m / command.forward_mps) if room_m > 0.05 else None


def _open_side(scan: Scan) -> float:
    """1 (left) or -1, whichever side of the scan sees more room"""
    seen = _reach(scan)
    return 1.0 if seen[scan.bearings_rad > 0].mean() >= seen[scan.bearings_rad <= 0].mean() else -1.0


def _reach(scan: Scan) -> np.ndarray:
    """(B,) metres; a beam without an end sees as far as can be."""
    return np.where(np.isfinite(scan.ranges_m), scan.ranges_m, scan.max_range_m)
