"""A robot that touches something and has no room to leave it does not go on pressing against it, lost or not."""

from dataclasses import replace

import numpy as np
import pytest
from flatland import Flatland, Oracle, Through, parts, ring

from rhs.api.records import Belief, BeliefStatus
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionSettings
from rhs.patrol.sentinel import Sentinel

PLACES = (("a", 4.0, 1.0), ("b", 7.0, 4.0))


class Cage(Flatland):
    """Glass round the robot, which no scan sees; a bumper says whether the last command ended at something."""

    def __init__(self, half_m: float, radius_m: float = 0.37) -> None:
        super().__init__(ring(), (1.0, 1.0, 0.0), PLACES)
        self.radius = radius_m
        middle, half = 10, round(half_m / self.resolution)
        self.glass = np.zeros_like(self.occupied)
        self.glass[middle - half - 1:middle + half + 1, middle - half - 1:middle + half + 1] = True
        self.glass[middle - half:middle + half, middle - half:middle + half] = False

    def drive(self, command):
        before, self.hit = self.hit, False
        walls, self.occupied = self.occupied, self.occupied | self.glass
        capture = super().drive(command)
        self.occupied, touched, self.hit = walls, self.hit, self.hit or before
        return replace(capture, contact=touched, scan=self._scan())


class Bumper(Through):
    """sees: whether it hands on the scan."""

    def __init__(self, camera, sees: bool) -> None:
        super().__init__(camera)
        self.sees = sees

    def sense(self, capture):
        return replace(super().sense(capture), contact=capture.contact, scan=capture.scan if self.sees else None)


class OneEye(Oracle):
    """Whose odometry measured the scan in its pictures."""

    def update(self, observation, motion=None):
        out = super().update(observation, motion)
        if motion is not None:
            return out
        return replace(out, scan=self.source._scan(), scan_measured=True)


class NeverSure:
    def update(self, observation, motion):
        return Belief(np.eye(4), np.eye(6), BeliefStatus.LOST, 0.6)


@pytest.mark.parametrize("half_m", [0.4])
@pytest.mark.parametrize("sees", [True, False])
@pytest.mark.parametrize("lost", [True, False])
def test_a_robot_boxed_in_presses_at_most_twice_and_gives_its_places_up(half_m: float, sees: bool, lost: bool) -> None:
    world = Cage(half_m)
    oracle = Oracle(world) if sees else OneEye(world)
    given = parts(NeverSure() if lost else oracle)
    given.planner.corners = False
    sentinel = Sentinel(given, world.grid(), (), places=PLACES, radius_m=world.radius,
                        settings=MissionSettings())
    out = list(steps(world, Bumper(world.camera, sees), oracle, sentinel))
    print(half_m, sees, lost, sum(step.collided for step in out), len(out), [(m.status, m.reason) for m in sentinel.book.missions])
    assert sum(step.collided for step in out) <= 2
