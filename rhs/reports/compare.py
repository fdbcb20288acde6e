"""Which of two is better, on the same worlds and seeds: paired differences, not two averages.

Per pair of values (two planners, two odometries, ...) and column: mean difference with its 95 % bootstrap interval,
Wilcoxon's signed-rank test; and, since a mean over successes alone flatters, how often only one of the two completed its
run (McNemar's exact test). p values are corrected for the number of comparisons (Holm 1979).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from rhs.base.errors import ConfigError
from rhs.runfolder.row import KEYS

from .summary import bootstrap, check_columns, complete

if TYPE_CHECKING:
    import pandas


def compare(table: pandas.DataFrame, key: str, columns: Sequence[str]) -> pandas.DataFrame:
    """One row per pair of values of `key` and column. Raises ConfigError when there is nothing to pair."""
    import pandas as pd

    check_columns(table, [key, *columns])
    others = [name for name in KEYS if name != key]
    marked = table.assign(complete_=complete(table))
    values = sorted(marked[key].dropna().unique())
    rows = []
    for a, b in combinations(values, 2):
        both = marked[marked[key] == a].merge(marked[marked[key] == b], on=others, suffixes=(" a", " b"))
        rows += [_row(both, column, f"{a} - {b}") for column in columns] if len(both) else []
    if not rows:
        raise ConfigError(f"no two runs differ in {key} alone; sweep {key} over the same worlds and seeds")
    out = pd.DataFrame(rows)
    out["p"] = holm(out["p"].to_numpy(float))
    for column in columns:  # the same pairs whatever the column: corrected for the pairs alone
        own = (out["column"] == column).to_numpy()
        out.loc[own, "p_complete"] = holm(out.loc[own, "p_complete"].to_numpy(float))
    return out


def _row(both: pandas.DataFrame, column: str, name: str) -> dict[str, object]:
    from scipy.stats import binomtest, wilcoxon

    done = both["complete_ a"].to_numpy(bool), both["complete_ b"].to_numpy(bool)
    only_a, only_b = int((done[0] & ~done[1]).sum()), int((~done[0] & done[1]).sum())
    difference = (both[f"{column} a"].astype("float64") - both[f"{column} b"].astype("float64")).dropna().to_numpy()
    low, high = bootstrap(difference)
    moved = difference[difference != 0.0]
    return {
        "column": column, "difference": name, "pairs": len(both), "with_both": len(difference),
        "mean": float(difference.mean()) if len(difference) else np.nan, "low": low, "high": high,
        "p": float(wilcoxon(moved).pvalue) if len(moved) > 1 else 1.0 if len(difference) else np.nan,
        "only_first_complete": only_a, "only_second_complete": only_b,
        "p_complete": float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0,
    }


def holm(p: np.ndarray) -> np.ndarray:
    """p values corrected for their number by Holm's step-down rule; NaN stays out of the count."""
    out = np.full(len(p), np.nan)
    known = np.flatnonzero(np.isfinite(p))
    order = known[np.argsort(p[known], kind="stable")]
    highest = 0.0
    for rank, index in enumerate(order):
        highest = max(highest, min(1.0, (len(order) - rank) * p[index]))
        out[index] = highest
    return out
