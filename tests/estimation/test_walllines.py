"""Straight walls found in a scan of walls whose place is known."""

import numpy as np
import pytest

from rhs.api.geometry import planar
from rhs.api.records import Scan
from rhs.estimation.scans.wall_lines import find_wall_lines

BEARINGS = np.radians(np.linspace(-28.4, 28.4, 320))


def _depth_camera(walls, rng=None, bearings=BEARINGS):
    """A scan of lines n.p = d, given as (direction of n in degrees, d in metres), by a camera whose inverse range has a
    noise of 0.002 1/m."""
    normals = np.array([[np.cos(np.radians(a)), np.sin(np.radians(a))] for a, _ in walls])
    with np.errstate(divide="ignore"):
        near = np.max(normals @ np.stack([np.cos(bearings), np.sin(bearings)]) / np.array([[d] for _, d in walls]), axis=0)
        near = near + (0.0 if rng is None else rng.normal(0.0, 0.002, len(near)))
        ranges = np.where(near > 1.0 / 8.0, 1.0 / near, np.nan)
    return Scan(bearings, ranges, 8.0)


def test_both_sides_of_a_corridor_and_its_end_are_found_where_they_are():
    """Walls 1 m to the left and to the right, one 4 m ahead."""
    right, ahead, left = find_wall_lines(_depth_camera([(90, 1.0), (-90, 1.0), (0, 4.0)]))
    assert right.body_from_line[1, 3] == pytest.approx(-1.0, abs=1e-6)
    assert left.body_from_line[1, 3] == pytest.approx(1.0, abs=1e-6)
    assert ahead.body_from_line[0, 3] == pytest.approx(4.0, abs=1e-6)
    # x along the wall and y towards the robot, so a wall on the left runs backwards
    assert planar(right.body_from_line)[2] == pytest.approx(0.0, abs=1e-6)
    assert abs(planar(left.body_from_line)[2]) == pytest.approx(np.pi, abs=1e-6)
    assert ahead.ends_m[1] - ahead.ends_m[0] == pytest.approx(2.0, abs=0.2)  # trimmed at its corners
    assert right.ends_m[0] + right.body_from_line[0, 3] == pytest.approx(1.0 / np.tan(np.radians(28.4)), abs=0.05)


def test_the_stated_sigmas_hold_the_errors_of_noisy_walls():
    rng = np.random.default_rng(0)
    heading, across, stated = [], [], []
    for _ in range(200):
        lines = find_wall_lines(_depth_camera([(92, 1.0), (-88, 1.2)], rng))
        assert len(lines) == 2
        for line, (direction, distance) in zip(lines, [(-88, 1.2), (92, 1.0)], strict=True):
            normal = np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction))])
            heading.append(line.body_from_line[:2, 0] @ normal)
            across.append(normal @ line.body_from_line[:2, 3] - distance)
            stated.append((line.sigma_m, line.sigma_rad))
    sigma_m, sigma_rad = np.mean(stated, axis=0)
    assert 0.25 * sigma_rad < np.std(heading) < sigma_rad < np.radians(0.2)  # here beams err alone
    assert 0.25 * sigma_m < np.std(across) < sigma_m < 0.005
    assert abs(np.mean(heading)) < 4.0 * np.std(heading) / np.sqrt(len(heading))  # and no side of the error is preferred
    assert abs(np.mean(across)) < 4.0 * np.std(across) / np.sqrt(len(across))


def _round(radius_m, at_m, rng=None):
    """A scan of a circular wall round the origin, from (at_m, 0), looking along y."""
    ahead = np.stack([-np.sin(BEARINGS), np.cos(BEARINGS)])
    back = at_m * ahead[0]
    with np.errstate(invalid="ignore"):
        root = np.sqrt(back**2 - at_m**2 + radius_m**2)
    ranges = np.where(-back - root > 0, -back - root, -back + root)
    near = 1.0 / ranges + (0.0 if rng is None else rng.normal(0.0, 0.002, len(ranges)))
    return Scan(BEARINGS, np.where(near > 1.0 / 8.0, 1.0 / near, np.nan), 8.0)


def test_a_round_room_and_a_bend_have_no_straight_wall():
    """A circle of 2 m round the robot; the outer wall of bends of 5 to 100 m radius, seen from 1 m off."""
    assert find_wall_lines(_round(2.0, 0.0)) == []
    for radius_m in (5.0, 10.0, 20.0, 50.0, 100.0):
        assert find_wall_lines(_round(radius_m, radius_m - 1.0)) == []


def test_a_gentle_bend_is_measured_by_many_scans():
    """One scan takes a bend of 500 m radius for straight; thirty together see it, and to which side it bends."""
    rng = np.random.default_rng(0)
    for at_m, bend_per_m in ((499.0, -1 / 500), (501.0, 1 / 500)):
        lines = [line for _ in range(30) for line in find_wall_lines(_round(500.0, at_m, rng))]
        assert len(lines) == 30
        assert np.mean([line.bend_per_m for line in lines]) == pytest.approx(bend_per_m, rel=0.2)
        assert np.mean([line.sigma_bend for line in lines]) > 1 / 500
    straight = [line.bend_per_m for _ in range(30) for line in find_wall_lines(_depth_camera([(90, 1.0)], rng))]
    assert abs(np.mean(straight)) < 1 / 3000


def test_too_little_to_see_is_no_wall_and_no_error():
    nothing = np.full(320, np.nan)
    assert find_wall_lines(Scan(BEARINGS, nothing, 8.0)) == []
    assert find_wall_lines(Scan(BEARINGS, np.full(320, np.inf), 8.0)) == []
    few = nothing.copy()
    few[100:115] = 2.0
    assert find_wall_lines(Scan(BEARINGS, few, 8.0)) == []
    rng = np.random.default_rng(1)
    assert find_wall_lines(Scan(BEARINGS, rng.uniform(0.5, 7.0, 320), 8.0)) == []
    assert find_wall_lines(Scan(np.zeros(0), np.zeros(0), 8.0)) == []
    assert find_wall_lines(Scan(np.zeros(50), np.full(50, 2.0), 8.0)) == []  # all beams the same


def test_a_laser_all_round_sees_the_four_walls_of_a_room():
    """A room of 4 by 6 m, the robot in its middle, 720 beams, the beams leaving 0.2 m ahead of it."""
    bearings = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    scan = _depth_camera([(0, 2.0), (90, 3.0), (180, 2.0), (-90, 3.0)], bearings=bearings)
    scan = Scan(bearings, scan.ranges_m, 8.0, (0.2, 0.0))
    lines = find_wall_lines(scan)
    assert len(lines) == 5  # the wall behind is cut where the beams begin
    places = sorted({tuple(np.abs(np.round(line.body_from_line[:2, :2] @ [0, 1], 3)).tolist()) for line in lines})
    assert places == [(0.0, 1.0), (1.0, 0.0)]
    assert max(line.body_from_line[0, 3] for line in lines) == pytest.approx(2.2, abs=1e-6)
