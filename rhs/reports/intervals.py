"""95 % intervals of means, shares and medians of few runs, and p values corrected for their number.

n independent values: Student's t interval of their mean; where all are positive, the hull of it and of Cox's interval of a
lognormal mean (Zhou and Gao 1997, with t quantiles), since t alone falls short for skewed figures (92 % for times that
spread by a factor of 1.6, 84 % by 2.7, three runs). Runs that share a world or a problem are not independent: `units` turns
them into their mean, and every world counts once, however many of its runs are known: weighed by their runs, as the
cluster-robust variance (Liang and Zeger 1986) has it, few worlds of unlike sizes hold the truth in 30 to 90 %.
Shares of runs: Clopper and Pearson's, with the effective number of runs (Korn and Graubard 1998). Medians: order statistics.
Coverage is shown by simulation in tests/reports/test_intervals.py.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache

import numpy as np

LEAST = 3  # fewer independent values have a range, not an interval
MOST_EXACT = 200  # differences of an exact signed-rank test: a hundredth of a second
WIDEST = 1.5  # standard deviation of logarithms; beyond it (a value next to zero) they say nothing about the mean
NAN = float("nan")
NONE = (NAN, NAN)


def units(values: np.ndarray, clusters: np.ndarray | None = None) -> np.ndarray:
    """(G,) values, the mean of each cluster of (N,) values."""
    values = np.asarray(values, float)
    if clusters is None or not len(values):
        return values
    _, label = np.unique(np.asarray(clusters), return_inverse=True)
    means: np.ndarray = np.bincount(label, values) / np.bincount(label)
    return means


def mean_interval(values: np.ndarray) -> tuple[float, float]:
    """95 % interval of the mean of (N,) independent values; NaN for fewer than three, or when all are equal."""
    values = np.asarray(values, float)
    if len(values) < LEAST or np.ptp(values) <= 1e-12 * np.abs(values).max():
        return NONE
    errors, mean = reach(len(values)), values.mean()
    half = errors * values.std(ddof=1) / math.sqrt(len(values))
    low, high = mean - half, mean + half
    logs = np.log(values) if (values > 0.0).all() else None
    if logs is not None and (variance := logs.var(ddof=1)) <= WIDEST**2:
        half = errors * math.sqrt(variance / len(values) + variance**2 / (2.0 * (len(values) + 1)))
        centre = logs.mean() + variance / 2.0
        low, high = min(low, math.exp(centre - half)), max(high, math.exp(centre + half))
    return float(low), float(high)


def share_interval(done: np.ndarray, clusters: np.ndarray | None = None) -> tuple[float, float]:
    """95 % interval of the share of (N,) runs that are true, or of the mean share of clusters; NaN for fewer than three."""
    from scipy.special import betaincinv  # what scipy.stats.beta asks; that takes a second to import

    done = np.asarray(done, float)
    groups = units(done, clusters)
    if len(groups) < LEAST:
        return NONE
    count, share = float(len(groups)), float(groups.mean())
    variance = groups.var(ddof=1) / len(groups)
    if len(groups) < len(done) and variance > 0.0:
        freedom = (reach(len(done)) / reach(len(groups))) ** 2
        count = min(float(len(done)), share * (1.0 - share) / variance * freedom)
    elif len(groups) == len(done):
        count = float(len(done))
    wins = share * count
    low = 0.0 if share == 0.0 else float(betaincinv(wins, count - wins + 1.0, 0.025))
    high = 1.0 if share == 1.0 else float(betaincinv(wins + 1.0, count - wins, 0.975))
    return low, high


@lru_cache
def reach(count: int) -> float:
    """Student's t: how many standard errors on either side hold the mean of `count` values with 95 %."""
    from scipy.special import stdtrit

    return float(stdtrit(count - 1, 0.975))


