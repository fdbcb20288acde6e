"""Clouds of a frame called `map`: of the scanner where they move with the robot, else refused."""

from __future__ import annotations

import numpy as np
import pytest
from bags import BagFile
from helpers.replayed import refused, views

from rhs.api.geometry import inverse, se2, transform


def room(count=3000):
    """Points on the walls and pillars of a room of 8 x 6 m, in its own frame."""
    rng = np.random.default_rng(0)
    share, side = rng.uniform(0.0, 1.0, count), rng.integers(0, 5, count)
    x = np.select([side == 0, side == 1, side == 2, side == 3], [8 * share, 8 * share, 0 * share, 0 * share + 8], 2.0)
    y = np.select([side == 0, side == 1, side == 2, side == 3], [0 * share, 0 * share + 6, 6 * share, 6 * share], 4 * share)
    return np.stack([x - 4.0, y - 3.0, rng.uniform(0.0, 2.0, count)], axis=1)


def bag_of(folder, *, moved: bool, wheels: bool = True):
    """A robot that drives along a curve. moved: somebody has put the clouds into the frame of the room."""
    with BagFile(folder, "ros2_mcap") as bag:
        for k in range(60):
            pose = 0.08 * k - 2.0, 0.3 * np.sin(0.1 * k), 0.4 * np.sin(0.15 * k)
            if wheels:
                bag.odometry("/odom", 1e9 + 0.1 * k, *pose)
            points = room() if moved else transform(inverse(se2(*pose)), room())
            bag.cloud("/points", 1e9 + 0.1 * k, points)
    return bag.path


@pytest.fixture(autouse=True)
def in_map(monkeypatch):
    monkeypatch.setattr(BagFile.header, "__defaults__", ("map",))


def test_clouds_that_move_with_the_robot_are_the_scanners_whatever_their_frame_is_called(tmp_path, caplog):
    _, seen = views(bag_of(tmp_path, moved=False))
    assert len(seen) == 60 and "but move with the robot" in caplog.text


@pytest.mark.parametrize("how", [{"moved": True}, {"moved": False, "wheels": False}])
def test_clouds_that_were_put_into_a_map_or_of_which_nothing_tells_are_refused(tmp_path, how):
    assert "in which the robot moves" in refused(bag_of(tmp_path, **how))
