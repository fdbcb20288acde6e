"""Where on the whole map could this scan have been taken? A deliberate search, for a filter that has nothing but scans.

Particles thrown over a large map hit some of the places that look alike and miss others, and what was missed is not
reconsidered later: the robot is sure of the one it happened to find. So when it is lost the map is searched densely, the
best spots are climbed, and every place found gets the weight of its summit, not of the number of throws that hit it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rhs.estimation.filters.clusters import cluster_labels
from rhs.estimation.filters.particles import ParticleSet, displaced

from .advanced import SearchSettings

USUAL = SearchSettings()
BIN = np.array([0.5, 0.5, np.pi / 6.0])  # metres and radians in which only the best throw climbs

Score = Callable[[np.ndarray], np.ndarray]  # log-likelihoods (N,) of states (N, 3)


def throws(area_m2: float, s: SearchSettings = USUAL) -> int:
    """How many states to throw over a free room of this size."""
    return int(min(max(s.per_m2 * area_m2, s.climbers), s.most))


def summits(
    thrown: np.ndarray, log_likelihood: np.ndarray, score: Score, rng: np.random.Generator, s: SearchSettings = USUAL
) -> ParticleSet:
    """The cloud round the places where states (N, 3) thrown over the map, with their log-likelihoods (N,), climb to: each
    place (cluster) has a weight by its best likelihood."""
    best = _best_of_each_bin(thrown, log_likelihood, BIN)[: s.climbers]
    states, value = thrown[best], log_likelihood[best]
    parent = np.tile(np.arange(len(states)), 1 + s.children)
    visited, heights = [thrown[best]], [value]
    for turn in range(s.rounds):
        sigma = np.array([s.sigma_m, s.sigma_m, s.sigma_rad]) * s.finer**turn
        visited.append(displaced(np.tile(states, (s.children, 1)), np.zeros(3), np.diag(sigma**2), rng))
        heights.append(score(visited[-1]))
        tried, height = np.concatenate([states, visited[-1]]), np.concatenate([value, heights[-1]])
        highest = np.lexsort((-height, parent)).reshape(len(states), -1)[:, 0]
        states, value = tried[highest], height[highest]
    tried, height = np.concatenate(visited), np.concatenate(heights)  # all of them: a corridor is one long cluster
    labels = cluster_labels(tried)
    summit = np.full(labels.max() + 1, -np.inf)
    np.maximum.at(summit, labels, height)
    within = np.exp(height - summit[labels])
    standing = np.exp(np.minimum(summit - summit.max() + s.alike, 0.0)) / np.bincount(labels, weights=within)
    share = standing[labels] * within
    kept = share > 1e-9 * share.max()
    return ParticleSet(tried[kept], np.log(share[kept] / share[kept].sum()))


def rivals(states: np.ndarray, log_likelihood: np.ndarray, believed: np.ndarray, apart_m: float, most: int) -> np.ndarray:
    """(K, 3) the likeliest of states (N, 3) in each square metre that is further than apart_m from a pose (3,), at most
    `most`, best first."""
    away = np.hypot(*(states[:, :2] - believed[:2]).T) > apart_m
    states, log_likelihood = states[away], log_likelihood[away]
    return states[_best_of_each_bin(states, log_likelihood, np.array([1.0, 1.0, np.inf]))[:most]]


def _best_of_each_bin(states: np.ndarray, value: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Rows of the best state in each bin of this size (3,), best bin first: no place crowds out the others."""
    if not len(states):
        return np.empty(0, np.intp)
    bins = np.floor((states - states.min(axis=0)) / size).astype(int)
    order = np.argsort(-value, kind="stable")
    _, first = np.unique(np.ravel_multi_index(tuple(bins[order].T), tuple(bins.max(axis=0) + 1)), return_index=True)
    return order[np.sort(first)]
