"""A robot that is not round in the simulator: PyBullet and geometry agree where its side is, and its corners touch when it
turns where a round robot would not; the guard lets it turn no further than there is room."""

import numpy as np
import pytest

from rhs.api.contracts import SourceContext
from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov, planar, se2
from rhs.api.records import Event, Motion, Observation, Scan, Tracking, Twist
from rhs.api.robot_shape import footprint_of
from rhs.patrol.control import Pace
from rhs.patrol.guard import BEHIND_M, Guard, GuardSettings
from rhs.worlds.world import load_world
from rhs_sources.simulator_config import Simulator
from rhs_sources.simulator_solid import Solid

LONG = [[0.4, 0.2], [-0.25, 0.2], [-0.25, -0.2], [0.4, -0.2]]
CAMERA = camera_from_fov(32, 24, 57.0, height_m=1.0)
TURN = Twist(0.0, np.pi / 2, 1.0)


def test_pybullet_and_geometry_agree_where_the_side_is():
    """Walls are 2 mm thick to PyBullet, and its shapes have a millimetre's margin."""
    world = load_world("square_small", robot={"footprint_m": LONG})
    solid, rng = Solid(world), np.random.default_rng(0)
    segments = np.concatenate([wall.segments_m for wall in world.walls])
    try:
        for _ in range(200):
            stand = (*rng.uniform(0.3, 7.7, 2), rng.uniform(-np.pi, np.pi))
            expected = world.footprint.gap_to_m(segments, stand, 3.0)
            if expected > 0.0:
                assert solid.distance_m(*stand) == pytest.approx(expected, abs=2.5e-3)
            elif expected < -0.01:
                assert solid.distance_m(*stand) < 0.0
    finally:
        solid.close()


def driven(robot, *commands):
    """Where a robot without errors gets to from 0.3 m beside a wall, and whether it touched."""
    settings = Simulator(image_width=32, command_bias_percent=0.0, command_noise_percent=0.0, **robot)
    world = load_world("square_small", robot={key: value for key, value in robot.items() if value})
    source = settings.build(SourceContext(np.random.default_rng(0), world, None))
    try:
        source.begin_patrol()
        source.teleport(se2(4.0, 0.3, 0.0))
        source.clearance_m()
        bumped = [source.drive(command).contact for command in commands]
        return planar(source.truth()), source.clearance_m(), bumped
    finally:
        source.close()


def test_its_corners_touch_a_wall_that_a_round_robot_turns_beside():
    """Its corner is 0.447 m from where it turns, the wall 0.3 m: it gets 15 degrees far, a round robot all 90."""
    stand, (clearance, touched), bumped = driven({"footprint_m": LONG}, Twist(0.0, -np.pi / 2, 1.0))
    reach = np.hypot(0.4, 0.2)
    free_rad = np.arcsin(0.299 / reach) - np.arctan2(0.2, 0.4)
    assert bumped == [True] and touched and stand[2] == pytest.approx(-free_rad, abs=0.02)
    assert 0.0 <= clearance < 5e-3
    stand, (clearance, touched), bumped = driven({"robot_radius_m": 0.25}, TURN)
    assert bumped == [False] and not touched and stand[2] == pytest.approx(np.pi / 2) and clearance > 0.04


def test_the_guard_cuts_a_turn_to_the_room_of_the_corners():
    """A wall 0.3 m to the right of one that turns right: only as far as its corner keeps BEHIND_M from it."""
    robot = footprint_of(LONG, "it")
    for footprint in (robot, None):
        guard = Guard(robot.radius_m, Pace(), GuardSettings(), footprint)
        x_m = np.linspace(-0.6, 1.2, 120)
        bearings = np.arctan2(np.full(120, -0.3), x_m)
        scan = Scan(bearings, np.hypot(x_m, 0.3), 6.0)
        for index in range(3):
            guard.observe(Observation(index, 0.1 * index, CAMERA, scan=scan),
                          Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK))
        right = Twist(0.0, -1.0, 1.0)
        if footprint is None:
            assert guard.turn_in_room(right) is right and guard.allow(right)[0] is right, "a round robot turns anywhere"
            continue
        turned = guard.turn_in_room(right)
        assert turned.duration_s == 1.0 and -1.0 < turned.turn_radps <= 0.0
        wall = np.column_stack([x_m, np.full(120, -0.3)])
        c, s = np.cos(turned.turn_radps), np.sin(turned.turn_radps)
        assert robot.gaps_m(wall @ np.array([[c, -s], [s, c]])).min() > BEHIND_M - 0.04, "cells are 5 cm"
        assert guard.turn_in_room(Twist(0.3, -1.0, 1.0)).turn_radps == -1.0, "only turns on the spot"
        beside = Scan(bearings, np.hypot(x_m, 0.3) * 0.21 / 0.3, 6.0)
        for index in range(3, 12):
            guard.observe(Observation(index, 0.1 * index, CAMERA, scan=beside),
                          Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK))
        assert guard.allow(right) == (None, Event.STOPPED), "no room at all"


def test_words_and_files_mean_one_shape(tmp_path):
    text = "like: square_small\nfootprint_m: [[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]\n"
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    world = load_world(path)
    assert world.robot_radius_m == pytest.approx(np.hypot(0.3, 0.2)) and world.facts().footprint == world.footprint
    assert load_world(path, robot={"robot_radius_m": 0.25}).footprint is None, "who types a radius means a round robot"
    assert load_world(path, robot={"footprint_m": LONG}).robot_radius_m == pytest.approx(np.hypot(0.4, 0.2))
    assert load_world("random:office/3", robot={"footprint_m": [[0.2, 0.1], [-0.2, 0.1], [0.0, -0.2]]}).footprint is not None
    path.write_text(text + "robot_radius_m: 0.3\n")
    with pytest.raises(ConfigError, match="mine.yaml:2: a robot has a footprint_m or a robot_radius_m"):
        load_world(path)
    with pytest.raises(ConfigError, match="leave out source.robot_radius_m"):
        Simulator(robot_radius_m=0.2, footprint_m=LONG)
