"""The loop and the sentinel without pictures: what a patrol does when the world is kind, blocked or broken."""

from dataclasses import replace

import numpy as np
import pytest
from flatland import Dijkstra, Flatland, Oracle, Through, parts, ring

from rhs.api.contracts import KINDS
from rhs.api.errors import ContractError
from rhs.api.geometry import se2
from rhs.api.records import Belief, BeliefStatus, Event, Motion, Tracking
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionSettings
from rhs.patrol.sentinel import Sentinel

PLACES = (("a", 4.0, 1.0), ("b", 7.0, 4.0), ("c", 4.0, 7.0), ("home", 1.0, 1.0))


def patrol(world: Flatland, *, localiser=None, settings=None, limit=2000):
    grid = world.grid()
    oracle = Oracle(world)
    given = parts(localiser or oracle)
    given.planner.corners = False
    sentinel = Sentinel(given, grid, (), places=world.facts.places, radius_m=world.radius,
                        settings=settings or MissionSettings())
    out = []
    for step in steps(world, Through(world.camera), oracle, sentinel):
        out.append(step)
        assert len(out) < limit, "the patrol does not end"
    return sentinel, out


def test_all_places_are_visited_in_order_without_a_touch():
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES)
    sentinel, out = patrol(world)
    assert [m.status for m in sentinel.book.missions] == ["arrived"] * 4
    assert [m.place for m in sentinel.book.missions] == ["a", "b", "c", "home"]
    assert not any(step.collided for step in out)
    arrivals = [step for step in out if "arrived" in step.event]
    for step, (_, x, y) in zip(arrivals, PLACES, strict=True):
        assert np.linalg.norm(step.truth[:2, 3] - (x, y)) <= 0.25


def test_an_unknown_obstacle_costs_one_mission_and_the_way_round():
    hidden = np.zeros((80, 80), bool)
    hidden[1:20, 25:28] = True
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES, hidden=hidden)
    sentinel, out = patrol(world)
    assert [m.status for m in sentinel.book.missions] == ["aborted", "arrived", "arrived", "arrived", "arrived"]
    assert sentinel.book.missions[0].place == sentinel.book.missions[1].place == "a"
    assert not any(step.collided for step in out)
    assert not sentinel.watch.cells.any(), "the next mission starts with the map as surveyed"


def test_a_place_that_cannot_be_reached_is_given_up_with_its_reason_and_the_patrol_goes_on():
    hidden = np.zeros((80, 80), bool)
    hidden[1:20, 25:28] = True
    hidden[60:79, 25:28] = True
    places = (("a", 4.0, 1.0), ("home", 1.0, 3.0))
    sentinel, out = patrol(Flatland(ring(), (1.0, 1.0, 0.0), places, hidden=hidden))
    last = {m.place: m for m in sentinel.book.missions}
    assert last["a"].status == "gave_up" and "disconnected" in last["a"].reason
    assert last["home"].status == "arrived"
    assert not any(step.collided for step in out)


def test_a_place_inside_a_wall_is_given_up_at_once():
    places = (("wall", 4.0, 4.0), ("home", 1.0, 2.0))
    sentinel, out = patrol(Flatland(ring(), (1.0, 1.0, 0.0), places))
    assert [(m.status, m.reason) for m in sentinel.book.missions] == [
        ("gave_up", "no path: goal_blocked"), ("arrived", "")]


def test_wheels_that_turn_without_moving_the_robot_end_the_mission():
    world = Flatland(ring(), (1.0, 1.0, 0.0), (("a", 4.0, 1.0),), slip=0.0)
    sentinel, out = patrol(world)
    assert sentinel.book.missions[-1].status == "gave_up"
    assert sentinel.book.missions[-1].reason == "no path: disconnected, something new stands near (1.4, 1.0) m (touches: 1)"
    assert len(out) <= 2 * MissionSettings().stuck_steps


def test_no_places_no_patrol():
    sentinel, out = patrol(Flatland(ring(), (1.0, 1.0, 0.0), ()))
    assert out == [] and sentinel.book.missions == []


def test_the_same_place_twice_is_two_missions():
    sentinel, _ = patrol(Flatland(ring(), (1.0, 1.0, 0.0), (("a", 3.0, 1.0), ("a", 3.0, 1.0))))
    assert [m.status for m in sentinel.book.missions] == ["arrived", "arrived"]


