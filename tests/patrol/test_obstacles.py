"""Boxes of the command line: unknown to the survey, never on the waiting robot."""

import pytest

from rhs.base.errors import ConfigError
from rhs.patrol.job import with_obstacles
from rhs.worlds.world import load_world


def test_boxes_stand_in_the_world_of_the_patrol_as_they_were_typed():
    world = with_obstacles(load_world("square_small"), [[4.0, 0.8, 0.5, 0.4]])
    box = world.obstacles[-1]
    assert (box.name, tuple(box.centre_m), tuple(box.size_m)) == ("obstacle_1", (4.0, 0.8), (0.5, 0.4, 1.8))


def test_a_box_on_the_robot_that_waits_is_refused():
    world = load_world("square_small")
    x, y = world.route_m[-1]
    with pytest.raises(ConfigError, match="would be put in 0.00 m from the robot waiting at"):
        with_obstacles(world, [[float(x), float(y), 0.4, 0.4]])