def interval_rank(count: int) -> int | None:
    """How many values may be cut off at either end so that the median of what `count` draws came from still lies between
    with at least 95 %; None when there are too few."""
    from scipy.special import bdtr

    tails = bdtr(np.arange(count // 2 + 1), count, 0.5)  # chance of so many below the median, or fewer
    return int(np.searchsorted(tails, 0.025, side="right")) - 1 if tails[0] <= 0.025 else None


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """The order statistics that hold the median with 95 % (sign test); NaN for fewer than six."""
    values = np.sort(np.asarray(values, float))
    rank = interval_rank(len(values))
    return NONE if rank is None else (float(values[rank]), float(values[-1 - rank]))


def holm(p: np.ndarray) -> np.ndarray:
    """p values corrected for their number by Holm's step-down rule (1979); NaN stays out of the count."""
    out = np.full(len(p), np.nan)
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known], kind="stable")]
    highest = 0.0
    for rank, index in enumerate(order):
        highest = max(highest, min(1.0, (len(order) - rank) * p[index]))
        out[index] = highest
    return out


def signed_rank_p(differences: np.ndarray) -> float:
    """Wilcoxon's signed-rank test of (N,) independent differences, two-sided; zeros say nothing. NaN without any. Exact up
    to MOST_EXACT, ties too: the chance of each sum of ranks when every sign falls by chance, one rank after another (scipy
    goes through all 2^N signs where there are ties, a second for 13, and from 14 on it does not)."""
    from scipy.stats import rankdata, wilcoxon

    moved = differences[np.abs(differences) > 0.0]
    if len(moved) <= 1:
        return 1.0 if len(differences) else NAN
    if len(moved) > MOST_EXACT:
        return float(wilcoxon(moved).pvalue)
    twice = np.rint(2.0 * rankdata(np.abs(moved))).astype(int)  # ranks of ties are halves
    chance, positive = np.ones(1), int(twice[moved > 0.0].sum())
    for rank in twice:
        chance = 0.5 * (np.pad(chance, (0, rank)) + np.pad(chance, (rank, 0)))
    return float(min(1.0, 2.0 * min(chance[:positive + 1].sum(), chance[positive:].sum())))


def least_p(count: int) -> float:
    """The least that a two-sided test of the signs of `count` differences can say: all point one way."""
    return min(1.0, 2.0 ** (1 - count)) if count else NAN


def mean_text(values: np.ndarray, clusters: np.ndarray | None = None) -> str:
    """`mean [low, high]` with its interval, `mean (low to high)` with the range of too few, `-` of nothing; NaN left out."""
    values = np.asarray(values, float)
    known = np.isfinite(values)
    one_each = units(values[known], None if clusters is None else np.asarray(clusters)[known])
    return _bracketed(values[known], float(one_each.mean()) if len(one_each) else math.nan, mean_interval(one_each))


def median_text(values: np.ndarray) -> str:
    """The same of the median."""
    values = np.asarray(values, float)
    values = values[np.isfinite(values)]
    return _bracketed(values, float(np.median(values)) if len(values) else math.nan, median_interval(values))


def share_text(done: np.ndarray, clusters: np.ndarray | None = None, *, factor: int = 1) -> str:
    """`share [low, high]` of (N,) of 0, 1 and NaN (not counted); times `factor` (100: in percent)."""
    done = np.asarray(done, float)
    known = np.isfinite(done)
    if not known.any():
        return "-"
    sample = None if clusters is None else np.asarray(clusters)[known]
    low, high = share_interval(done[known], sample)
    form = ".0f" if factor == 100 else ".2f"
    text = f"{factor * units(done[known], sample).mean():{form}}"
    return text if math.isnan(low) else f"{text} [{factor * low:{form}}, {factor * high:{form}}]"


def _bracketed(values: np.ndarray, middle: float, interval: tuple[float, float]) -> str:
    if not len(values):
        return "-"
    text = f"{middle:.4g}"
    if not math.isnan(interval[0]):
        return f"{text} [{interval[0]:.4g}, {interval[1]:.4g}]"
    low, high = f"{values.min():.4g}", f"{values.max():.4g}"
    return text if low == high else f"{text} ({low} to {high})"


def legend(text: str, over: str = "independent runs, or the worlds or problems of a line") -> list[str]:
    """What the brackets in a table mean, for those that stand in it."""
    notes = []
    if "[" in text:
        notes.append(f"[low, high]: 95 % interval over {over} (mean: t; share: Clopper-Pearson; median: ranks)")
    if re.search(r"\(\S+ to \S+\)", text):
        notes.append("(low to high): range of the runs, too few for an interval (mean: fewer than 3; median: fewer than 6)")
    return notes
