"""The search of the whole map by scans alone, on likelihoods whose summits are known."""

import numpy as np
import pytest

from rhs_localisers.advanced import SearchSettings
from rhs_localisers.scan_search import summits, throws

SUMMITS = np.array([[1.0, 1.0, 0.0], [6.0, 2.0, 2.0], [3.0, 4.0, -2.5]])


def _score(heights):
    def score(states):
        gap = (states[:, None] - SUMMITS[None]) / [0.1, 0.1, 0.05]
        return np.max(np.asarray(heights) - 0.5 * (gap**2).sum(axis=2), axis=1)

    return score


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("heights, shares", [
    ((0.0, 0.0, -40.0), (0.5, 0.5, 0.0)),
    ((0.0, -SearchSettings().alike, -40.0), (0.5, 0.5, 0.0)),  # maps are a little wrong
    ((0.0, -SearchSettings().alike - np.log(3.0), -40.0), (0.75, 0.25, 0.0)),
])  # fmt: skip
def test_places_weigh_by_their_summits_and_not_by_how_many_throws_hit_them(seed, heights, shares):
    rng = np.random.default_rng(seed)
    thrown = rng.uniform([0.0, 0.0, -np.pi], [8.0, 5.0, np.pi], (6000, 3))
    thrown = np.concatenate([thrown, SUMMITS[0] + rng.normal(0.0, 0.05, (500, 3))])  # many on the first
    cloud = summits(thrown, _score(heights)(thrown), _score(heights), rng)
    at = np.linalg.norm(cloud.states[:, None, :2] - SUMMITS[None, :, :2], axis=2) < 1.0
    np.testing.assert_allclose([cloud.weights[near].sum() for near in at.T], shares, atol=0.06)


def test_a_large_map_costs_no_more_than_the_most():
    assert throws(10.0) == 3000 and throws(1e6) == SearchSettings().most
