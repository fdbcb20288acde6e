"""A particle filter in the plane as an estimator of its own, free of any sensor.

States are (N, 3): x m, y m, yaw rad. Weights are kept as logarithms and add up to one. Source: Thrun, Burgard, Fox,
Probabilistic Robotics (2005): sampling from the motion (5.4), low-variance resampling (4.3.4), sample size by the
Kullback-Leibler distance (8.3.7; Fox 2003), random particles against kidnapping (8.3.5). Loads numba: import when needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.jit import compiled


@dataclass(frozen=True, eq=False)
class ParticleSet:
    """states (N, 3); log_weights (N,), whose exponentials add up to one."""

    states: np.ndarray
    log_weights: np.ndarray

    def __len__(self) -> int:
        return len(self.states)

    @property
    def weights(self) -> np.ndarray:
        weights: np.ndarray = np.exp(self.log_weights)
        return weights


@dataclass(frozen=True)
class SizeLaw:
    """How many particles suffice: with chance `1 - delta` (given as its normal quantile) the sampled distribution over
    bins of cell_m, cell_rad is within `epsilon` (Kullback-Leibler) of the true one; between least and most."""

    least: int = 300
    most: int = 5000
    epsilon: float = 0.05
    quantile: float = 2.33
    cell_m: float = 0.25
    cell_rad: float = np.radians(10.0)


def even(states: np.ndarray) -> ParticleSet:
    """A cloud of equally likely states (N, 3)."""
    return ParticleSet(states, np.full(len(states), -np.log(len(states))))


def around(mean: np.ndarray, covariance: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) states scattered round a planar pose (3,), covariance (3, 3) in its own frame (right perturbation)."""
    return displaced(np.tile(np.asarray(mean, float), (count, 1)), np.zeros(3), covariance, rng)


