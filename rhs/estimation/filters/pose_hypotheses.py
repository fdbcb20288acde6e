"""Several guesses of one pose, each a Kalman filter in the plane, weighed against each other and against "elsewhere".

A Gaussian-sum filter over poses with a catch-all: `elsewhere` is the chance that the robot is where no guess stands. A
place answer confirms the guesses it agrees with, corrects them (chi-square gate, then the Kalman update of
rhs.estimation.filters.kalman on x, y and heading), opens new ones, and speaks against all others. Because look-alike
places are verified side by side, twins keep equal weight until something tells them apart.
Source: Kalman update and gate: thesis section 2.2; Gaussian sums: Alspach and Sorenson (1972); the catch-all and the
restart after a kidnap follow the idea of Augmented MCL (Thrun, Burgard, Fox, Probabilistic Robotics, 8.3.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.geometry import compose_covariance, exp_se3, inverse, log_se3, orthonormal

from .kalman import correct, gate

PLANE = np.eye(6)[[0, 1, 5]]  # rows of x, y and heading
_SHARED = np.equal.outer(PLANE.any(axis=0), PLANE.any(axis=0))  # (6, 6) both in the plane, or both out of it


@dataclass(frozen=True)
class Trust:
    """p_true: chance that a verified place answer is right. kidnap: chance per step of being carried elsewhere.
    gate_probability: of the chi-square gate. keep: most guesses kept. floor: weight below which a guess is dropped."""

    p_true: float = 0.9
    kidnap: float = 1e-4
    gate_probability: float = 0.999
    keep: int = 8
    floor: float = 1e-5


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """map_from_body 4x4, covariance 6x6 of its right perturbation, weight (chance of being the right one)."""

    map_from_body: np.ndarray
    covariance: np.ndarray
    weight: float


@dataclass(frozen=True, eq=False)
class PlaceFix:
    """A verified place answer: a pose with covariance, and its share (0..1) of all the support in this view."""

    map_from_body: np.ndarray
    covariance: np.ndarray
    share: float


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """guesses, heaviest first; their weights and `elsewhere` add up to one."""

    guesses: tuple[Hypothesis, ...]
    elsewhere: float

    @property
    def best(self) -> Hypothesis | None:
        return self.guesses[0] if self.guesses else None


def begin(map_from_body: np.ndarray | None, covariance: np.ndarray | None, probability: float = 1.0) -> Hypotheses:
    """From one believed pose, or from nothing (None)."""
    if map_from_body is None or covariance is None:
        return Hypotheses((), 1.0)
    weight = min(max(probability, 0.01), 0.9999)
    return Hypotheses((Hypothesis(map_from_body, covariance, weight),), 1.0 - weight)


def predict(state: Hypotheses, previous_from_body: np.ndarray, covariance: np.ndarray, trust: Trust) -> Hypotheses:
    """All guesses moved; a little of their weight leaks elsewhere.

    What the plane has in common with height, roll and pitch is not kept: nothing ever measures these, so a robot that was
    lost for a while hardly knows them, and a place that corrects x by centimetres would tilt it by degrees."""
    moved = [
        Hypothesis(
            orthonormal(g.map_from_body @ previous_from_body),
            compose_covariance(g.covariance, previous_from_body, covariance) * _SHARED,
            g.weight * (1.0 - trust.kidnap),
        )
        for g in state.guesses
    ]
    return _normalised(moved, state.elsewhere + trust.kidnap * (1.0 - state.elsewhere), trust)


def update(state: Hypotheses, claims: Sequence[PlaceFix], areas: float, trust: Trust) -> Hypotheses:
    """Weigh the guesses by what the place database answered. areas: how many distinct places it could have named.

    A guess that agrees with a claim of share s is as likely as p_true s. One that agrees with none, and `elsewhere`, are
    left with the chance that a wrong place was named, (1 - p_true), and named exactly here, 1 / areas.
    """
    if not claims:
        return state
    miss = (1.0 - trust.p_true) / areas
    kept: list[Hypothesis] = []
    explained: set[int] = set()
    for guess in state.guesses:
        chosen, corrected = _corrected(guess, claims, trust)
        explained.update(chosen)
        likelihood = trust.p_true * max(claims[k].share for k in chosen) if chosen else 0.0
        kept.append(replace(corrected, weight=guess.weight * (likelihood + miss)))
    for k, claim in enumerate(claims):
        if k not in explained:
            weight = state.elsewhere * trust.p_true * claim.share / areas
            kept.append(Hypothesis(claim.map_from_body, claim.covariance, weight))
    return _normalised(_merged(kept, trust), state.elsewhere * miss, trust)


def silent(state: Hypotheses, ratio: float, trust: Trust) -> Hypotheses:
    """No place was recognised where the best guess expects one: `ratio` times likelier elsewhere."""
    return _normalised(list(state.guesses), state.elsewhere * ratio, trust)


def likelier(state: Hypotheses, odds: np.ndarray, trust: Trust, *, elsewhere: float = 0.0) -> Hypotheses:
    """Something was seen that is likelier from each guess than from anywhere else by so much: logarithms, one a guess.
    elsewhere: at least so likely that was before."""
    before = max(elsewhere, state.elsewhere)
    gain = np.exp(np.clip(odds, -50.0, 50.0)) * (1.0 - before) / max(1.0 - state.elsewhere, 1e-12)
    return _normalised([replace(g, weight=g.weight * k) for g, k in zip(state.guesses, gain, strict=True)], before, trust)


def added(state: Hypotheses, other: Hypotheses | None, share: float, trust: Trust) -> Hypotheses:
    """The state with the best guess of another one, where none stands, by this share of the chance of being elsewhere."""
    if other is None or other.best is None:
        return state
    guess = replace(other.best, weight=share * state.elsewhere)
    kept = _merged([*state.guesses, guess], trust)
    return _normalised(kept, (1.0 - share) * state.elsewhere, trust) if len(kept) > len(state.guesses) else state


def carried(state: Hypotheses, chance: float, trust: Trust) -> Hypotheses:
    """Something says that the robot was carried off: `elsewhere` is at least so likely, whatever was known before."""
    if state.elsewhere >= chance:
        return state
    share = (1.0 - chance) / (1.0 - state.elsewhere)
    return _normalised([replace(g, weight=g.weight * share) for g in state.guesses], chance, trust)


def confirms(state: Hypotheses, claims: Sequence[PlaceFix], trust: Trust) -> bool:
    """Whether any claim agrees with the best guess."""
    return state.best is not None and bool(_corrected(state.best, claims, trust)[0])


def _corrected(guess: Hypothesis, claims: Sequence[PlaceFix], trust: Trust) -> tuple[list[int], Hypothesis]:
    """Which claims the guess agrees with, and the guess corrected by the nearest of them."""
    limit = gate(3, trust.gate_probability)
    agreeing = []
    for k, claim in enumerate(claims):
        residual = PLANE @ log_se3(inverse(guess.map_from_body) @ claim.map_from_body)
        noise = PLANE @ claim.covariance @ PLANE.T
        change = correct(guess.covariance, PLANE, residual, noise)
        if change.nis <= limit:
            agreeing.append((change.nis, k, change))
    if not agreeing:
        return [], guess
    _, _, change = min(agreeing, key=lambda item: item[:2])
    pose = orthonormal(guess.map_from_body @ exp_se3(change.delta))
    return [k for _, k, _ in agreeing], Hypothesis(pose, change.covariance, guess.weight)


def _merged(guesses: list[Hypothesis], trust: Trust) -> list[Hypothesis]:
    """Hypotheses that have become one: the heavier stays and takes the weight of the lighter."""
    limit = gate(3, trust.gate_probability)
    out: list[Hypothesis] = []
    for guess in sorted(guesses, key=lambda g: -g.weight):
        for k, other in enumerate(out):
            residual = PLANE @ log_se3(inverse(other.map_from_body) @ guess.map_from_body)
            spread = PLANE @ (other.covariance + guess.covariance) @ PLANE.T
            if residual @ np.linalg.solve(spread, residual) <= limit:
                out[k] = replace(other, weight=other.weight + guess.weight)
                break
        else:
            out.append(guess)
    return out


def _normalised(guesses: list[Hypothesis], elsewhere: float, trust: Trust) -> Hypotheses:
    total = sum(g.weight for g in guesses) + elsewhere
    ranked = sorted((replace(g, weight=g.weight / total) for g in guesses), key=lambda g: -g.weight)
    kept = tuple(g for g in ranked[: trust.keep] if g.weight >= trust.floor)
    return Hypotheses(kept, 1.0 - sum(g.weight for g in kept))
