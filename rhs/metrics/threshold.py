"""The level of a dial at which half of the runs fail: a Bayesian threshold with slope and lapses; where to try next.

The chance of success over the dial, as psychophysics has it (Kontsevich and Tyler 1999; Wichmann and Hill 2001):

    p(x) = (1 - lapse) / (1 + (1 - 2 lapse) exp(direction (x - threshold) / slope)),    x = share of the dial, 0 to 1

so that p(threshold) = 1/2 whatever the lapses,
on a grid of thresholds, slopes, lapses and the two directions, prior even (slopes evenly in their logarithm). The threshold
may lie a quarter of the dial beyond its ends, which is how "it does not break here" is said. The first levels are spread
over the dial, since a search for one threshold never looks between two; then the next level is the one whose outcome tells
most about the threshold (mutual information, the minimum entropy of Kontsevich and Tyler). What no such curve is gets said:
a dial that may do nothing (a constant chance, by the Bayes factor: Kass and Raftery 1995), and a middle that differs from
both sides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

BEYOND = 0.25
WIDE = 30.0  # ends so many times apart: levels are spread over the logarithm
THRESHOLDS = np.linspace(-BEYOND, 1.0 + BEYOND, 151)
SLOPES = np.geomspace(0.008, 0.25, 9)
LAPSES = np.array([0.0, 0.03, 0.08, 0.15])
LEVELS = np.linspace(0.0, 1.0, 41)
FIRST = (0.5, 0.0, 1.0, 0.25, 0.75)  # levels of the first runs
UNLIKE = 0.05  # Fisher's exact test, of each side of the middle
LEAST_SEEDS, SAMPLES = 4, 100
CLOSE = 0.05  # share of the dial to which a break point is worth knowing


@dataclass(frozen=True)
class Dial:
    """A setting between two ends. logarithmic: levels are spread over its logarithm. whole: it takes whole numbers."""

    key: str
    low: float
    high: float
    logarithmic: bool = False
    whole: bool = False

    def value(self, level: float) -> float | int:
        """The setting at a level, a share of the dial; the ends may be overstepped."""
        if self.logarithmic:
            value = math.exp(math.log(self.low) + level * (math.log(self.high) - math.log(self.low)))
        else:
            value = self.low + level * (self.high - self.low)
        return round(value) if self.whole else float(f"{value:.6g}")

    def level(self, value: float) -> float:
        """The share of the dial at which this value stands: what a rounded value was really tried at."""
        if self.logarithmic:
            return (math.log(value) - math.log(self.low)) / (math.log(self.high) - math.log(self.low))
        return (value - self.low) / (self.high - self.low)

    def text(self, level: float) -> str:
        """The value at a level in three digits; beyond the ends, where nothing was tried, only that."""
        side = "below " if level < 0.0 else "above " if level > 1.0 else ""
        return side + three_digits(self.value(min(max(level, 0.0), 1.0)))


def three_digits(value: float) -> str:
    """Such as 1220 and 0.0123: a power of ten only from a million on, and for very small ones."""
    return f"{float(f'{value:.3g}'):g}"


def dial_between(key: str, low: float, high: float, whole: bool = False) -> Dial:
    """The dial with these ends, on the logarithm where they lie far apart."""
    return Dial(key, low, high, low > 0 and high / low >= WIDE, whole)


@dataclass(frozen=True)
class Threshold:
    """What is known of a break point, in shares of the dial. low, high: the central 95 % of the posterior. direction: +1
    where success falls with the level, -1 where it rises. beyond: chance that it lies outside the dial. success: expected
    in the middle of the dial. idle: the outcomes are at least as likely if the level does nothing. two_sided: a middle
    differs from both sides, which no one threshold explains. spread: standard deviation of it if slope and lapses were
    known (root mean square over what they may be), as more runs will make them."""

    middle: float
    low: float
    high: float
    slope: float
    lapse: float
    direction: int
    beyond: float
    success: float
    runs: int
    idle: bool
    two_sided: bool
    spread: float

    @property
    def found(self) -> bool:
        """Whether it rather lies within the dial."""
        return self.beyond < 0.5

    @property
    def runs_needed(self) -> int:
        """Runs after which nine of ten such searches are within CLOSE: the spread falls with the root of their number."""
        return math.ceil(self.runs * (1.645 * self.spread / CLOSE) ** 2)


class Posterior:
    """Chance of each curve, given the outcomes so far."""

    def __init__(self) -> None:
        threshold, slope, lapse, direction = np.meshgrid(THRESHOLDS, SLOPES, LAPSES, [1.0, -1.0], indexing="ij")
        self._shape = threshold.shape
        self._threshold, self._slope = threshold.ravel(), slope.ravel()
        self._lapse, self._direction = lapse.ravel(), direction.ravel()
        self._log = np.zeros(self._threshold.size)
        self._curves = self.success(LEVELS)
        self.tried: list[tuple[float, bool]] = []

    @property
    def runs(self) -> int:
        return len(self.tried)

    def success(self, levels: np.ndarray) -> np.ndarray:
        """(levels, curves) chance of success, kept away from 0 and 1 by what chance alone may do."""
        steep = self._direction * (np.asarray(levels, float)[:, None] - self._threshold) / self._slope
        steep += np.log1p(-2.0 * self._lapse)
        return np.clip((1.0 - self._lapse) / (1.0 + np.exp(np.clip(steep, -60.0, 60.0))), 1e-3, 1.0 - 1e-3)

    def learn(self, level: float, succeeded: bool) -> None:
        """One outcome at a level (share of the dial)."""
        chance = self.success(np.array([level]))[0]
        self._log += np.log(chance if succeeded else 1.0 - chance)
        self.tried.append((level, succeeded))

    def weights(self) -> np.ndarray:
        """Chance of each curve."""
        weight: np.ndarray = np.exp(self._log - self._log.max())
        return weight / weight.sum()

    def next_levels(self, count: int) -> list[float]:
        """Where to try next, `count` at a time: each is chosen as if those before had come out as is expected of them."""
        weight, chosen = self.weights(), list(FIRST[self.runs:self.runs + count])
        for _ in range(count - len(chosen)):
            information = self._information(weight)
            best = int(np.argmax(information))
            chosen.append(float(LEVELS[best]))
            curve = self._curves[best]
            expected = float(curve @ weight)
            weight = weight * curve**expected * (1.0 - curve) ** (1.0 - expected)
            weight = weight / weight.sum()
        return chosen

    def _information(self, weight: np.ndarray) -> np.ndarray:
        """(levels,) nats that an outcome at each level is expected to tell about the threshold."""
        per_threshold = weight.reshape(self._shape[0], -1)
        known = np.maximum(per_threshold.sum(axis=1), 1e-300)
        curves = self._curves.reshape(len(LEVELS), self._shape[0], -1)
        given = np.einsum("ltc,tc->lt", curves, per_threshold) / known
        return entropy(given @ known) - entropy(given) @ known

    def summary(self) -> Threshold:
        """The threshold as it is known now."""
        weight = self.weights()
        of_threshold = weight.reshape(self._shape[0], -1).sum(axis=1)
        low, middle, high = quantiles(of_threshold, [0.025, 0.5, 0.975])
        outside = float(of_threshold[(THRESHOLDS < 0.0) | (THRESHOLDS > 1.0)].sum())
        return Threshold(middle, low, high, float(np.exp(weight @ np.log(self._slope))),
                         float(weight @ self._lapse), 1 if weight @ self._direction >= 0 else -1, outside,
                         float(self._curves[len(LEVELS) // 2] @ weight), self.runs, self._idle(), two_sided(self.tried),
                         self._spread())

    def _spread(self) -> float:
        weight = self.weights().reshape(self._shape[0], -1)
        mean = THRESHOLDS @ weight / np.maximum(weight.sum(axis=0), 1e-300)
        return math.sqrt(float((weight * (THRESHOLDS[:, None] - mean) ** 2).sum()))

    def _idle(self) -> bool:
        """Whether the outcomes are as likely or more so by a constant chance of which nothing is known before."""
        from scipy.special import betaln

        done = sum(succeeded for _, succeeded in self.tried)
        largest = self._log.max()
        curve = largest + math.log(np.exp(self._log - largest).mean())
        return bool(curve - betaln(done + 1, self.runs - done + 1) <= 0.0)

    def curve(self, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(expected, lowest, highest) chance of success at each level; the bounds hold 95 % of the curves."""
        weight, curves = self.weights(), self.success(levels)
        order = np.argsort(curves, axis=1)
        sorted_curves = np.take_along_axis(curves, order, axis=1)
        heaped = np.cumsum(weight[order], axis=1)
        low, high = ((sorted_curves[np.arange(len(levels)), np.argmax(heaped >= share, axis=1)]) for share in (0.025, 0.975))
        return curves @ weight, low, high