def displaced(states: np.ndarray, travel: np.ndarray, covariance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Each state moved by `travel` (3,) in its own frame and by its own sample of noise with covariance (3, 3)."""
    noise = rng.standard_normal((len(states), 3)) @ _root(covariance).T
    return _displace(np.ascontiguousarray(states), np.asarray(travel, float), noise)


def reweighted(cloud: ParticleSet, log_likelihood: np.ndarray) -> tuple[ParticleSet, float]:
    """The cloud after evidence (N,), and the logarithm of the mean likelihood under it. If no particle explains the
    evidence at all the weights become equal rather than zero."""
    total = cloud.log_weights + np.where(np.isnan(log_likelihood), -np.inf, log_likelihood)
    peak = float(total.max())
    if not np.isfinite(peak):
        return even(cloud.states), -np.inf
    evidence = peak + float(np.log(np.exp(total - peak).sum()))
    return ParticleSet(cloud.states, total - evidence), evidence


def merged(first: ParticleSet, first_mass: float, second: ParticleSet, second_mass: float) -> ParticleSet:
    """Both clouds in one, with these shares of the whole."""
    whole = first_mass + second_mass
    with np.errstate(divide="ignore"):
        logs = [c.log_weights + np.log(m / whole) for c, m in ((first, first_mass), (second, second_mass))]
    return ParticleSet(np.concatenate([first.states, second.states]), np.concatenate(logs))


def effective_size(cloud: ParticleSet) -> float:
    """How many equally weighted particles the cloud is worth: 1 / sum of squared weights."""
    return float(1.0 / np.exp(2.0 * cloud.log_weights).sum())


def resampled(cloud: ParticleSet, law: SizeLaw, rng: np.random.Generator) -> ParticleSet:
    """Low-variance resampling to the size the law asks for."""
    weights = cloud.weights
    trial = low_variance(weights, law.most, rng.random())
    count = needed(cloud.states[trial], law)
    return even(cloud.states[low_variance(weights, count, rng.random())])


def needed(states: np.ndarray, law: SizeLaw) -> int:
    """Particles that the spread of these states asks for (Fox 2003, eq. 9: from the number of occupied bins)."""
    bins = occupied_bins(states, law)
    if bins <= 1:
        return law.least
    spread = 2.0 / (9.0 * (bins - 1))
    size = (bins - 1) / (2.0 * law.epsilon) * (1.0 - spread + np.sqrt(spread) * law.quantile) ** 3
    return int(np.clip(np.ceil(size), law.least, law.most))


def occupied_bins(states: np.ndarray, law: SizeLaw) -> int:
    """How many bins of the law's size hold at least one state."""
    keys = np.floor(states / [law.cell_m, law.cell_m, law.cell_rad]).astype(np.int64)
    keys[:, 2] %= int(np.ceil(2.0 * np.pi / law.cell_rad))
    return len(np.unique((keys[:, 0] * 1_000_003 + keys[:, 1]) * 1_009 + keys[:, 2]))


@dataclass(frozen=True, eq=False)
class Peak:
    """The heaviest cluster of a cloud: mean (3,), covariance (3, 3) in its own frame, mass (0..1) of the cluster, and
    `near`, the mass within the tolerance asked for."""

    mean: np.ndarray
    covariance: np.ndarray
    mass: float
    near: float


def peak(cloud: ParticleSet, *, near_m: float, near_rad: float, cluster_m: float = 1.0, cluster_rad: float = 0.5) -> Peak:
    """Find the densest spot: start in the heaviest bin, then mean-shift over the particles within cluster_m, cluster_rad."""
    states, weights = np.ascontiguousarray(cloud.states), cloud.weights
    start = states[_densest(cloud)].copy()
    mean, mass, spread, near = _shifted(states, weights, start, cluster_m, cluster_rad, near_m, near_rad)
    return Peak(mean, spread + 1e-8 * np.eye(3), float(mass), float(near))


def _densest(cloud: ParticleSet, cell_m: float = 0.5, cell_rad: float = np.radians(20.0)) -> int:
    """Index of the heaviest particle in the heaviest bin."""
    keys = np.floor(cloud.states / [cell_m, cell_m, cell_rad]).astype(np.int64)
    keys[:, 2] %= round(2.0 * np.pi / cell_rad)
    return int(_heaviest(keys[:, 0] * 1_000_003 * 1_009 + keys[:, 1] * 1_009 + keys[:, 2], cloud.log_weights, cloud.weights))


def _root(covariance: np.ndarray) -> np.ndarray:
    """A matrix whose product with its transpose is the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root: np.ndarray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


@compiled
def _heaviest(keys: np.ndarray, log_weights: np.ndarray, weights: np.ndarray) -> int:
    """Index of the heaviest row of the key (N,) whose rows weigh most together; the first among equals."""
    order = np.argsort(keys, kind="mergesort")
    best, best_mass, mass, row = order[0], -1.0, 0.0, order[0]
    for n in range(len(order)):
        k = order[n]
        if n and keys[k] != keys[order[n - 1]]:
            mass, row = 0.0, k
        mass += weights[k]
        if log_weights[k] > log_weights[row]:
            row = k
        if mass > best_mass and (n + 1 == len(order) or keys[order[n + 1]] != keys[k]):
            best, best_mass = row, mass
    return int(best)


@compiled
def _displace(states: np.ndarray, travel: np.ndarray, noise: np.ndarray) -> np.ndarray:
    out = np.empty_like(states)
    for k in range(len(states)):
        c, s = np.cos(states[k, 2]), np.sin(states[k, 2])
        dx, dy = travel[0] + noise[k, 0], travel[1] + noise[k, 1]
        out[k, 0] = states[k, 0] + c * dx - s * dy
        out[k, 1] = states[k, 1] + s * dx + c * dy
        out[k, 2] = (states[k, 2] + travel[2] + noise[k, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return out


@compiled
def _shifted(states: np.ndarray, weights: np.ndarray, mean: np.ndarray, cluster_m: float, cluster_rad: float,
             near_m: float, near_rad: float, rounds: int = 3) -> tuple[np.ndarray, float, np.ndarray, float]:
    """Mean (3,), mass and covariance (3, 3) of the cluster that mean-shift ends in, and the mass near its mean."""
    mass, near, spread, moved = 0.0, 0.0, np.zeros((3, 3)), np.zeros(3)
    for turn in range(rounds + 1):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        total, new_spread, new_moved, local = 0.0, np.zeros((3, 3)), np.zeros(3), np.zeros(3)
        for k in range(len(states)):
            dx, dy = states[k, 0] - mean[0], states[k, 1] - mean[1]
            local[0], local[1] = c * dx + s * dy, -s * dx + c * dy
            local[2] = (states[k, 2] - mean[2] + np.pi) % (2.0 * np.pi) - np.pi
            gap, angle = np.sqrt(dx * dx + dy * dy), abs(local[2])
            if turn == rounds and gap < near_m and angle < near_rad:
                near += weights[k]
            if gap < cluster_m and angle < cluster_rad:
                total += weights[k]
                for i in range(3):
                    new_moved[i] += weights[k] * local[i]
                    for j in range(3):
                        new_spread[i, j] += weights[k] * local[i] * local[j]
        mass, spread, moved = total, new_spread / total, new_moved / total
        if turn < rounds:
            x, y = mean[0] + c * moved[0] - s * moved[1], mean[1] + s * moved[0] + c * moved[1]
            mean = np.array([x, y, mean[2] + moved[2]])
    return mean, mass, spread, near


@compiled
def low_variance(weights: np.ndarray, count: int, start: float) -> np.ndarray:
    """(count,) indices: one comb with `count` teeth laid over the cumulated weights, shifted by start (0..1)."""
    out = np.empty(count, np.int64)
    total = weights.sum()
    index, reached = 0, weights[0] / total
    for k in range(count):
        tooth = (k + start) / count
        while reached < tooth and index < len(weights) - 1:
            index += 1
            reached += weights[index] / total
        out[k] = index
    return out
