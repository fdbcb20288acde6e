"""Worse, no worse, better, or undecided: paired runs looked at several times on the way.

The measure is compared by the logarithm of its ratio, new over old, pair by pair: t-intervals of its mean, each look with
its part of the error: the parts add up to 5 %, which holds whenever one stops, and grow with the square of the pairs, as the
bounds of O'Brien and Fleming (1979) do: early looks are for large differences. A loss is called worse where it is sure and
seems to be above the margin, so that one which is allowed seldom is. Lost successes are counted apart, by the exact test of
McNemar on the pairs that differ; where no pair has the measure, won ones are too. No worse is said only where so many
successes as are not allowed cannot be lost either: lost less won ones, by the intervals of Clopper and Pearson (1934) of
both, which few pairs do not give, though none be lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEAST_PAIRS = 4
ERROR = 0.05  # of all looks together
ROUNDING = 1e-9  # of a ratio: sums in another order
LOST = 0.2  # share of all runs whose lost successes are still no worse: what 20 pairs of which none is lost can tell
MOST_PAIRS = 100_000


@dataclass(frozen=True)
class Verdict:
    """word: `worse`, `better`, `no worse` or `needs more runs`. change, low, high: of the measure, shares (0.1: 10 % more).
    pairs: with a value in both. lost, won: successes that only the old, only the new runs had. needed: pairs that would
    settle it, if it goes on like this. lost_at_most: share of all runs that loses its success, less those that win one, at
    most, with the certainty of this look."""

    word: str
    change: float
    low: float
    high: float
    pairs: int
    lost: int
    won: int
    needed: int
    lost_at_most: float

    @property
    def exit_code(self) -> int:
        """0: better or no worse; 1: worse; 3: undecided."""
        return {"worse": 1, "needs more runs": 3}.get(self.word, 0)


def looks(pairs: int) -> list[int]:
    """After how many pairs to look: 4, 6, 9, 14, ... and at the end."""
    found, at = [], float(LEAST_PAIRS)
    while at < pairs:
        found.append(round(at))
        at *= 1.5
    return [*found, pairs]


def error_parts(looks: Sequence[int]) -> list[float]:
    """The part of the error that each look may spend."""
    whole = sum(count**2 for count in looks)
    return [ERROR * count**2 / whole for count in looks]


def judge(old: Sequence[float], new: Sequence[float], won: Sequence[tuple[bool, bool]], *, margin: float,
          level: float = ERROR, more_is_better: bool = False, lost_margin: float = LOST) -> Verdict:
    """What these pairs say, wrong in `level` of cases. old, new: the measure, NaN where a run has none. won: (old, new)
    successes of all pairs. margin: a loss of this share is still no worse; lost_margin: of so many successes, as a share of
    all runs. more_is_better: of the measure, else less is."""
    from scipy.stats import binomtest, t

    lost = sum(before and not after for before, after in won)
    gained = sum(after and not before for before, after in won)
    known = [(a, b) for a, b in zip(old, new, strict=True) if 0 < a < math.inf and 0 < b < math.inf]  # NaN is neither
    worse = -1.0 if more_is_better else 1.0
    ratio = worse * np.array([math.log(b / a) for a, b in known])
    ratio[np.abs(ratio) < ROUNDING] = 0.0
    n = len(ratio)
    middle = float(ratio.mean()) if n else math.nan
    half = math.inf
    if n >= LEAST_PAIRS:
        half = float(t.ppf(1.0 - level / 2.0, n - 1) * ratio.std(ddof=1) / math.sqrt(n))
    low, high = (middle - half, middle + half) if n else (-math.inf, math.inf)
    differ, lost_at_most = lost + gained, most_lost(lost, gained, len(won), level)
    fewer, more = (differ > 0 and binomtest(k, differ, 0.5, alternative="greater").pvalue < level for k in (lost, gained))
    needed, allowed = 0, -math.log(max(1.0 - margin, 1e-9)) if more_is_better else math.log1p(margin)
    if fewer or (low > 0.0 and middle > allowed):
        word = "worse"
    elif (high < 0.0 and lost <= gained) or (n == 0 and more):
        word = "better"
    elif high <= allowed and lost <= gained and lost_at_most <= lost_margin:
        word = "no worse"
    else:
        word = "needs more runs"
        room = allowed - middle if middle < allowed else middle
        whole = len(won)
        needed = whole + 1 if half is math.inf or room <= 0 else max(whole + 1, math.ceil(whole * (half / room) ** 2))
        if middle < allowed and lost <= gained:
            needed = max(needed, pairs_for(lost / whole, gained / whole, level, lost_margin))
        needed = 0 if n == differ == 0 else needed  # both fail in all: no number of such pairs would
    change, *ends = (math.expm1(min(worse * value, 50.0)) for value in (middle, low, high))
    least, most = sorted(ends)
    return Verdict(word, change, least, most, n, lost, gained, needed, lost_at_most)


def most_lost(lost: float, won: float, pairs: int, level: float) -> float:
    """The share of all runs that loses its success less that which wins one, at most: wrong in `level` of cases, whatever
    the shares are (Bonferroni's half for each of two one-sided intervals of Clopper and Pearson)."""
    from scipy.stats import beta

    upper = float(beta.ppf(1.0 - level / 2.0, lost + 1.0, pairs - lost)) if lost < pairs else 1.0
    return upper - (float(beta.ppf(level / 2.0, won, pairs - won + 1.0)) if won else 0.0)


def pairs_for(lost: float, won: float, level: float, margin: float) -> int:
    """How many pairs tell that no more than `margin` are lost, where these shares are."""
    pairs = LEAST_PAIRS
    while most_lost(lost * pairs, won * pairs, pairs, level) > margin and pairs < MOST_PAIRS:
        pairs += max(pairs // 50, 1)
    return pairs
