"""The robot does not drive into what it has seen, nor where nobody has looked; what it touches it leaves alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flatland import BEARINGS, Flatland, Oracle, Through, parts, ring

from rhs.api.geometry import camera_from_fov, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Event, Motion, Observation, PlanReason, Scan, Tracking, Twist
from rhs.estimation.survey import known_free
from rhs.patrol.control import Pace
from rhs.patrol.guard import MOST_HELD, Guard, GuardSettings
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionSettings
from rhs.patrol.obstacles import ObstacleWatch
from rhs.patrol.planning import RoomyPlanner
from rhs.patrol.sentinel import Sentinel

CAMERA = camera_from_fov(32, 24, 57.0, height_m=1.0)
STILL = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)
AHEAD = Twist(0.5, 0.0, 0.5)
CORNERS = (("a", 4.0, 1.0), ("b", 7.0, 4.0), ("home", 1.0, 1.0))


def seen(index, ranges_m, **more):
    scan = Scan(BEARINGS, np.broadcast_to(ranges_m, 41).astype(float), 6.0)
    return Observation(index, 0.5 * index, CAMERA, scan=scan, **more)


def guard(settings=None):
    return Guard(0.3, Pace(step_m=0.25, turn_step_rad=np.radians(12.0)), settings or GuardSettings())


def wall_at(x_m):
    return x_m / np.cos(BEARINGS)


def test_the_way_ends_where_the_robots_side_would_be_too_near_a_thing():
    """A wall 1 m ahead, a robot of 0.3 m that keeps 0.05 m: 0.65 m of way, on any arc less than that to the side."""
    watched = guard()
    watched.observe(seen(1, wall_at(1.0)), STILL)
    assert watched.around.free_way_m(AHEAD, 0.05, 2.0) == pytest.approx(0.65, abs=0.06)
    assert watched.around.free_way_m(Twist(-0.5, 0.0, 0.5), 0.05, 0.5) == 0.5, "going away from a wall is free"


def test_a_command_is_cut_to_the_way_and_slower_before_a_thing():
    watched = guard()
    watched.observe(seen(1, wall_at(0.52)), STILL)
    watched.around.seen_s[:] = 0.5  # the robot has looked everywhere
    allowed, why = watched.allow(AHEAD)
    assert why is None and 0.08 <= allowed.forward_mps * allowed.duration_s <= 0.2 and allowed.forward_mps < 0.5
    watched.observe(seen(2, wall_at(0.38)), STILL)
    watched.around.seen_s[:] = 1.0
    assert watched.allow(AHEAD) == (None, Event.STOPPED)


def test_ground_that_nobody_looked_at_is_looked_at_before_it_is_driven_on_and_once_is_enough():
    """The view reaches 29 degrees to each side; an arc to the left leads over ground at 50 degrees."""
    watched, way = guard(), []
    arc = Twist(0.4, 1.0, 0.5)
    motion = STILL
    for index in range(1, 12):
        watched.observe(seen(index, 5.0), motion)
        command, why = watched.allow(arc)
        way.append(why)
        if why is not Event.LOOK:
            break
        assert command.forward_mps == 0.0
        yaw = command.turn_radps * command.duration_s
        motion = Motion(se2(0.0, 0.0, yaw), 1e-6 * np.eye(6), Tracking.OK)
    assert 2 <= way.count(Event.LOOK) <= 10 and way[-1] is None and command.forward_mps > 0.0


def test_looking_that_shows_nothing_ends():
    """A robot whose turns do not come about, as of one whose odometry is lost, sees the same again and again."""
    watched, way = guard(), []
    for index in range(1, 40):
        watched.observe(seen(index, 5.0), STILL)
        command, why = watched.allow(Twist(0.4, 1.0, 0.5))
        way.append(why)
        if why is not Event.LOOK:
            break
    assert way.count(Event.LOOK) == MOST_HELD and command.forward_mps > 0.0


def test_what_was_seen_stays_known_beside_the_robot_where_the_camera_no_longer_looks():
    watched = guard()
    watched.observe(seen(1, wall_at(1.0)), STILL)
    quarter = Motion(se2(0.0, 0.0, np.radians(-90.0)), 1e-6 * np.eye(6), Tracking.OK)
    watched.observe(seen(2, 5.0), quarter)
    back_to_it = Twist(0.6, 1.0, 1.0)  # a circle of 0.6 m radius to the left, where the wall is now
    assert watched.around.free_way_m(back_to_it, 0.05, 1.5) < 1.2 < watched.around.free_way_m(AHEAD, 0.05, 1.5)


def test_what_went_away_is_cleared_by_looking_through_it_and_a_motion_nobody_knows_makes_all_worthless():
    watched = guard()
    for index in range(1, 4):
        watched.observe(seen(index, wall_at(1.0)), STILL)
    for index in range(4, 11):
        watched.observe(seen(index, wall_at(3.0)), STILL)
    assert watched.around.free_way_m(AHEAD, 0.05, 1.5) == 1.5
    watched.observe(seen(11, wall_at(1.0)), STILL)
    assert watched.around.free_way_m(AHEAD, 0.05, 1.5) < 1.0
    watched.observe(seen(12, np.nan), replace(STILL, replaced=True))  # by wheels that the scan agrees with
    assert watched.around.free_way_m(AHEAD, 0.05, 1.5) < 1.0
    watched.observe(seen(13, np.nan), replace(STILL, status=Tracking.LOST, replaced=True))
    assert watched.around.free_way_m(AHEAD, 0.05, 1.5) == 1.5


def test_what_was_seen_before_the_robot_was_carried_off_is_forgotten():
    """By a scan that cannot follow the last, or by a belief that no motion leads to; not by a lost view of the same wall."""
    lost = replace(STILL, status=Tracking.LOST)
    for after, still_known in ((wall_at(1.0), True), (wall_at(3.0), False)):
        watched = guard()
        watched.observe(seen(1, wall_at(1.0)), STILL)
        watched.observe(seen(2, after), lost)
        assert (watched.around.free_way_m(AHEAD, 0.05, 1.5) < 1.0) == still_known
    beliefs = iter([se2(1.0, 1.0, 0.0), se2(1.1, 1.0, 0.0), se2(5.0, 5.0, 2.0)])
    localiser = SimpleNamespace(update=lambda *_: Belief(next(beliefs), 1e-4 * np.eye(6)))
    grid = OccupancyGrid(np.full((80, 80), 0.02, np.float32), 0.1, (0.0, 0.0))
    sentinel = Sentinel(parts(localiser), grid, (), places=CORNERS, radius_m=0.3, settings=MissionSettings())
    known = []
    for index in range(1, 4):
        sentinel.locate(seen(index, wall_at(1.0)), STILL)
        known.append(len(sentinel.guard.around.things()) > 0)
    assert known == [True, True, False]


def test_a_low_box_under_the_camera_is_remembered_until_its_floor_is_seen():
    watched = guard()
    low = Scan(BEARINGS, wall_at(1.0), 5.0, (0.0, 0.0), 3.0)
    watched.observe(seen(1, wall_at(4.0), obstacle=low), STILL)
    over = Scan(BEARINGS, wall_at(4.0), 5.0, (0.0, 0.0), 3.0)  # nearer than 3 m the camera looks over it
    for index in range(2, 20):
        watched.observe(seen(index, wall_at(4.0), obstacle=over), STILL)
    assert watched.around.free_way_m(AHEAD, 0.05, 1.5) == pytest.approx(0.65, abs=0.06)


def test_a_trail_too_near_to_be_seen_cleared_is_forgotten_while_something_moves():
    watched = guard()
    low = Scan(BEARINGS, wall_at(1.0), 5.0, (0.0, 0.0), 3.0)
    over = Scan(BEARINGS, wall_at(4.0), 5.0, (0.0, 0.0), 3.0)
    watched.observe(seen(1, wall_at(4.0), obstacle=low), STILL)
    seconds = round(GuardSettings().look_s)
    for index in range(2, 2 * seconds + 4):  # two views a second
        watched.observe(seen(index, wall_at(4.0), obstacle=over), STILL)
        watched.around.moved_s = watched.around.now_s
        blocked = watched.around.free_way_m(AHEAD, 0.05, 1.5) < 1.0
        assert blocked == (0.5 * (index - 1) <= seconds)


def test_a_robot_beside_a_door_post_turns_until_it_has_room_and_goes_on():
    """A post 0.38 m ahead to the right, of a robot of 0.3 m: straight on it would come nearer than 0.05 m."""
    watched = guard()
    watched.observe(seen(1, np.where(BEARINGS < -0.4, 0.42, 5.0)), STILL)
    watched.around.seen_s[:] = 0.5  # the robot has looked everywhere
    assert watched.allow(AHEAD)[0] is None
    *turns, step = watched.way_out(0.0)
    assert turns and all(one.forward_mps == 0.0 and one.turn_radps > 0.0 for one in turns) and step.turn_radps == 0.0
    turned = sum(one.turn_radps * one.duration_s for one in turns)
    watched.observe(seen(2, np.nan), Motion(se2(0.0, 0.0, turned), 1e-6 * np.eye(6), Tracking.OK))
    assert watched.allow(step)[0] is not None


def test_the_robot_goes_back_no_further_than_the_map_and_what_it_saw_leave_room():
    watched = guard()
    watched.observe(seen(1, wall_at(1.0)), STILL)
    watched.given = AHEAD
    back = watched.back_off()
    assert back.forward_mps * back.duration_s == pytest.approx(-0.2)
    behind = np.stack([np.full(21, -0.45), np.linspace(-0.5, 0.5, 21)], axis=1)  # 0.15 m behind a robot of 0.3 m
    back = watched.back_off(behind)
    assert back.forward_mps * back.duration_s == pytest.approx(-0.1, abs=0.03)


def test_things_not_looked_at_lately_can_be_left_out():
    watched = guard()
    low = Scan(BEARINGS, wall_at(1.0), 5.0, (0.0, 0.0), 3.0)
    watched.observe(seen(1, wall_at(1.5), obstacle=low), STILL)
    for index in range(2, 8):
        watched.observe(seen(index, wall_at(1.5)), STILL)
    x = watched.around.things()[:, 0]
    assert (x < 1.2).any() and (x > 1.3).any()
    lately = watched.around.things(2.0)[:, 0]
    assert (lately > 1.3).all() and len(lately), "the wall is still looked at, what stands low before it no more"


def test_a_speck_of_one_view_is_no_thing_and_a_pole_seen_twice_is():
    watched = guard()
    ranges = np.full(41, np.inf)
    ranges[20] = 1.0
    watched.observe(seen(1, ranges), STILL)
    assert watched.around.free_way_m(AHEAD, 0.05, 1.5) == 1.5
    watched.observe(seen(2, ranges), STILL)
    assert watched.around.free_way_m(AHEAD, 0.05, 1.5) == pytest.approx(0.65, abs=0.06)


def test_specks_are_forgotten_on_demand_and_things_with_company_are_not():
    watched = guard()
    ranges = np.full(41, np.inf)
    ranges[20], ranges[:5] = 1.0, 1.5
    for index in (1, 2, 3):
        watched.observe(seen(index, ranges), STILL)
    before = len(watched.around.things())
    watched.around.forget_specks()
    left = watched.around.things()
    assert len(left) == before - 1 and (np.abs(left[:, 1]) > 0.1).all()


def test_going_back_twice_leads_twice_as_far_and_not_forth_again():
    watched = guard()
    watched.observe(seen(1, 5.0), STILL)
    watched.given = AHEAD
    for _ in range(2):
        watched.given = watched.back_off()
        assert watched.given.forward_mps * watched.given.duration_s == pytest.approx(-0.2)
    watched.observe(seen(2, 5.0, contact=True), STILL)
    assert watched.touched and watched.back_off().forward_mps > 0.0, "what was touched behind is left ahead"


def test_commands_that_do_not_move_the_robot_are_a_touch_without_any_bumper():
    watched = guard()
    for index in range(1, 4):
        watched.given = AHEAD
        watched.observe(seen(index, 5.0), STILL)
        assert watched.touched == (index == 3)


class Glass(Flatland):
    """A thing that no scan sees stands in the corridor; the robot has a bumper."""

    def __init__(self, *args, glass, **kwargs):
        super().__init__(*args, **kwargs)
        self.glass = glass

    def drive(self, command):
        scanned, self.occupied = self.occupied, self.occupied | self.glass
        before, self.hit = self.hit, False
        capture = super().drive(command)
        touched, self.hit = self.hit, self.hit or before
        self.occupied = scanned
        return replace(capture, contact=touched, scan=self._scan())


def patrol(world, settings=None, localiser=None, grid=None):
    oracle = Oracle(world)
    given = parts(localiser or oracle)
    given.planner.corners = False
    sentinel = Sentinel(given, grid or world.grid(), (), places=world.facts.places, radius_m=world.radius,
                        settings=settings or MissionSettings())
    return sentinel, list(steps(world, Through(world.camera), oracle, sentinel))


def test_after_a_touch_the_robot_backs_off_marks_what_it_did_not_see_and_goes_round_it():
    glass = np.zeros((80, 80), bool)
    glass[9:12, 25:28] = True  # 0.3 m of glass in the middle of a corridor 2 m wide
    sentinel, out = patrol(Glass(ring(), (1.0, 1.0, 0.0), CORNERS, glass=glass))
    assert [m.status for m in sentinel.book.missions if m.status != "aborted"] == ["arrived"] * 3
    touches = [k for k, step in enumerate(out) if "contact" in step.events]
    assert 1 <= len(touches) <= 3
    for k in touches:
        assert out[k + 1].command.forward_mps < 0.0, "backs off at once"
        assert 0.1 < np.linalg.norm(out[k + 1].truth[:2, 3] - out[k].truth[:2, 3]) <= 0.21


def test_a_box_behind_a_corner_is_not_touched():
    hidden = np.zeros((80, 80), bool)
    hidden[26:30, 66:70] = True  # 0.6 m behind the corner, 0.9 m free beside it
    for start in ((1.0, 1.0, 0.0), (2.0, 1.0, 3.0)):
        sentinel, out = patrol(Flatland(ring(), start, CORNERS, hidden=hidden))
        assert [m.status for m in sentinel.book.missions if m.status != "aborted"] == ["arrived"] * 3
        assert not any(step.collided for step in out)
        assert min(step.clearance_m for step in out) > 0.02


def test_a_robot_caged_by_glass_gives_up_within_a_bound():
    glass = np.zeros((80, 80), bool)
    glass[1:20, 18] = glass[18, 1:20] = True
    sentinel, out = patrol(Glass(ring(), (1.0, 1.0, 0.0), (("a", 4.0, 1.0),), glass=glass))
    assert sentinel.book.missions[-1].status == "gave_up" and "touch" in sentinel.book.missions[-1].reason
    assert len(out) < 120 and sum(step.collided for step in out) <= 8


class NeverSure:
    def update(self, observation, motion):
        return Belief(np.eye(4), np.eye(6), BeliefStatus.LOST, 0.0)


def test_a_lost_patrol_ends_within_its_bound_whatever_the_number_of_places():
    settings = MissionSettings(lost_views=30, lost_views_total=50)
    sentinel, out = patrol(Flatland(ring(), (1.0, 1.0, 0.0), CORNERS * 5), settings, NeverSure())
    missions = sentinel.book.missions
    assert len(out) < 50 + 2 * 15 and {m.status for m in missions} == {"gave_up"}
    assert missions[0].reason.endswith("in 30 views") and missions[1].reason.endswith("in 50 views of the patrol")
    assert all(m.start_m is None for m in missions), "nobody knows where they began"
    assert not any(step.collided for step in out)


def test_a_place_nobody_has_seen_is_never_seen_and_one_inside_a_wall_is_blocked():
    probability = np.full((40, 80), 0.05, np.float32)
    probability[:, 50:] = np.nan
    probability[20:, 30] = 0.95
    grid = OccupancyGrid(probability, 0.1, (0.0, 0.0))
    from flatland import Dijkstra

    roads = RoomyPlanner(Dijkstra(), grid, grid.free(), radius_m=0.3, settings=MissionSettings(), who="planner=dijkstra")
    nothing = {"obstacles": np.zeros(grid.shape, bool), "things_m": np.zeros((0, 2))}
    start = np.array([1.0, 1.0])
    assert roads.plan(start, np.array([7.0, 1.0]), **nothing).reason is PlanReason.NEVER_SEEN
    assert roads.plan(start, np.array([3.05, 3.0]), **nothing).reason is PlanReason.GOAL_BLOCKED
    box = nothing["obstacles"].copy()
    box[10, 40] = True
    assert roads.plan(start, np.array([4.0, 1.0]), **{**nothing, "obstacles": box}).reason is PlanReason.GOAL_BLOCKED
    assert roads.plan(start, np.array([4.0, 1.0]), **nothing).found


def test_the_way_of_the_survey_through_ground_that_no_view_showed_can_be_driven_again_but_for_what_stands_beside_it():
    """In the middle of a hall a camera of 5 m sees no floor to its sides: `start_blocked`, in the depot of Nav2."""
    from flatland import Dijkstra

    probability = np.full((40, 80), np.nan, np.float32)
    grid = OccupancyGrid(probability, 0.1, (0.0, 0.0))
    on_the_way = [SimpleNamespace(map_from_body=se2(1.0 + 0.25 * k, 2.0, 0.0)) for k in range(25)]
    nothing = {"obstacles": np.zeros(grid.shape, bool), "things_m": np.zeros((0, 2))}

    def found():
        free = known_free(grid, on_the_way, 0.3, MissionSettings().margin_m)
        roads = RoomyPlanner(Dijkstra(), grid, free, radius_m=0.3, settings=MissionSettings(), who="planner=dijkstra")
        return roads.plan(np.array([1.0, 2.0]), np.array([7.0, 2.0]), **nothing).found

    assert found()
    probability[23:25, 40] = 0.95  # 0.3 m from the way: less than radius and margin
    assert not found()


def test_what_walked_by_leaves_no_wall_behind():
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()
    watch = ObstacleWatch(grid, grid.free(), tolerance_m=0.3)
    here, person, gone = se2(1.0, 1.0, 0.0), Scan(BEARINGS, wall_at(1.5), 6.0), Scan(BEARINGS, np.full(41, 4.5), 6.0)
    person.ranges_m[np.abs(BEARINGS) > 0.1] = 4.5
    for _ in range(10):
        watch.look(here, person)
    assert watch.cells.any()
    for _ in range(10):
        watch.look(here, gone)
    assert not watch.cells.any()


def test_what_stood_for_a_while_is_remembered_for_as_long_and_what_was_seen_in_passing_is_not():
    """Something 1.5 m ahead was seen at 10 s and again at 40 s, or from 38 to 40 s only; then nobody looks."""
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()
    ranges_m = np.where(np.abs(BEARINGS) > 0.1, 4.5, wall_at(1.5))

    def left(seen_s, now_s):
        watch = ObstacleWatch(grid, grid.free(), tolerance_m=0.3)
        for at_s in seen_s:
            watch.look(se2(1.0, 1.0, 0.0), Scan(BEARINGS, ranges_m, 6.0), now_s=at_s)
        assert watch.cells.any()
        return not watch.forget_gone(now_s, np.zeros(2), 0.0) and bool(watch.cells.any())

    assert left((10.0, 11.0, 40.0), 65.0) and not left((38.0, 39.0, 40.0), 65.0)
    assert left((38.0, 39.0, 40.0), 43.0) and not left((10.0, 11.0, 40.0), 75.0)


def test_among_people_the_robot_does_not_go_back_where_it_has_not_just_been_unless_it_touched_something():
    watched = guard()
    watched.observe(seen(1, wall_at(2.0)), STILL)
    assert watched.back_off() is not None
    watched.around.moved_s = 0.5
    assert watched.back_off() is None
    watched.touched = True
    assert watched.back_off().forward_mps < 0.0


def test_in_a_gap_one_view_of_somebody_who_comes_is_enough_to_stop():
    """A way hardly wider than the robot asks for two votes of what stands still, and for one where something moves."""
    watched = guard()
    watched.observe(seen(1, wall_at(0.5)), STILL)
    watched.around.seen_s[:] = 0.5  # the robot has looked everywhere
    watched.tight = True
    allowed, _ = watched.allow(AHEAD)
    assert allowed.forward_mps * allowed.duration_s == pytest.approx(0.25)
    watched.around.moved_s = 0.5
    allowed, _ = watched.allow(AHEAD)
    assert allowed is None or allowed.forward_mps * allowed.duration_s < 0.2


def test_a_box_beside_a_wall_is_told_from_the_wall_from_near():
    """The wall of the map is at y = 2; something stands 0.25 m before it."""
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()
    watch = ObstacleWatch(grid, grid.free(), tolerance_m=0.3)
    points = np.array([[4.0, 1.74], [4.0, 1.95]])
    assert watch.unknown(points, 0.17).tolist() == [True, False]
