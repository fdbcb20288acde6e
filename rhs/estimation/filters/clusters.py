"""Separate clusters of particles: rival answers to "where am I", kept alive and weighed with caution.

An ordinary particle filter loses all clusters but one: resampling drops the lighter ones for good, and small errors of the
map, which keep their sign view after view, add up to certainty. Here each cluster is resampled by itself, at its exact
weight and with a least number of particles, and evidence between clusters counts less than within them.
Source of the idea of clusters with their own normalisation: Milstein, Sanchez, Williamson, Robust global localization
using clustered particle filtering (AAAI 2002).
"""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import se2
from rhs.api.jit import compiled

from .particles import ParticleSet, SizeLaw, even, low_variance, needed, reweighted
from .settings import ClusterSettings

USUAL = ClusterSettings()


def cluster_labels(states: np.ndarray, s: ClusterSettings = USUAL, *, most_cells: int = 400_000) -> np.ndarray:
    """(N,) which cluster each state belongs to: states in touching bins (cell_m, a turn / headings) are of one cluster.

    States spread over more than `most_cells` bins count as one cluster."""
    turns = s.headings
    at, size = _bins(np.ascontiguousarray(states), s.cell_m, turns)
    heading = at[:, 2]
    if max(size[0], size[1]) <= 2 and heading.max() - heading.min() <= 1:  # touching bins only
        return np.zeros(len(states), int)
    if size[0] * size[1] * turns > most_cells:
        return np.zeros(len(states), int)
    return _touching(at, (size[0], size[1], turns))


def reweighted_by_clusters(
    cloud: ParticleSet, log_likelihood: np.ndarray, labels: np.ndarray, caution: ClusterSettings
) -> tuple[ParticleSet, float]:
    """`reweighted` within each cluster (labels (N,), see `cluster_labels`), and cautiously between them. The second
    value is, as there, the logarithm of the mean likelihood under the whole cloud."""
    count = int(labels.max()) + 1
    if count == 1:
        return reweighted(cloud, log_likelihood)
    before = np.bincount(labels, weights=cloud.weights, minlength=count)
    total = cloud.log_weights + np.where(np.isnan(log_likelihood), -np.inf, log_likelihood)
    peak_log = np.full(count, -np.inf)
    np.maximum.at(peak_log, labels, total)
    if not np.isfinite(peak_log).any():
        return even(cloud.states), -np.inf
    safe = np.where(np.isfinite(peak_log), peak_log, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):  # clusters that weighed nothing, before or after
        after = safe + np.log(np.bincount(labels, weights=np.exp(total - safe[labels]), minlength=count))
        gain = after - np.log(before)
        best = float(gain[before > 0].max())
        evidence = _log_sum(np.where(before > 0, np.log(before) + gain, -np.inf))
        drop = np.minimum(gain - best + caution.margin, 0.0) * caution.share
        log_weights = total - after[labels] + np.log(before)[labels] + drop[labels]
    log_weights = np.where(np.isnan(log_weights), -np.inf, log_weights)
    return ParticleSet(cloud.states, log_weights - _log_sum(log_weights)), evidence


def _log_sum(values: np.ndarray) -> float:
    top = float(values.max())
    return top + float(np.log(np.exp(values - top).sum()))


