"""The true plan of a world: cells counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.floorplan import Box, distance_m, truth_grid
from rhs.worlds.world import load_world


@pytest.fixture(scope="module")
def square():
    return load_world("square")


def value(grid, x, y):
    row, column = grid.cells(np.array([x, y]))[0]
    return grid.probability[row, column]


def test_the_square_has_1440_wall_cells_and_free_corridors(square):
    grid = truth_grid(square, 0.1)
    # outer 20 m: 201 cells a side; inner 16 m: 161; each corner shared by two sides
    assert int((grid.probability == 1.0).sum()) == 4 * 200 + 4 * 160
    # corridors: 199 x 199 cells inside the outer wall less the 161 x 161 of the inner wall and its core
    assert int((grid.probability == 0.0).sum()) == 199**2 - 161**2
    assert int(np.isnan(grid.probability).sum()) == 205**2 - 201**2 + 159**2


@pytest.mark.parametrize(("x", "y", "expected"), [
    (10.0, 0.0, 1.0), (10.04, 0.0, 1.0), (10.0, 0.1, 0.0), (10.0, 1.9, 0.0), (10.0, 2.0, 1.0), (2.0, 2.0, 1.0),
    (10.0, 2.1, np.nan), (10.0, -0.1, np.nan), (20.0, 20.0, 1.0), (19.9, 19.9, 0.0),
])
def test_cells_round_the_walls_of_the_square(square, x, y, expected):
    np.testing.assert_equal(value(truth_grid(square), x, y), np.float32(expected))


def test_obstacles_are_drawn_on_request_only():
    blocked = load_world("square_blocked")
    assert value(truth_grid(blocked), 5.0, 1.0) == 0.0
    with_it = truth_grid(blocked, with_obstacles=True)
    # 0.2 m wide about x = 5: the middle cell and half of each neighbour; what lies behind it is reached the other way
    assert [value(with_it, x, 1.0) for x in (4.8, 4.9, 5.0, 5.1, 5.2)] == [0.0, 1.0, 1.0, 1.0, 0.0]


def test_a_turned_box_touches_the_cells_under_its_diagonal(square):
    box = Box("plank", (10.0, 1.0), (1.4, 0.02, 1.0), yaw_rad=np.pi / 4)
    grid = truth_grid(replace(square, boxes=(box,)))
    for step in (-0.4, -0.2, 0.0, 0.3, 0.4):
        assert value(grid, 10.0 + step, 1.0 + step) == 1.0
    assert value(grid, 10.4, 0.6) == 0.0 and value(grid, 10.2, 1.0) == 0.0 and value(grid, 10.6, 1.6) == 0.0


def test_coarser_cells_hold_the_same_walls(square):
    grid = truth_grid(square, 0.5)
    assert [float(value(grid, 10.0, y)) for y in (0.0, 0.5, 1.0, 1.5, 2.0)] == [1.0, 0.0, 0.0, 0.0, 1.0]


def test_distances_to_walls_and_boxes(square):
    assert distance_m(square, np.array([10.0, 0.7])) == (pytest.approx(0.7), "wall 'outer'")
    assert distance_m(square, np.array([1.4, 1.2]))[0] == pytest.approx(1.0)  # 3-4-5 to the inner corner (2, 2)
    chest = replace(square, boxes=(Box("chest", (10.0, 1.0), (1.0, 0.5, 1.0)),))
    assert distance_m(chest, np.array([10.9, 1.0])) == (pytest.approx(0.4), "box 'chest'")
    assert distance_m(chest, np.array([10.2, 1.1]))[0] == 0.0