class NeverSure:
    """A localiser that never finds itself."""

    def update(self, observation, motion):
        return Belief(np.eye(4), np.eye(6), BeliefStatus.LOST, 0.0)


def test_a_robot_that_never_finds_itself_stops_and_says_so():
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES)
    sentinel, out = patrol(world, localiser=NeverSure())
    assert all(m.status == "gave_up" and "lost" in m.reason for m in sentinel.book.missions)
    assert not any(step.collided for step in out)


class Doubting(Oracle):
    """Knows its place on its map, and that the map may be bent."""

    def update(self, observation, motion):
        return replace(super().update(observation, motion), status=BeliefStatus.DEGRADED)


def test_a_robot_that_doubts_its_map_drives_by_it_all_the_same():
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES)
    sentinel, out = patrol(world, localiser=Doubting(world))
    assert [m.status for m in sentinel.book.missions] == ["arrived"] * len(PLACES)
    assert not any(Event.LOST in step.events for step in out)


class Broken:
    def __init__(self, motion):
        self.motion = motion

    def update(self, observation):
        return self.motion


@pytest.mark.parametrize("motion, message", [
    (None, "expected a Motion"),
    (Motion(np.full((4, 4), np.nan), np.eye(6), Tracking.OK), "finite 4x4"),
    (Motion(np.eye(3), np.eye(6), Tracking.OK), "finite 4x4"),
    (Motion(np.diag([1.0, 1.0, -1.0, 1.0]), np.eye(6), Tracking.OK), "determinant"),
    (Motion(np.eye(4), np.eye(3), Tracking.OK), "covariance"),
])
def test_a_bad_motion_is_stopped_at_the_boundary(motion, message):
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES)
    oracle = Oracle(world)
    grid = world.grid()
    sentinel = Sentinel(parts(oracle), grid, (), places=PLACES, radius_m=0.3, settings=MissionSettings())
    with pytest.raises(ContractError, match=message):
        list(steps(world, Through(world.camera), Broken(motion), sentinel))


def test_an_obstacle_on_the_place_itself_is_not_touched_and_the_patrol_goes_on_the_other_way():
    hidden = np.zeros((80, 80), bool)
    hidden[1:20, 38:42] = True
    sentinel, out = patrol(Flatland(ring(), (1.0, 1.0, 0.0), PLACES, hidden=hidden))
    last = {m.place: m for m in sentinel.book.missions}
    assert last["a"].status == "gave_up" and "goal_blocked" in last["a"].reason
    assert [last[name].status for name in ("b", "c", "home")] == ["arrived"] * 3
    assert not any(step.collided for step in out)


def test_an_odometry_that_wants_a_moving_camera_gets_arcs():
    """Round the ring, always onwards: with arcs the robot never turns without going forward; otherwise it pivots."""
    from types import SimpleNamespace

    from rhs.patrol.mission import turning

    moving, any_other = (SimpleNamespace(keeps_moving=wish, short_steps=None) for wish in ((0.125, 6.5), None))
    assert turning(MissionSettings(), moving).turn == "arc" and turning(MissionSettings(), any_other).turn == "pivot"
    decided = turning(MissionSettings(step_m=0.1), moving)
    assert (decided.step_m, decided.turn_step_deg) == (0.1, 6.5)
    assert turning(MissionSettings(turn="pivot"), moving).turn == "pivot"  # what a person typed holds
    assert turning(MissionSettings(turn="arc"), any_other).turn == "arc"
    on_the_spot = {}
    for odometry in (moving, any_other):
        world = Flatland(ring(), (1.0, 1.0, 0.6), PLACES)  # looks aside at first
        sentinel, out = patrol(world, settings=turning(MissionSettings(), odometry))
        assert [m.status for m in sentinel.book.missions] == ["arrived"] * 4
        assert not any(step.collided for step in out)
        told = [step.command for step in out[1:]]
        on_the_spot[odometry is moving] = sum(c.forward_mps == 0.0 and c.turn_radps != 0.0 for c in told)
    assert on_the_spot[True] == 0 < on_the_spot[False]


