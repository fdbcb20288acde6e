"""The break point that a plain sweep over a numeric setting shows: the fit of rhs.metrics.threshold to its successes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rhs.metrics.threshold import LEAST_SEEDS, between_seeds, dial_between, fit, in_words
from rhs.runfolder.row import CHOICES

if TYPE_CHECKING:
    import pandas

LEAST_LEVELS = 4


def thresholds(table: pandas.DataFrame) -> list[str]:
    """One line for each numeric setting that the runs vary over four levels and more, and each combination of parts in which
    some succeeded and some failed."""
    import pandas

    lines = []
    settings = [name for name in table.columns if "." in name and pandas.api.types.is_numeric_dtype(table[name])
                and not pandas.api.types.is_bool_dtype(table[name]) and table[name].nunique() >= LEAST_LEVELS]
    for setting in settings:
        known = table[table[setting].notna() & table["success"].notna()]
        dial = dial_between(setting, float(known[setting].min()), float(known[setting].max()))
        for name, part in _groups(known, setting):
            success = part["success"].astype(float) == 1.0
            if success.nunique() == 2:
                levels, seeds = [dial.level(float(value)) for value in part[setting]], list(part["seed"])
                found, runs = fit(levels, list(success)).summary(), f"{len(seeds)} runs"
                if len(set(seeds)) < len(seeds):
                    low, high = between_seeds(levels, list(success), seeds)
                    found, runs = replace(found, low=low, high=high), f"{runs} of {_counted(seeds)}"
                lines.append(f"{name}{setting}: {in_words(found, dial)} ({runs})")
    return lines


def _counted(seeds: Sequence[int]) -> str:
    """How many seeds, and whether they are too few for an interval."""
    count = len(set(seeds))
    return f"{count} seed{'s' * (count > 1)}" + (", too few for an interval" if count < LEAST_SEEDS else "")


def _groups(table: pandas.DataFrame, setting: str) -> Iterator[tuple[str, pandas.DataFrame]]:
    """The rows of each combination of parts, worlds and other settings; seeds together."""
    keys = [name for name in table.columns if (name in CHOICES or "." in name) and name != setting
            and table[name].nunique(dropna=False) > 1]
    if not keys:
        yield "", table
        return
    for values, part in table.groupby(keys, dropna=False, sort=True):
        yield f"{' '.join(map(str, values))}: ", part
