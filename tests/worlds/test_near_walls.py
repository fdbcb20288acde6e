"""In a hall wider than a camera sees a survey is led where the walls are seen."""

import numpy as np
import pytest

from rhs.api.grid import OccupancyGrid
from rhs.worlds.clearance import clearance_of
from rhs.worlds.near_walls import FAR_M, ROOM_M, keep_near_walls


def hall(width_m: float, height_m: float) -> OccupancyGrid:
    """A free rectangle of 0.1 m cells, its lower left corner at (0, 0), within walls one cell thick."""
    inside = np.zeros((round(10 * height_m), round(10 * width_m)), np.float32)
    return OccupancyGrid(np.pad(inside, 1, constant_values=1.0), 0.1, (-0.1, -0.1))


def test_in_a_room_whose_walls_are_near_everywhere_nothing_changes():
    grid = hall(5.8, 30.0)
    assert keep_near_walls(grid, (2.9, 15.0), 0.3, given=False) == (grid, (2.9, 15.0))


def test_of_a_hall_the_ground_near_its_walls_is_left_and_the_start_moves_there():
    grid = hall(20.0, 26.0)
    left, start = keep_near_walls(grid, (10.0, 13.0), 0.3, given=False)
    np.testing.assert_array_equal(left.free(), grid.free() & (clearance_of(grid) <= FAR_M))
    assert min(start[0], 20.0 - start[0], start[1], 26.0 - start[1]) == pytest.approx(FAR_M - ROOM_M, abs=0.15)
    assert clearance_of(left)[tuple(left.cells(np.array(start))[0])] >= ROOM_M


def test_a_given_start_stays_and_in_the_middle_of_a_hall_so_does_the_hall():
    grid = hall(20.0, 26.0)
    assert keep_near_walls(grid, (10.0, 13.0), 0.3, given=True) == (grid, (10.0, 13.0))
    left, start = keep_near_walls(grid, (1.5, 13.0), 0.3, given=True)
    assert start == (1.5, 13.0) and left.free().sum() < 0.5 * grid.free().sum()


def test_a_pillar_in_the_middle_is_no_place_to_begin_at():
    """The ground near it is cut off from the walls', which is larger."""
    grid = hall(20.0, 20.0)
    grid.probability[98:103, 98:103] = 1.0
    _, start = keep_near_walls(grid, (13.5, 13.5), 0.3, given=False)
    assert clearance_of(hall(20.0, 20.0))[tuple(grid.cells(np.array(start))[0])] <= FAR_M