def entropy(chance: np.ndarray) -> np.ndarray:
    """Nats of a coin with this chance."""
    rest = 1.0 - chance
    nats: np.ndarray = -(chance * np.log(chance) + rest * np.log(rest))
    return nats


def fit(levels: Sequence[float], succeeded: Sequence[bool]) -> Posterior:
    """The posterior of outcomes that were taken anywhere on the dial (shares of it), a sweep for instance."""
    known = Posterior()
    tried, at = np.unique(np.asarray(levels, float), return_inverse=True)
    done = np.bincount(at, np.asarray(succeeded, float), len(tried))
    curves = known.success(tried)
    known._log = done @ np.log(curves) + (np.bincount(at, minlength=len(tried)) - done) @ np.log(1.0 - curves)
    known.tried = list(zip(levels, succeeded, strict=True))
    return known


def two_sided(tried: Sequence[tuple[float, bool]]) -> bool:
    """Whether there are two levels between which runs succeed more often than on either side, or on both less often, by
    Fisher's exact test."""
    from scipy.stats import hypergeom

    levels, succeeded = np.array(tried, float).reshape(-1, 2).T
    for good in (succeeded, 1.0 - succeeded):
        _, at = np.unique(levels, return_inverse=True)
        runs, won = (np.append(0, np.cumsum(np.bincount(at, weight))).astype(int) for weight in (None, good))
        first, last = np.triu_indices(len(runs), 1)
        count, done = runs[last] - runs[first], won[last] - won[first]
        beside = ((runs[first], won[first]), (runs[-1] - runs[last], won[-1] - won[last]))
        chance = [hypergeom.sf(done - 1, count + more, done + also, count) for more, also in beside]
        if (np.maximum(*chance) < UNLIKE).any():
            return True
    return False


