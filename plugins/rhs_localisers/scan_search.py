"""Where on the whole map could this scan have been taken? A deliberate search, for a filter that has nothing but scans.

Particles thrown over a large map hit some of the places that look alike and miss others, and what was missed is not
reconsidered later: the robot is sure of the one it happened to find. So when it is lost the map is searched densely, the
best spots are climbed, and every place found gets the weight of its summit, not of the number of throws that hit it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rhs.estimation.filters.clusters import heaps
from rhs.estimation.filters.particles import Cloud, displaced

PER_M2, MOST = 300.0, 60_000  # throws per square metre of free room, and at most
CLIMBERS, CHILDREN = 300, 8  # throws that climb, and tries of each in a round
FIRST_SIGMA = np.array([0.15, 0.15, 0.1])  # of the tries in the first round: metres, metres, radians
ROUNDS, FINER = 6, 0.6  # rounds, and the sigma of each as a share of the one before
ALIKE = 1.0  # a summit lower by less than this (a logarithm) counts as much: maps are a little wrong

Score = Callable[[np.ndarray], np.ndarray]  # log-likelihoods (N,) of states (N, 3)


def throws(area_m2: float) -> int:
    """How many states to throw over a free room of this size."""
    return int(min(max(PER_M2 * area_m2, CLIMBERS), MOST))


def summits(thrown: np.ndarray, log_likelihood: np.ndarray, score: Score, rng: np.random.Generator) -> Cloud:
    """The cloud round the places where states (N, 3) thrown over the map, with their log-likelihoods (N,), climb to: each
    place (heap) has a weight by its best likelihood."""
    best = _best_of_each_bin(thrown, log_likelihood)[:CLIMBERS]
    states, value = thrown[best], log_likelihood[best]
    parent = np.tile(np.arange(len(states)), 1 + CHILDREN)
    visited, heights = [thrown[best]], [value]
    for turn in range(ROUNDS):
        sigma = FIRST_SIGMA * FINER**turn
        visited.append(displaced(np.tile(states, (CHILDREN, 1)), np.zeros(3), np.diag(sigma**2), rng))
        heights.append(score(visited[-1]))
        tried, height = np.concatenate([states, visited[-1]]), np.concatenate([value, heights[-1]])
        highest = np.lexsort((-height, parent)).reshape(len(states), -1)[:, 0]
        states, value = tried[highest], height[highest]
    tried, height = np.concatenate(visited), np.concatenate(heights)  # all of them: a corridor is one long heap
    labels = heaps(tried)
    summit = np.full(labels.max() + 1, -np.inf)
    np.maximum.at(summit, labels, height)
    within = np.exp(height - summit[labels])
    standing = np.exp(np.minimum(summit - summit.max() + ALIKE, 0.0)) / np.bincount(labels, weights=within)
    share = standing[labels] * within
    kept = share > 1e-9 * share.max()
    return Cloud(tried[kept], np.log(share[kept] / share[kept].sum()))


def _best_of_each_bin(states: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Rows of the best state in each bin of half a metre and 30 degrees, best bin first: no place crowds out the others."""
    bins = np.floor(states / [0.5, 0.5, np.pi / 6.0]).astype(int)
    order = np.argsort(-value, kind="stable")
    _, first = np.unique(bins[order], axis=0, return_index=True)
    return order[np.sort(first)]
