"""The true plan of a world: cells counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.floorplan import Box, Wall, after, distance_m, touched_cells, truth_grid
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
    with_it = truth_grid(after(blocked))
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


def ring_world(square, outer, inner):
    """A loop of corridors: the square's world with its walls drawn along two rectangles (x0, y0, x1, y1)."""
    def walls(name, x0, y0, x1, y1):
        return Wall(name, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]), 2.5)

    x0, y0 = outer[:2]
    middle = 0.5 * (outer[0] + inner[0]) - x0
    return replace(square, walls=(walls("outer", *outer), walls("inner", *inner)), boxes=(),
                   start=(x0 + middle, y0 + middle, 0.0))


@pytest.mark.parametrize("off", [0.0, 0.01, 0.025, 0.05, 0.0500004, 0.0499996, 0.07, 0.099])
@pytest.mark.parametrize("resolution_m", [0.1, 0.05, 0.07])
def test_no_building_loses_its_inner_block(square, off, resolution_m):
    """Wherever the inner walls stand against the cells: the block they enclose cannot be entered, the corridor round it is
    free, and no cell that a wall passes through is free."""
    world = ring_world(square, (off, off, 8.0, 8.0), (2.0 + off, 2.0 + off, 6.0 + off, 6.0 - off))
    grid = truth_grid(world, resolution_m)
    assert np.isnan(value(grid, 4.0, 4.0)) and np.isnan(value(grid, -0.15 + off, 4.0))
    for x, y in ((1.0, 1.0), (7.0, 4.0), (4.0, 7.0), (1.0, 4.0)):
        assert value(grid, x, y) == 0.0
    for wall in world.walls:
        for a, b in wall.segments_m:
            along = a + np.linspace(1e-4, 1.0 - 1e-4, 977)[:, None] * (b - a)
            assert (grid.probability[tuple(grid.cells(along).T)] == 1.0).all()


def test_a_wall_along_a_border_touches_the_cells_on_both_sides_and_not_beyond_its_ends(square):
    """Cells of 0.1 m begin at -0.25; the wall x = 1.05, y 1.05 to 2.05, lies on the border between columns 12 and 13."""
    wall = Wall("thin", np.array([[1.05, 1.05], [1.05, 2.05]]), 2.5)
    rows, columns = np.nonzero(touched_cells(replace(square, walls=(*square.walls, wall)), 0.1)
                               & ~touched_cells(square, 0.1))
    assert set(columns) == {12, 13} and sorted(set(rows)) == list(range(13, 23)) and len(rows) == 20


def test_a_box_between_borders_fills_its_cells_and_no_more(square):
    box = Box("chest", (1.1, 1.15), (0.3, 0.4, 1.0))  # x 0.95 to 1.25, y 0.95 to 1.35: three by four cells
    cells = touched_cells(replace(square, boxes=(box,)), 0.1) & ~touched_cells(square, 0.1)
    assert int(cells.sum()) == 12


@pytest.mark.parametrize("seed", range(20))
def test_a_turned_wall_touches_every_cell_that_it_passes_through(square, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.2, 1.8, (2, 2)).round(2)
    wall = Wall("slant", np.array([a, b]), 2.5)
    grid = truth_grid(replace(square, walls=(*square.walls, wall)))
    along = a + np.linspace(1e-4, 1.0 - 1e-4, 3001)[:, None] * (b - a)
    assert (grid.probability[tuple(grid.cells(along).T)] == 1.0).all()
