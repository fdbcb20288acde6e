"""What the walls of one eye say about free space, and what they must not say."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import se2
from rhs.api.records import Wall
from rhs_odometry.corridor.scan import Drawn, believed_scan, mouths_of
from rhs_odometry.corridor.state import Plane
from rhs_odometry.corridor.wall_map import walls_of
from rhs_odometry.corridor.walls import record_hits, with_hits

AHEAD = np.zeros(1)


def segment(x0: float, y0: float, x1: float, y1: float) -> Wall:
    return Wall(np.array([x0, y0]), np.array([x1, y1]))


def wall(axis: int, offset: float, stretches: list[tuple[float, float]], per_m: int = 12, sides=(50, 50)) -> Plane:
    along = np.concatenate([np.linspace(low, high, int(per_m * (high - low))) for low, high in stretches])
    return with_hits(Plane(axis, offset, 0.0, 0.0, along.min(), along.max(), sides=sides), along)


def test_a_beam_that_meets_the_back_of_a_wall_says_nothing():
    """A wall across at x = 3, drawn northwards, seen from the left of that way (from x < 3) only."""
    drawn = [Drawn(segment(3.0, -1.0, 3.0, 1.0), left=True, right=False)]
    assert believed_scan(drawn, (), se2(0.0, 0.0, 0.0), AHEAD, 8.0).ranges_m == pytest.approx([3.0])
    assert np.isnan(believed_scan(drawn, (), se2(6.0, 0.0, np.pi), AHEAD, 8.0).ranges_m).all()


def test_a_wall_further_than_points_have_depth_does_not_make_the_way_there_free():
    near, far = [Drawn(segment(x, -1.0, x, 1.0)) for x in (11.0, 13.0)]
    assert np.isposinf(believed_scan([near], (), se2(0.0, 0.0, 0.0), AHEAD, 8.0).ranges_m).all()
    assert np.isnan(believed_scan([far], (), se2(0.0, 0.0, 0.0), AHEAD, 8.0).ranges_m).all()


def test_a_corridor_is_free_to_where_its_walls_are_drawn():
    """Walls 2 m apart from x = 0 to 8: from 2 m the mouth is out of reach and the way free, from 6 m it is in reach and
    nobody knows what is behind it; from beside the corridor it means nothing."""
    drawn = [Drawn(segment(0.0, -1.0, 8.0, -1.0)), Drawn(segment(0.0, 1.0, 8.0, 1.0))]
    mouths = mouths_of(drawn)
    assert np.isposinf(believed_scan(drawn, mouths, se2(2.0, 0.0, 0.0), AHEAD, 4.0).ranges_m).all()
    assert np.isnan(believed_scan(drawn, mouths, se2(6.0, 0.0, 0.0), AHEAD, 4.0).ranges_m).all()
    assert np.isnan(believed_scan(drawn, mouths, se2(14.0, 0.0, np.pi), AHEAD, 4.0).ranges_m).all()


def test_of_two_walls_one_behind_the_other_only_the_seen_one_stands():
    """A lobby: the corridor's wall was seen before and behind it, the lobby's wall, 1.5 m further out, along it."""
    path = np.column_stack([np.arange(0.0, 20.0, 0.1), np.zeros(200)])
    corridor, lobby = wall(1, 1.0, [(1.0, 7.0), (13.0, 19.0)]), wall(1, 2.5, [(7.0, 13.0)])
    drawn = [d.wall for d in walls_of([corridor, lobby], path)]
    ends = sorted((w.start_xy_m[1], w.start_xy_m[0], w.end_xy_m[0]) for w in drawn)
    assert [e[0] for e in ends] == pytest.approx([1.0, 1.0, 2.5])
    assert ends[0][2] == pytest.approx(7.0, abs=0.6) and ends[1][1] == pytest.approx(13.0, abs=0.6)
    assert ends[2][1:] == pytest.approx((7.0, 13.0), abs=0.6)


def test_the_two_faces_of_a_block_do_not_hide_each_other():
    """A block 4 m thick driven round: its near face was seen at one end only, its far face, from beyond, at the other."""
    way = np.arange(0.0, 8.0, 0.1)
    path = np.vstack([np.column_stack([way, np.full(80, -1.0)]), np.column_stack([way[::-1], np.full(80, 5.0)])])
    near, far = wall(1, 0.0, [(4.0, 6.0)], sides=(24, 0)), wall(1, 4.0, [(1.5, 3.5)], sides=(0, 24))
    spans = {w.start_xy_m[1]: (w.start_xy_m[0], w.end_xy_m[0]) for w in (d.wall for d in walls_of([near, far], path))}
    assert spans[0.0][0] < 2.0 and spans[4.0][1] > 5.5  # both go on along the path beside them


def test_a_wall_remembers_from_which_side_it_was_seen():
    plane = Plane(1, 1.0, 0.0, 0.0, 0.0, 0.0)
    points = np.column_stack([np.linspace(0, 5, 60), np.ones(60), np.ones(60)])
    cameras = np.tile([2.0, 0.0, 1.2], (60, 1))
    seen = record_hits([plane], np.zeros(60, int), points, cameras)[0]
    assert seen.sides == (60, 0) and seen.hits == 60
    one = walls_of([seen], np.column_stack([np.linspace(0, 5, 50), np.zeros(50)]))[0]
    assert (one.left, one.right) == (False, True)  # the path, at lower y, is on the right of the way eastwards