def resampled_by_clusters(
    cloud: ParticleSet, law: SizeLaw, rng: np.random.Generator, s: ClusterSettings = USUAL
) -> ParticleSet:
    """Low-variance resampling within each cluster, to the size its own spread asks for; clusters keep their weights.

    The `most` heaviest clusters above `lightest` live on with at least `least_particles` each; the others are resampled
    together, in proportion to their weight."""
    labels, least = cluster_labels(cloud.states, s), s.least_particles
    weights = cloud.weights
    mass = np.bincount(labels, weights=weights)
    order = np.argsort(-mass, kind="stable")
    order = order[mass[order] >= s.lightest]
    rest = np.isin(labels, order[s.most :])
    groups = [labels == cluster for cluster in order[: s.most]] + ([rest] if rest.any() else [])
    states, logs = [], []
    for inside in groups:
        share = float(weights[inside].sum())
        trial = low_variance(weights[inside], max(int(law.most * share), least), rng.random())
        asked = needed(cloud.states[inside][trial], law)
        size = int(np.clip(asked * min(1.0, 2.0 * share), least, max(law.most * share, least)))
        chosen = low_variance(weights[inside], size, rng.random())
        states.append(cloud.states[inside][chosen])
        logs.append(np.full(size, np.log(share / size)))
    log_weights = np.concatenate(logs)
    return ParticleSet(np.concatenate(states), log_weights - _log_sum(log_weights))


def believed(cloud: ParticleSet, s: ClusterSettings = USUAL, *, most: int = 3) -> list[np.ndarray]:
    """Mean poses (4x4) of the heaviest clusters of a cloud."""
    labels = cluster_labels(cloud.states, s)
    weights = cloud.weights
    mass = np.bincount(labels, weights=weights)
    out = []
    for cluster in np.argsort(-mass)[:most]:
        inside = labels == cluster
        if mass[cluster] > 0.02:
            share = weights[inside] / mass[cluster]
            x, y, yaw = cloud.states[inside].T
            out.append(se2(share @ x, share @ y, float(np.arctan2(share @ np.sin(yaw), share @ np.cos(yaw)))))
    return out


@compiled
def _bins(states: np.ndarray, cell_m: float, turns: int) -> tuple[np.ndarray, tuple[int, int]]:
    """(N, 3) bins of states (N, 3) from the lowest x and y, and how many there are along x and y."""
    at = np.empty(states.shape, np.int64)
    low_x, low_y = np.floor(states[:, 0].min() / cell_m), np.floor(states[:, 1].min() / cell_m)
    for k in range(len(states)):
        at[k, 0] = int(np.floor(states[k, 0] / cell_m) - low_x)
        at[k, 1] = int(np.floor(states[k, 1] / cell_m) - low_y)
        at[k, 2] = int(np.floor(states[k, 2] / (2.0 * np.pi) * turns)) % turns
    return at, (at[:, 0].max() + 1, at[:, 1].max() + 1)


@compiled
def _touching(at: np.ndarray, size: tuple[int, int, int]) -> np.ndarray:
    """(N,) numbers, from 0 in the order of first sight, of the groups of touching bins (N, 3) of a box of `size` bins; the
    last heading touches the first."""
    name = np.zeros(size, np.int32)  # 0: empty, -1: taken, else the group's number from 1
    for k in range(len(at)):
        name[at[k, 0], at[k, 1], at[k, 2]] = -1
    out, waiting, groups = np.empty(len(at), np.int64), np.empty((len(at), 3), np.int64), 0
    for k in range(len(at)):
        count = 0
        if name[at[k, 0], at[k, 1], at[k, 2]] == -1:
            groups += 1
            count = _take(name, at[k, 0], at[k, 1], at[k, 2], groups, waiting, count)
        while count:
            count -= 1
            x, y, turn = waiting[count]
            for nx in range(max(x - 1, 0), min(x + 2, size[0])):
                for ny in range(max(y - 1, 0), min(y + 2, size[1])):
                    for near in range(turn - 1, turn + 2):
                        count = _take(name, nx, ny, near % size[2], groups, waiting, count)
        out[k] = name[at[k, 0], at[k, 1], at[k, 2]] - 1
    return out


@compiled
def _take(name: np.ndarray, x: int, y: int, turn: int, group: int, waiting: np.ndarray, count: int) -> int:
    """Give a taken bin without a group this group, and let it wait for its neighbours to be looked at."""
    if name[x, y, turn] != -1:
        return count
    name[x, y, turn] = group
    waiting[count, 0], waiting[count, 1], waiting[count, 2] = x, y, turn
    return count + 1
