"""Boxes, moved things and people by number: as many as asked for, the fewer among the more, none in the way of a place."""

import logging

import numpy as np
import pytest

from rhs.api.floorplan import after
from rhs.base.errors import ConfigError
from rhs.worlds.counted import with_counted
from rhs.worlds.random.obstacles import reached
from rhs.worlds.world import load_world

PLACES = ("square_small", "home", "random:office/31", "random:hall/5")


@pytest.mark.parametrize("name", PLACES)
def test_more_hold_the_fewer_and_close_nothing(name):
    world = load_world(name)
    few, many = (with_counted(world, 3, obstacles=count, people=count) for count in (2, 5))
    assert len(few.obstacles) == len(world.obstacles) + 2
    assert len(many.obstacles) == len(world.obstacles) + 5
    assert many.obstacles[: len(few.obstacles)] == few.obstacles
    radius_m = world.robot_radius_m + 0.05
    assert reached(after(many), radius_m=radius_m) == reached(after(world), radius_m=radius_m)
    for box in many.obstacles[len(world.obstacles):]:
        assert np.hypot(*(np.array(box.centre_m) - world.route_m[-1])) > world.robot_radius_m
    assert [len(one.moving.people) - len(world.moving.people) for one in (few, with_counted(world, 3, people=5))] == [2, 5]


def test_other_seeds_draw_others_and_the_same_the_same():
    world = load_world("square_small")
    ones = [with_counted(world, seed, obstacles=3).obstacles for seed in (0, 0, 1)]
    assert ones[0] == ones[1] != ones[2]
    assert with_counted(world, 0) is world


def test_what_is_moved_is_furniture_that_one_moves_and_too_many_are_said(caplog):
    world = load_world("home")
    with caplog.at_level(logging.WARNING):
        changed = with_counted(world, 3, moved=4).changes
    assert [*changed.removed, *(name for name, *_ in changed.moved)] == ["coffee_table"]
    assert "moved_count=4: of what is moved (coffee table, chair, crate, plant, bin, bench) home has 1" in caplog.text


CLOSET = """
start: [0.5, 0.5, 0]
walls: [{name: outer, points_m: [[0, 0], [2.2, 0], [2.2, 1], [0, 1], [0, 0]]}]
places: {end: [1.7, 0.5]}
route_m: [[0.5, 0.5], [1.7, 0.5]]
"""


@pytest.mark.parametrize("kind", ["moved", "obstacle", "people"])
def test_what_would_do_nothing_is_refused(tmp_path, kind):
    path = tmp_path / "closet.yaml"
    path.write_text(CLOSET)
    with pytest.raises(ConfigError, match=f"^{kind}_count=2: .*closet.* none; leave it out, or name another world$"):
        with_counted(load_world(path), 0, **{"obstacles" if kind == "obstacle" else kind: 2})
