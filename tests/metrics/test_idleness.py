"""Idleness and its exact bounds, by hand."""

import itertools

import numpy as np
import pytest

from rhs.metrics.idleness import idleness, shortest_trips


def test_worst_and_mean_idleness_of_two_places_by_hand():
    """Of 10 s, a visited at 4, b at 10 (its end): worst 10; mean (4^2/2 + 6^2/2 + 10^2/2) / (2 places * 10 s) = 3.8."""
    worst, mean = idleness([[4.0], [10.0]], 10.0)
    assert worst == 10.0 and mean == pytest.approx((8.0 + 18.0 + 50.0) / 20.0)


def test_a_place_never_visited_is_idle_all_the_time():
    assert idleness([[]], 7.0) == (7.0, 3.5)


def test_places_on_a_line_take_the_line_and_the_line_back():
    """From 0 to places at 1, 2, 5: once 5 m; for ever 1 to 5 and back, 8 m."""
    at = np.array([0.0, 2.0, 5.0, 1.0])
    assert shortest_trips(np.abs(at[:, None] - at)) == (5.0, 8.0)


@pytest.mark.parametrize("seed", range(3))
def test_the_trips_are_the_shortest_of_all_orders(seed):
    points = np.random.default_rng(seed).uniform(0, 10, (6, 2))
    lengths = np.linalg.norm(points[:, None] - points, axis=2)

    def way(order):
        return sum(lengths[a, b] for a, b in itertools.pairwise(order))

    once = min(way((0, *order)) for order in itertools.permutations(range(1, 6)))
    for_ever = min(way((*order, order[0])) for order in itertools.permutations(range(1, 6)))
    assert shortest_trips(lengths) == pytest.approx((once, for_ever))


def test_one_place_needs_no_round_trip():
    assert shortest_trips(np.array([[0.0, 3.0], [3.0, 0.0]])) == (3.0, 0.0)
