"""Which of two is better, all else equal: paired differences, not two averages.

Two runs are a pair when everything agrees but what is compared: task, world, seed, every other part and every setting
(config.yaml of their folders), start, goal, scenario. Per pair of values and column: mean difference with its 95 %
interval, Wilcoxon's signed-rank test; the same difference over the pairs that both solved; and how often only one of the
two succeeded (McNemar's exact test). Pairs of one world (or one problem) are one unit of the interval and the tests where
there are several worlds (problems), and so are pairs that are equal for every seed. p values are corrected for the number
of comparisons (Holm 1979).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rhs.base.errors import ConfigError
from rhs.runfolder.row import CHOICES

from .intervals import LEAST, holm, least_p, legend, mean_interval, mean_text, signed_rank_p, units
from .observations import clusters, independent, judged, numbers
from .summary import check_columns, short
from .varied_settings import is_setting, settings_of

if TYPE_CHECKING:
    import pandas

PARTS = tuple(name for name in CHOICES if name not in ("task", "world"))
SIGNIFICANT = 0.05
Chosen = dict[str, object]


class Pairs(NamedTuple):
    """Row numbers of runs of the value a and of the value b that belong together, as (P,) arrays."""

    name: str
    a: np.ndarray
    b: np.ndarray


def compare(table: pandas.DataFrame, key: str, columns: Sequence[str] = (), *, cluster: str = "") -> pandas.DataFrame:
    """One row per pair of values of `key` (a part or a setting) and column; what must be said with it in attrs["notes"].

    Raises ConfigError when there is nothing to pair, or when a run has more than one partner."""
    import pandas as pd

    scored = judged(table)
    check_columns(scored, columns)
    found, alone = pairs(table, key)
    label = independent(table)
    rows = []
    for pair in found:
        _, same = np.unique(np.stack([label[pair.a], label[pair.b]]), axis=1, return_inverse=True)
        sample = clusters(table.iloc[pair.a].assign(independent_=same), cluster)  # worlds or problems, else results alike
        rows += [_row(scored, pair, column, sample) for column in columns]
    out = pd.DataFrame(rows)
    out["p"], out["least_p"] = holm(out["p"].to_numpy(float)), holm(out["least_p"].to_numpy(float))
    for column in columns:  # the same pairs whatever the column: corrected for the pairs alone
        own = (out["column"] == column).to_numpy()
        out.loc[own, "p_complete"] = holm(out.loc[own, "p_complete"].to_numpy(float))
    out.attrs["notes"] = _notes(out, key, alone, cluster)
    return out


def pairs(table: pandas.DataFrame, key: str) -> tuple[list[Pairs], int]:
    """The pairs for each two values of `key`, and how many runs have no partner at all."""
    choices = [_choices(table, index, key) for index in range(len(table))]
    if not any(key in one for one in choices):
        check_columns(table, [key])
    groups: dict[frozenset, dict[object, int]] = {}
    rest = [{name: value for name, value in one.items() if not _compared(name, key)} for one in choices]
    for index, one in enumerate(choices):
        if key not in one:
            continue
        members = groups.setdefault(frozenset(rest[index].items()), {})
        if one[key] in members:
            raise ConfigError(_not_unique(table, key, choices, members[one[key]], index))
        members[one[key]] = index
    values = sorted({value for members in groups.values() for value in members}, key=lambda v: (str(type(v)), v))
    out = []
    for a, b in combinations(values, 2):
        both = [(members[a], members[b]) for members in groups.values() if a in members and b in members]
        if both:
            out.append(Pairs(f"{_typed(a)} - {_typed(b)}", *np.array(both).T))
    if not out:
        raise ConfigError(_nothing_to_pair(key, choices, rest))
    return out, sum(len(members) == 1 for members in groups.values())


def _typed(value: object) -> str:
    """A value as it is typed."""
    return "null" if value is None else str(value)


def _choices(table: pandas.DataFrame, index: int, key: str) -> Chosen:
    """All that was chosen for a run: its configuration, and what the row says of it."""
    import pandas as pd

    row = table.iloc[index]
    named = [name for name in table.columns if name in (*CHOICES, "seed", key) or is_setting(name)]
    known = {name: getattr(row[name], "item", lambda value=row[name]: value)() for name in named if not pd.isna(row[name])}
    settings = {name.removesuffix(".name"): value for name, value in settings_of(str(table.index[index])).items()}
    return settings | known


def _compared(name: str, key: str) -> bool:
    """Whether a choice is the one that is compared: the key itself or, of a part, its own settings."""
    return name == key or (key in PARTS and name.startswith(f"{key}."))


def _not_unique(table: pandas.DataFrame, key: str, choices: list[Chosen], first: int, second: int) -> str:
    one, other = choices[first], choices[second]
    names = sorted(name for name in {**one, **other} if one.get(name) != other.get(name))
    if not names:
        return (f"two runs of {key}={one[key]} are the same run twice: {table.index[first]} and {table.index[second]}; give "
                f"the folder of one sweep")
    return (f"not a unique pair: runs of {key}={one[key]} differ in {', '.join(names[:3])} ({one.get(names[0])}, "
            f"{other.get(names[0])}); compare {names[0]}, or give a folder with one value of it")


def _nothing_to_pair(key: str, choices: list[Chosen], rest: list[Chosen]) -> str:
    """The complaint, with the choices in which the two likest runs of different values differ."""
    some = [index for index, one in enumerate(choices) if one.get(key) is not None][:100]
    differing = [sorted(name for name in {**rest[i], **rest[j]} if rest[i].get(name) != rest[j].get(name))
                 for i, j in combinations(some, 2) if choices[i][key] != choices[j][key]]
    likest = min(differing, key=len, default=[])
    also = f" (they differ in {', '.join(likest[:3])} too)" if likest else ""
    return f"no two runs differ in {key} alone{also}; sweep {key} over the same worlds and seeds"


def _row(scored: pandas.DataFrame, pair: Pairs, column: str, sample: np.ndarray) -> dict[str, object]:
    from scipy.stats import binomtest

    values, done = numbers(scored, column), scored["success"].to_numpy(float)
    difference = values[pair.a] - values[pair.b]
    known, solved = np.isfinite(difference), (done[pair.a] == 1.0) & (done[pair.b] == 1.0)
    one_each = units(difference[known], sample[known])
    low, high = mean_interval(one_each)
    won = _won(done[pair.a] - done[pair.b], sample)
    decided = int((won != 0.0).sum())
    return {
        "column": column, "difference": pair.name, "pairs": len(pair.a), "with_both": int(known.sum()),
        "units": len(one_each), "mean": float(one_each.mean()) if known.any() else np.nan, "low": low, "high": high,
        "p": signed_rank_p(one_each), "least_p": least_p(len(one_each)), "both_solved": int(solved.sum()),
        "mean_both_solved": mean_text(difference[solved], sample[solved]),
        "only_first_complete": int((done[pair.a] > done[pair.b]).sum()),
        "only_second_complete": int((done[pair.a] < done[pair.b]).sum()),
        "p_complete": float(binomtest(int((won > 0.0).sum()), decided).pvalue) if decided else 1.0,  # McNemar's, exact
    }


def _won(difference: np.ndarray, sample: np.ndarray) -> np.ndarray:
    """Per unit, which of the two succeeded more often: the sign of the sum of (P,) differences in success."""
    known = np.isfinite(difference)
    if not known.any():
        return np.empty(0)
    _, label = np.unique(sample[known], return_inverse=True)
    return np.sign(np.bincount(label, difference[known]))


def _notes(view: pandas.DataFrame, key: str, alone: int, cluster: str) -> list[str]:
    tests, differences = int(view["p"].notna().sum()), view["difference"].nunique()
    notes = [f"p: Wilcoxon's, corrected for {tests} comparisons (Holm); p_complete: McNemar's, corrected for {differences}"]
    if tests > 1:
        notes.append(f"low, high: 95 % of each of the {tests} comparisons alone, not corrected: where nothing differs one "
                     "in twenty leaves out 0")
    weak = view[view["least_p"] > SIGNIFICANT]
    if len(weak):
        first = weak.iloc[0]
        notes.append(f"too few to reach p < {SIGNIFICANT}: {len(weak)} of {len(view)} comparisons, for instance "
                     f"{first['difference']} on {first['column']}: n = {first['units']}, least possible corrected p "
                     f"{short(float(first['least_p']))}" + ("; fewer --columns help" if tests > differences else ""))
    if (view["units"] < view["with_both"]).any():
        notes.append(f"units: each {cluster or 'world (or problem)'} counts once, by the mean of its pairs, and so do pairs "
                     f"that are equal for every seed; --cluster run speaks of these worlds and problems alone")
    if (view["with_both"] > 0).any() and (view["units"] < LEAST).any():
        notes.append(f"no interval from fewer than {LEAST} units")
    if alone:
        notes.append(f"{alone} runs have no partner that differs in {key} alone; they are left out")
    return [*notes, *legend(" ".join(view["mean_both_solved"]), "units")]
