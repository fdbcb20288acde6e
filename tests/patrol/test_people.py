"""Among people: a look round ends, what bars a way is waited for, and what only came by does not count as what stays."""

import numpy as np
from flatland import BEARINGS, Flatland, ring
from test_guard import STILL, guard, seen, wall_at
from test_policies import PLACES, barrier, patrol, told

from rhs.api.geometry import se2
from rhs.api.records import Event, Motion, Scan, Tracking, Twist
from rhs.patrol.obstacles import ObstacleWatch
from rhs_replan import NewMission

HERE = se2(1.0, 1.0, 0.0)
PERSON = Scan(BEARINGS, np.where(np.abs(BEARINGS) > 0.1, 4.5, wall_at(1.5)), 6.0)
NOBODY = Scan(BEARINGS, np.full(41, 4.5), 6.0)


def test_a_robot_that_looked_to_one_side_does_not_look_again_when_it_has_turned_back():
    """Where something moves, ground counts as looked at for 1.5 s; the look and the turn back take longer than that."""
    watched, arc = guard(), Twist(0.4, 1.0, 0.5)
    index, motion, turned_rad, events = 0, STILL, 0.0, []

    def asked(command):
        nonlocal index, motion, turned_rad
        index += 1
        watched.observe(seen(index, 5.0), motion)
        watched.around.moved_s = watched.around.now_s
        watched.given, why = watched.allow(command)
        turn_rad = watched.given.turn_radps * watched.given.duration_s
        motion, turned_rad = Motion(se2(0.0, 0.0, turn_rad), 1e-6 * np.eye(6), Tracking.OK), turned_rad + turn_rad
        events.append(why)
        return watched.given

    while asked(arc).forward_mps == 0.0:
        assert events[-1] is Event.LOOK and index < 12
        looked_rad = turned_rad
    assert index >= 3
    watched, index, motion, turned_rad, events = guard(), 0, STILL, 0.0, []
    while turned_rad < looked_rad - 0.01:
        asked(arc)
    while turned_rad > 0.01:
        asked(Twist(0.0, -min(0.5, 5.0 * turned_rad), 0.2))
    assert 0.5 * index > 1.5 and asked(arc).forward_mps > 0.0


def test_what_bars_every_way_is_waited_for_though_nobody_saw_it_come():
    """Both ways to a are closed for good, near the start: it is waited for until both have stood for ten seconds."""
    hidden = barrier()
    hidden[25:28, 1:20] = True
    missions, events = patrol(NewMission(), hidden=hidden, places=PLACES[:1])
    assert told(missions)[-1] == ("a", "gave_up") and events.count("wait") >= 10


def test_where_others_come_and_go_nothing_has_stood_all_the_time():
    """Somebody is seen for two seconds in every three, with nobody between."""
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()
    for moves, stood_s in ((True, 1.5), (False, 19.5)):
        watch = ObstacleWatch(grid, grid.free(), tolerance_m=0.3)
        for at_s in np.arange(0.0, 20.0, 0.5):
            watch.look(HERE, PERSON if at_s % 3.0 < 2.0 else NOBODY, now_s=at_s, moves=moves)
        assert watch.stood_s.max() == stood_s


def test_a_trail_near_the_robot_is_forgotten_and_a_low_thing_that_stood_is_not():
    """Nearer than the camera sees the floor nobody would see it go: seen for one second, or for three, then not again; where
    somebody was seen to walk it may be a pet that waited."""
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()

    def left(views, now_s, walked=False):
        watch = ObstacleWatch(grid, grid.free(), tolerance_m=0.3)
        for at_s in 0.5 * np.arange(views):
            watch.look(HERE, NOBODY, Scan(BEARINGS, PERSON.ranges_m, 6.0), now_s=at_s)
        low = np.array([2.55, 1.05])
        assert watch.cells.any() and watch.low(low)
        trail_m = grid.centres(np.argwhere(watch.cells)) if walked else np.zeros((0, 2))
        watch.forget_gone(now_s, np.array([1.0, 1.0]), 3.0, trail_m)
        return bool(watch.cells.any())

    assert left(3, 10.0) and not left(3, 20.0)
    assert left(7, 20.0) and left(7, 60.0)
    assert left(7, 10.0, walked=True) and not left(7, 20.0, walked=True)


def test_what_is_as_high_as_the_camera_is_not_low():
    grid = Flatland(ring(), (1.0, 1.0, 0.0), ()).grid()
    watch = ObstacleWatch(grid, grid.free(), tolerance_m=0.3)
    for _ in range(3):
        watch.look(HERE, PERSON)
    stands = grid.centres(np.argwhere(watch.cells))
    assert len(stands) and not any(watch.low(point) for point in stands)
