"""Moves what moves in a world: a function of the world, of time, and of where the robot stands, for people heed it.

They step nearer than `Person.keep_m` to nobody's robot: whatever it touches, it drove there. They heed neither walls, doors
nor one another: their paths are checked when the world is read. A door or a thing waits until the robot is out of its way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.floorplan import Box, Moving, Person, Timed

STEP_S = 0.05  # nobody walks further than some centimetres between two looks at the robot
CLEAR_M = 0.2  # a thing is put where the robot's side is further away than this
FLEE_MPS = 1.0  # of who is shy
STEP_M = 0.02  # grain of making way
NOWHERE_M = -1000.0  # height of what is not there
Shape = Person | Box


class Walk:
    """One person on the way: arc length along the closed path, direction, time left to stand."""

    def __init__(self, person: Person) -> None:
        self.person = person
        legs = np.diff(np.vstack([person.path_m, person.path_m[:1]]), axis=0)
        self.headings = np.array([math.atan2(y, x) for x, y in legs.tolist()])
        self.corners_m = np.concatenate([[0.0], np.cumsum(np.hypot(*legs.T))])  # arc length of each corner, and of the end
        self.way_m = float(self.corners_m[-1])
        self.at_m, self.ahead = person.start_m % self.way_m, 1.0
        self.pause_s = self.waited_s = 0.0

    def place(self, at_m: float) -> np.ndarray:
        """(3,) x, y, heading of the path there."""
        at_m %= self.way_m
        leg = min(int(np.searchsorted(self.corners_m, at_m, side="right")) - 1, len(self.headings) - 1)
        along, heading = at_m - self.corners_m[leg], self.headings[leg]
        x, y = self.person.path_m[leg]
        return np.array([x + along * math.cos(heading), y + along * math.sin(heading), heading])

    def gap_m(self, at_m: float, robot: np.ndarray) -> float:
        """From there to the side of a robot (x, y, radius)."""
        x, y, _ = self.place(at_m)
        return float(np.hypot(x - robot[0], y - robot[1]) - robot[2] - 0.5 * self.person.width_m)

    def step(self, seconds: float, robot: np.ndarray) -> None:
        """Walk on, unless it is time to stand, or the robot is in the way."""
        if self.person.shy and self.gap_m(self.at_m, robot) < self.person.keep_m:
            length_m = max(self.person.speed_mps, FLEE_MPS) * seconds
            self.at_m = max((self.at_m, self.at_m + length_m, self.at_m - length_m),
                            key=lambda at: self.gap_m(at, robot)) % self.way_m
            return
        if self.pause_s > 0.0:
            self.pause_s -= seconds
            return
        there, pause_s = self._next(self.person.speed_mps * seconds)
        gap_m = self.gap_m(there, robot)
        if gap_m >= self.person.keep_m or gap_m > self.gap_m(self.at_m, robot):
            self.at_m, self.pause_s, self.waited_s = there, pause_s, 0.0
            return
        self.waited_s += seconds
        if self.waited_s >= self.person.patience_s:
            self.ahead, self.waited_s = -self.ahead, 0.0

    def _next(self, length_m: float) -> tuple[float, float]:
        """(where a step of that length leads, seconds to stand there): a step ends at a corner where there is a pause."""
        there = self.at_m + self.ahead * length_m
        for corner, pause_s in zip(self.corners_m, self.person.pauses_s, strict=False):
            ahead_m = ((corner - self.at_m) * self.ahead) % self.way_m
            if pause_s > 0.0 and 0.0 < ahead_m <= length_m:
                return float(corner), pause_s
        return there % self.way_m, 0.0

    def make_way(self, robot: np.ndarray) -> None:
        """Go on, or back, as far as it takes to be out of the robot's way."""
        if self.gap_m(self.at_m, robot) >= self.person.keep_m:
            return
        for away_m in np.arange(STEP_M, 0.5 * self.way_m + STEP_M, STEP_M):
            for there in (self.at_m + self.ahead * away_m, self.at_m - self.ahead * away_m):
                if self.gap_m(there, robot) >= self.person.keep_m:
                    self.at_m = there % self.way_m
                    return


@dataclass(frozen=True)
class Stand:
    """Where a shape is: x, y, height of its underside, yaw."""

    x_m: float
    y_m: float
    bottom_m: float
    yaw_rad: float


class Live:
    """What moves in a world, now. shapes: of all that ever does; `stands` says where each of them is."""

    def __init__(self, moving: Moving, robot: np.ndarray, *, patrol: bool) -> None:
        """robot: x, y, radius. patrol: whether this is the patrol or the survey, which has a clock of its own."""
        self.moving, self.patrol, self.now_s = moving, patrol, 0.0
        self.walks = [Walk(person) for person in moving.people]
        self.where: list[Box | None] = [timed.at(0.0) for timed in moving.timed]
        self.shapes = shapes_of(moving)
        self.makes_way(robot)

    def makes_way(self, robot: np.ndarray) -> None:
        """People step out of the way of a robot that cannot wait for them."""
        for walk in self.walks:
            walk.make_way(robot)

    def step(self, seconds: float, robot: np.ndarray) -> None:
        """Let so much time pass while the robot (x, y, radius) stands there."""
        count = max(1, int(np.ceil(seconds / STEP_S - 1e-9)))
        for _ in range(count):
            self.now_s += seconds / count
            for walk in self.walks:
                walk.step(seconds / count, robot)
        if self.patrol:
            pairs = zip(self.moving.timed, self.where, strict=True)
            self.where = [_put(timed, was, self.now_s, robot) for timed, was in pairs]

    @property
    def brightness(self) -> float:
        """Factor on all colours now."""
        return self.moving.brightness(self.now_s if self.patrol else 0.0)

    def stands(self) -> list[Stand]:
        """Where each of the shapes is, those that are nowhere far below the floor."""
        out = []
        for walk in self.walks:
            x, y, yaw = walk.place(walk.at_m)
            there = self.patrol or walk.person.survey
            out.append(Stand(float(x), float(y), 0.0 if there else NOWHERE_M, float(yaw)))
        for box in self.where:
            out.append(Stand(0.0, 0.0, NOWHERE_M, 0.0) if box is None else Stand(*box.centre_m, box.bottom_m, box.yaw_rad))
        return out


def shapes_of(moving: Moving) -> tuple[Shape, ...]:
    """People and boxes in the order of `Live.stands`; the boxes stand on the floor in the origin."""
    boxes = (replace(timed.box, centre_m=(0.0, 0.0), yaw_rad=0.0, bottom_m=0.0) for timed in moving.timed)
    return (*moving.people, *boxes)


def _put(timed: Timed, was: Box | None, now_s: float, robot: np.ndarray) -> Box | None:
    """Where the thing is from now on: where it should be, if the robot leaves room for it there."""
    wanted = timed.at(now_s)
    if wanted is None or wanted == was:
        return wanted
    c, s = math.cos(wanted.yaw_rad), math.sin(wanted.yaw_rad)
    local = np.array([[c, s], [-s, c]]) @ (robot[:2] - np.array(wanted.centre_m))
    gap_m = float(np.hypot(*np.maximum(np.abs(local) - 0.5 * np.array(wanted.size_m[:2]), 0.0))) - robot[2]
    return wanted if gap_m > CLEAR_M else was