class Wrong(Dijkstra):
    """A planner with one mistake."""

    def __init__(self, how):
        self.how = how

    def plan(self, problem):
        path = super().plan(problem)
        if self.how == "none" or not path.found:
            return None
        points = np.array(path.points_m, float)
        if self.how == "short":
            points = points[:1] + [[0.0, 0.0], [0.1, 0.0]]
        if self.how == "hole":
            points[len(points) // 2] = np.nan
        if self.how == "straight":
            points = np.stack([problem.start_m, problem.goal_m])
        return replace(path, points_m=points, raw_m=points)


@pytest.mark.parametrize(("how", "message"), [
    ("none", "planner=mine: what it returned is of type NoneType; expected a Path"),
    ("short", "planner=mine: the path's last point is"),
    ("hole", "planner=mine: points_m is not finite"),
    ("straight", "planner=mine: the path is blocked near"),
])
def test_a_bad_path_is_stopped_at_the_boundary_and_the_planner_named(how, message):
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES)
    oracle, grid = Oracle(world), world.grid()
    who = {kind: f"{kind}=mine" for kind in KINDS}
    sentinel = Sentinel(parts(oracle, Wrong(how), who), grid, (), places=PLACES, radius_m=0.3, settings=MissionSettings())
    with pytest.raises(ContractError, match=message):
        list(steps(world, Through(world.camera), oracle, sentinel, who=who))


class Faulty(Flatland):
    """A source with one mistake."""

    def __init__(self, how):
        super().__init__(ring(), (1.0, 1.0, 0.0), PLACES)
        self.how = how

    def drive(self, command):
        capture = super().drive(command)
        if self.how == "nothing":
            return None
        return replace(capture, stamp_s=5.0 if self.how == "same" else -capture.stamp_s)


@pytest.mark.parametrize(("how", "message"), [
    ("same", "source=mine: stamp_s is 5 after 5; expected stamps that increase from view to view"),
    ("backwards", "source=mine: stamp_s is .* expected stamps that increase"),
    ("nothing", "source=mine: what it returned is of type NoneType; expected a Capture"),
])
def test_a_source_without_a_clock_or_a_view_is_named(how, message):
    world = Faulty(how)
    oracle, grid = Oracle(world), world.grid()
    who = {kind: f"{kind}=mine" for kind in KINDS}
    sentinel = Sentinel(parts(oracle, who=who), grid, (), places=PLACES, radius_m=0.3, settings=MissionSettings())
    with pytest.raises(ContractError, match=message):
        list(steps(world, Through(world.camera), oracle, sentinel, who=who))


def test_an_odometry_and_a_localiser_that_diverge_are_named_each():
    far = Motion(se2(1e7, 0.0, 0.0), np.eye(6), Tracking.OK)
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES)
    oracle, grid = Oracle(world), world.grid()

    class Gone(Oracle):
        def update(self, observation, motion):
            return replace(super().update(observation, motion), map_from_body=se2(0.0, 1e7, 0.0))

    for odometry, localiser, named in ((Broken(far), oracle, "odometry Broken: previous_from_body"),
                                       (oracle, Gone(world), "localiser Gone: map_from_body")):
        sentinel = Sentinel(parts(localiser), grid, (), places=PLACES, radius_m=0.3, settings=MissionSettings())
        with pytest.raises(ContractError, match=f"{named} is 1e[+]07 m away: diverged"):
            list(steps(world, Through(world.camera), odometry, sentinel))


def test_a_map_whose_origin_is_far_away_is_no_divergence():
    """In metres of a country (UTM) each belief was 'diverged: at most 1000 m'."""
    world = Flatland(ring(), (1.0, 1.0, 0.0), PLACES)
    oracle, grid = Oracle(world), world.grid()

    class There(Oracle):
        def update(self, observation, motion):
            return replace(super().update(observation, motion), map_from_body=se2(500_001.0, 4_600_001.0, 0.0))

    sentinel = Sentinel(parts(There(world)), grid, (), places=PLACES, radius_m=0.3, settings=MissionSettings())
    observation = Through(world.camera).sense(sentinel.first(world))
    assert sentinel.locate(observation, oracle.update(observation)).map_from_body[1, 3] == 4_600_001.0
