"""Walks over cells, checked against dense sampling and by hand."""

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.estimation.scans.rays import HIT, cast, mark_scan, segment_is_free

GRID = OccupancyGrid(np.zeros((30, 40)), 0.1, (0.0, 0.0))


def test_the_walk_visits_exactly_the_cells_a_dense_sampling_visits():
    rng = np.random.default_rng(1)
    for _ in range(50):
        start = rng.uniform([1, 1], [39, 29])
        angle, length = rng.uniform(-np.pi, np.pi), rng.uniform(0.1, 20.0)
        marks, touched = np.zeros((30, 40), np.uint8), np.zeros((1200, 2), np.int32)
        count = mark_scan(marks, touched, start, np.array([angle]), np.array([length]), np.array([True]))
        steps = np.linspace(0, length, 200_000)
        dense = start + steps[:, None] * [np.cos(angle), np.sin(angle)]
        columns, rows = np.floor(dense).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < 40) & (rows < 30)
        visited = {tuple(rc) for rc in touched[:count]}
        sampled = {divmod(int(cell), 40) for cell in np.unique(40 * rows[inside] + columns[inside])}
        assert sampled <= visited
        assert len(visited - sampled) <= 1  # a corner clipped by less than the sampling step
        assert (marks == HIT).sum() <= 1


def test_a_wall_two_metres_ahead_is_met_at_its_near_border():
    blocked = np.zeros((30, 40), bool)
    blocked[:, 30] = True
    ranges = cast(blocked, GRID, np.array([1.05, 1.5]), np.array([0.0, np.pi / 4, np.pi]), 10.0)
    np.testing.assert_allclose(ranges[0], 1.95, atol=1e-9)
    assert np.isinf(ranges[1])  # leaves through the top before it reaches the wall
    assert np.isinf(ranges[2])


def test_a_segment_is_free_only_if_no_cell_under_it_is_blocked():
    blocked = np.zeros((30, 40), bool)
    blocked[10:20, 20] = True
    assert not segment_is_free(blocked, GRID, np.array([1.0, 1.5]), np.array([3.0, 1.5]))
    assert segment_is_free(blocked, GRID, np.array([1.0, 0.5]), np.array([3.0, 0.5]))
    assert segment_is_free(blocked, GRID, np.array([1.0, 1.5]), np.array([1.95, 1.5]))