def between_seeds(levels: Sequence[float], succeeded: Sequence[bool], seeds: Sequence[int]) -> tuple[float, float]:
    """The central 95 % of the threshold where each seed was run at several levels; NaN for fewer than LEAST_SEEDS.

    What fails at one level with a seed mostly fails beyond it too, so such runs say less than as many independent ones:
    taken for those, an interval holds the threshold in 8 of 10 cases. Here the posteriors of samples of seeds drawn with
    replacement are averaged (the bagged posterior: Buehlmann 2014; Huggins and Miller 2023), which holds it in 9 of 10.
    """
    tried, at = np.unique(np.asarray(levels, float), return_inverse=True)
    names, whose = np.unique(np.asarray(seeds), return_inverse=True)
    if len(names) < LEAST_SEEDS:
        return math.nan, math.nan
    done, failed = (np.zeros((len(names), len(tried))) for _ in range(2))
    np.add.at(done, (whose, at), np.asarray(succeeded, bool))
    np.add.at(failed, (whose, at), ~np.asarray(succeeded, bool))
    drawn = np.random.default_rng(0).multinomial(len(names), np.full(len(names), 1.0 / len(names)), size=SAMPLES)
    curves = Posterior().success(tried)
    log = (drawn @ done) @ np.log(curves) + (drawn @ failed) @ np.log(1.0 - curves)
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    of_threshold = weight.reshape(SAMPLES, len(THRESHOLDS), -1).sum(axis=2)
    of_threshold /= of_threshold.sum(axis=1, keepdims=True)
    low, high = quantiles(of_threshold.mean(axis=0), [0.025, 0.975])
    return low, high


def quantiles(of_threshold: np.ndarray, shares: Sequence[float]) -> list[float]:
    """Levels below which these shares of the chance lie: that of each threshold is spread over its cell of the grid."""
    half = (THRESHOLDS[1] - THRESHOLDS[0]) / 2.0
    edges = np.append(THRESHOLDS - half, THRESHOLDS[-1] + half)
    return [float(level) for level in np.interp(shares, np.append(0.0, np.cumsum(of_threshold)), edges)]


def in_words(known: Threshold, dial: Dial) -> str:
    """`half fail at 7.1 (5.9 to 8.4)`, or that none or all do, without an interval where none is known; and what speaks
    against one threshold."""
    if known.found:
        side = "above" if known.direction > 0 else "below"
        ends = f" ({dial.text(known.low)} to {dial.text(known.high)})" if math.isfinite(known.low) else ""
        said = f"half fail at {dial.text(min(max(known.middle, 0.0), 1.0))}{ends}, more {side}"
    else:
        said = "fails nearly everywhere" if known.success < 0.5 else "does not break"
        said += f" from {dial.low:g} to {dial.high:g}"
        if known.beyond < 0.9:
            said += f" (chance of a threshold between: {1.0 - known.beyond:.0%})"
    if known.two_sided:
        return f"{said}; but the middle differs from both sides: not one threshold"
    return f"{said}; but as likely the dial does nothing" if known.found and known.idle else said
