"""Facts about cells and metres."""

import numpy as np
import pytest

from rhs.api.grid import OccupancyGrid, configuration_space, frame_of, inflate, nearest_open


def test_whole_decimetres_are_cell_centres():
    (rows, columns), origin_m = frame_of((0.0, 0.0, 20.0, 10.0), 0.1)
    grid = OccupancyGrid(np.zeros((rows, columns)), 0.1, origin_m)
    points = np.array([[0.0, 0.0], [2.0, 1.0], [20.0, 10.0], [0.1, 9.9]])
    np.testing.assert_allclose(grid.centres(grid.cells(points)), points, atol=1e-9)


def test_the_grid_reaches_two_cells_past_the_bounds():
    shape, origin_m = frame_of((0.0, 0.0, 20.0, 10.0), 0.1)
    assert shape == (105, 205)
    np.testing.assert_allclose(origin_m, (-0.25, -0.25))


def test_bounds_between_cells_are_covered():
    shape, origin_m = frame_of((-0.33, 0.27, 1.04, 2.0), 0.1)
    grid = OccupancyGrid(np.zeros(shape), 0.1, origin_m)
    assert grid.inside(np.array([[-0.33, 0.27], [1.04, 2.0]])).all()


def test_a_goal_in_the_shadow_moves_to_the_nearest_open_cell_within_reach():
    """Cells of 0.1 m; only the last of five is open. From the middle of the fourth it is 0.1 m away."""
    grid = OccupancyGrid(np.zeros((1, 5), np.float32), 0.1, (0.0, 0.0))
    blocked = np.array([[True, True, True, True, False]])
    goal = np.array([0.35, 0.05])
    assert np.allclose(nearest_open(grid, blocked, goal, 0.2), [0.45, 0.05])
    assert np.allclose(nearest_open(grid, blocked, goal, 0.05), goal)
    assert np.allclose(nearest_open(grid, ~blocked, goal, 0.2), goal)


@pytest.mark.parametrize(("radius_m", "strip"), [(0.0, 0), (0.1, 1), (0.25, 3), (0.3, 3)])
def test_the_centre_of_the_robot_keeps_its_radius_from_the_border_of_the_map(radius_m, strip):
    """Cells of 0.1 m: with 0.25 m the third cell begins 0.2 m from the border and is too near, the fourth is not."""
    grid = OccupancyGrid(np.zeros((20, 30), np.float32), 0.1, (0.0, 0.0))
    free = np.argwhere(~grid.blocked(radius_m))
    assert free.min(axis=0).tolist() == [strip, strip] and free.max(axis=0).tolist() == [19 - strip, 29 - strip]


def test_obstacles_grow_as_before_inside():
    obstacle = np.random.default_rng(1).random((40, 40)) < 0.02
    grown = configuration_space(obstacle, 3.0)
    assert np.array_equal(grown[3:-3, 3:-3], inflate(obstacle, 3.0)[3:-3, 3:-3])
    assert configuration_space(np.zeros((4, 4), bool), 9.0).all()
