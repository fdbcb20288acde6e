"""How a robot that does not know where it is moves."""

import numpy as np
import pytest
from flatland import Flatland, Oracle, Through, parts, ring

from rhs.api.geometry import planar, wrap
from rhs.api.records import Belief, BeliefStatus, Scan
from rhs.patrol.control import Pace
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionSettings
from rhs.patrol.relocate import GO_ON_M, Search, open_bearing
from rhs.patrol.sentinel import Sentinel

BEARINGS = np.linspace(-0.5, 0.5, 41)
OPEN = Scan(BEARINGS, np.full(41, 5.0), 6.0)
WALL = Scan(BEARINGS, 0.7 / np.cos(BEARINGS), 6.0)


def _belief(probability):
    return Belief(np.eye(4), np.eye(6), BeliefStatus.CONVERGING, probability)


def _angle(command):
    return command.turn_radps * command.duration_s


def test_it_looks_once_round_then_goes_on_and_looks_round_again():
    search, pace = Search(0.3, Pace(turn_step_rad=np.radians(12.0), step_m=0.25)), []
    for _ in range(80):
        pace.append(search.next(_belief(0.2), OPEN))
    turned = [_angle(c) for c in pace[:30]]
    assert sum(turned) == pytest.approx(2.0 * np.pi) and all(c.forward_mps == 0.0 for c in pace[:30])
    on = [c.forward_mps * c.duration_s for c in pace[30:30 + round(GO_ON_M / 0.25)]]
    assert sum(on) == pytest.approx(GO_ON_M)
    assert pace[39].forward_mps == 0.0 or pace[38].forward_mps == 0.0


def test_what_is_recognised_is_driven_past_and_when_it_was_nothing_the_look_round_begins_anew():
    search = Search(0.3, Pace())
    for _ in range(5):
        assert search.next(_belief(0.2), OPEN).forward_mps == 0.0
    assert search.next(_belief(0.6), OPEN).forward_mps > 0.0
    after = [search.next(_belief(0.2), OPEN) for _ in range(37)]
    assert [c.forward_mps > 0.0 for c in after] == [False] * 36 + [True]


def test_before_a_wall_it_turns_on_the_same_way_round_until_there_is_room():
    """Two walls that are open to different sides in turn: a robot that always turned to the more open one would stay."""
    left = Scan(BEARINGS, np.where(BEARINGS > 0, 1.0, 0.7), 6.0)
    right = Scan(BEARINGS, np.where(BEARINGS > 0, 0.7, 1.0), 6.0)
    search = Search(0.3, Pace())
    sides = {np.sign(_angle(search.next(_belief(0.9), scan))) for scan in (left, right, left, right)}
    assert sides == {1.0}
    assert search.next(_belief(0.9), OPEN).forward_mps > 0.0


def test_what_is_recognised_in_a_corner_is_left_after_a_whole_turn():
    search = Search(0.3, Pace(turn_step_rad=np.radians(12.0), step_m=0.25))
    for _ in range(30):
        assert search.next(_belief(0.6), WALL).forward_mps == 0.0
    on = [search.next(_belief(p), OPEN) for p in (0.6, 0.2, 0.6, 0.2, 0.2, 0.2, 0.2, 0.2)]
    assert sum(c.forward_mps * c.duration_s for c in on) == pytest.approx(GO_ON_M), "no look round before it has left"
    assert search.next(_belief(0.2), OPEN).forward_mps == 0.0


def test_it_steers_to_where_there_is_room():
    corridor_to_the_left = Scan(BEARINGS, np.where(BEARINGS > 0.3, 5.0, 1.0), 6.0)
    assert 0.3 < open_bearing(corridor_to_the_left) < 0.5
    assert open_bearing(Scan(BEARINGS, np.full(41, np.nan), 6.0)) == pytest.approx(0.0)


class OneWayMemory:
    """Knows its place after 1 m driven within 50 degrees of the survey's direction there."""

    def __init__(self, world):
        self.world, self.known, self.way_m, self.last = world, False, 0.0, planar(world.truth())

    def update(self, observation, motion):
        x, y, yaw = now = planar(self.world.truth())
        along = np.arctan2(x - 4.0, 4.0 - y)  # anticlockwise round the middle (4, 4)
        seen = abs(wrap(yaw - along)) < np.radians(50.0)
        step_m, self.last = float(np.hypot(*(now - self.last)[:2])), now
        self.way_m = self.way_m + step_m if seen else 0.0
        self.known = self.known or self.way_m >= 1.0
        if self.known:
            return Belief(self.world.truth(), 1e-4 * np.eye(6))
        return Belief(np.eye(4), np.eye(6), BeliefStatus.CONVERGING, 0.6 if seen else 0.2)


def test_a_robot_that_faces_the_other_way_turns_back_is_recognised_and_visits_its_places():
    places = (("a", 4.0, 1.0), ("b", 7.0, 4.0))
    world = Flatland(ring(), (3.0, 1.0, np.pi), places)
    grid = world.grid()
    sentinel = Sentinel(parts(OneWayMemory(world)), grid, (), places=places, radius_m=0.3,
                        settings=MissionSettings())
    out = list(steps(world, Through(world.camera), Oracle(world), sentinel))
    assert [m.status for m in sentinel.book.missions] == ["arrived"] * 2
    assert not any(step.collided for step in out)
    assert sum("lost" in step.event for step in out) < 60


class KnowsInTheRoom:
    """Knows its place in the room beyond y = 3 m, and nothing in the blind alley before it."""

    def __init__(self, world):
        self.world, self.known = world, False

    def update(self, observation, motion):
        self.known = self.known or bool(planar(self.world.truth())[1] > 3.0)
        probability = 1.0 if self.known else 0.1
        status = BeliefStatus.TRACKING if self.known else BeliefStatus.LOST
        return Belief(self.world.truth() if self.known else np.eye(4), 1e-4 * np.eye(6), status, probability)


def test_a_robot_finds_its_way_out_of_an_alley_hardly_wider_than_itself():
    """0.8 m wide, the robot 0.6 and 3 cm off the middle: less than a searching robot asks for."""
    occupied = np.ones((60, 60), bool)
    occupied[30:55, 5:55] = False
    occupied[8:30, 26:34] = False
    places = (("a", 1.5, 4.5),)
    world = Flatland(occupied, (3.03, 1.3, -0.5 * np.pi), places)
    sentinel = Sentinel(parts(KnowsInTheRoom(world)), world.grid(), (), places=places, radius_m=0.3,
                        settings=MissionSettings())
    out = list(steps(world, Through(world.camera), Oracle(world), sentinel))
    assert [m.status for m in sentinel.book.missions] == ["arrived"]
    assert not any(step.collided for step in out) and len(out) < 200
