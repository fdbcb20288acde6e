"""A kidnapped robot is put down where there is room."""

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, planar, se2
from rhs.api.records import Event, Motion, Tracking, Twist, View
from rhs.base.errors import RhsError
from rhs.patrol.kidnap import DRAWS, LATEST, Kidnapper
from rhs.patrol.mission import Logbook


class Narrow:
    """A source with room below `y_m` only."""

    def __init__(self, y_m):
        self.y_m, self.asked, self.stands = y_m, 0, se2(0.0, -1.0, 0.0)

    def truth(self):
        return self.stands

    def teleport(self, world_from_body):
        self.asked += 1
        if planar(world_from_body)[1] > self.y_m:
            raise RhsError("the robot would overlap something")
        self.stands = world_from_body


def kidnapped(y_m, seed):
    motion, camera = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK), camera_from_fov(32, 24, 57.0, height_m=1.0)
    view = View(0, 0.0, camera, motion, se2(2.0, 1.0, 0.0), 1e-6 * np.eye(6), None, None)
    source, kidnapper, book = Narrow(y_m), Kidnapper(np.random.default_rng(seed), [view]), Logbook((("there", 1.0, 1.0),))
    book.open(np.zeros(2)).steps = LATEST
    kidnapper.maybe(source, book, Twist(0.5, 0.0, 0.5))
    return source, kidnapper.news()


@pytest.mark.parametrize("seed", range(10))
def test_it_is_drawn_again_until_there_is_room(seed):
    source, news = kidnapped(0.9, seed)  # a third of the draws, from 0.7 m to 1.3 m, has room
    assert planar(source.stands)[1] <= 0.9 and news == [Event.KIDNAPPED]
    assert planar(source.stands @ se2(0.25, 0.0, 0.0))[1] <= 0.9, "and room for the command under way"


def test_where_there_is_none_the_robot_stays_and_the_run_goes_on():
    source, news = kidnapped(0.0, 0)
    assert np.array_equal(source.stands, se2(0.0, -1.0, 0.0)) and source.asked == DRAWS + 1 and news == []
