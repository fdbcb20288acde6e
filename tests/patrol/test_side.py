"""The robot's side keeps its margin from what was seen, and from ground where something may stand."""

import numpy as np
import pytest
from test_guard import AHEAD, STILL, guard, seen

from rhs.api.geometry import se2
from rhs.api.records import Motion, Scan, Tracking, Twist
from rhs.api.robot_shape import Footprint
from rhs.patrol.control import Pace
from rhs.patrol.guard import Guard, GuardSettings

OBLONG = Footprint(((0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)))


def marked(watched, *points_m):
    """Something stands at these points, each alone in its cell."""
    rows, columns = watched.around._cells_at(np.array(points_m)).T
    watched.around.at_eye.votes[rows, columns] = 5.0
    watched.around.seen_s[:] = watched.around.now_s


def test_many_small_turns_bring_the_corners_of_a_robot_no_nearer_than_one():
    """A post beside a robot of 0.6 m by 0.4 m, 1.7 cm from where its corner would pass: each turn is cut to the room there
    is, and what was seen is exact to a centimetre."""
    watched = Guard(OBLONG.radius_m, Pace(turn_step_rad=np.radians(12.0)), GuardSettings(), OBLONG)
    watched.observe(seen(1, 5.0), STILL)
    marked(watched, (0.125, 0.275))
    post_m, turned_rad = watched.around.things(), 0.0
    assert len(post_m) == 1
    for index in range(2, 40):
        command = watched.turn_in_room(Twist(0.0, -1.0, 0.2))
        turned_rad += command.turn_radps * command.duration_s
        motion = Motion(se2(0.0, 0.0, command.turn_radps * command.duration_s), 1e-6 * np.eye(6), Tracking.OK)
        watched.observe(seen(index, 5.0), motion)
        watched.around.seen_s[:] = watched.around.now_s
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    assert turned_rad < -0.05 and OBLONG.gaps_m(post_m @ np.array([[c, -s], [s, c]]))[0] > 0.015


def test_where_something_moves_what_may_stand_anywhere_in_a_cell_is_kept_from_by_its_corners():
    """Cells beside the way, their middles 6 cm from the robot's side and their corners 2.5 cm: nearer than 5 cm."""
    watched = guard()
    watched.observe(seen(1, 5.0), STILL)
    beside = np.array([[0.5, 0.36], [0.55, 0.36]])
    assert watched.around.free_way_m(AHEAD, 0.05, 1.0, walls_m=beside) == 1.0
    assert watched.around.free_way_m(AHEAD, 0.05, 1.0, hidden_m=beside) == 1.0
    watched.around.moved_s = watched.around.now_s
    assert watched.around.free_way_m(AHEAD, 0.05, 1.0, hidden_m=beside) < 0.5


def test_ground_within_the_margin_of_the_way_is_looked_at_too():
    """All was seen but a strip 0.28 to 0.36 m to the left of a robot of 0.3 m radius that keeps 5 cm: the side of a box may
    lie there. Where the strip begins 0.4 m away, the robot drives."""
    for strip_m, looks in (((0.28, 0.36), True), ((0.4, 0.5), False)):
        watched = guard()
        watched.observe(seen(1, 5.0), STILL)
        watched.around.seen_s[:] = watched.around.now_s
        x, y = (grid.ravel() for grid in np.meshgrid(np.arange(0.25, 0.9, 0.025), np.arange(*strip_m, 0.025)))
        rows, columns = watched.around._cells_at(np.stack([x, y], axis=1)).T
        watched.around.seen_s[rows, columns] = -np.inf
        command, _ = watched.allow(AHEAD)
        assert (command.forward_mps == 0.0) == looks


@pytest.mark.parametrize(("away_m", "looks"), [(0.1, False), (0.3, True)])
def test_where_something_moves_nobody_walks_up_between_the_robot_and_what_it_saw_beside_it(away_m, looks):
    """Ground ahead that was seen 5 s ago, so far from the robot's side, all else just now."""
    watched = guard()
    watched.observe(seen(1, 5.0), STILL)
    watched.around.now_s = watched.around.moved_s = watched._here_s = 10.0
    watched.around.seen_s[:] = 10.0
    x, y = watched.around._patches.T
    there = np.abs(np.hypot(x, y) - 0.3 - away_m) < 0.05
    rows, columns = watched.around._cells_at(watched.around._patches[there]).T
    watched.around.seen_s[rows, columns] = 5.0
    watched._to_see = watched.around.unseen(AHEAD, margin_m=0.05, up_to_m=0.4, since_s=8.5)
    assert (len(watched._to_see) > 0) == looks


def test_where_something_moves_the_robot_does_not_turn_to_a_floor_that_it_is_too_near_to_see():
    """It stands where the camera looks over the floor 3 m ahead: a look shows no more of it."""
    watched = guard()
    low = Scan(np.linspace(-0.5, 0.5, 41), np.full(41, 5.0), 6.0, blind_m=3.0)
    watched.observe(seen(1, 5.0, obstacle=low), STILL)
    watched.around.moved_s = watched.around.now_s
    watched.around.seen_s[:] = watched.around.now_s
    assert watched.allow(AHEAD)[1] is None
