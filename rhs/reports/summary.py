"""What a table says: per group, how many runs, how many failed, means with 95 % intervals (level 5).

Intervals of means are percentile bootstraps (2,000 draws, fixed generator); of shares of runs, Wilson's. Means are over
the runs that have the number; `failed` stands beside them, since a mean over successes alone flatters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rhs.base.errors import ConfigError
from rhs.runfolder.row import KEYS

if TYPE_CHECKING:
    import pandas

SHOWN = ("places_visited", "collisions", "ate_rmse_m", "rpe_trans_m", "end_error_m", "tracked_share", "map_agreement",
         "path_length_m", "kidnap_recovered_share", "kidnap_wrong_sure_share",
         "plan_length_m", "plan_above_optimum_pct", "odometry_ms", "real_time_factor")
DRAWS = 2000


def wilson(successes: int, count: int, z: float = 1.959964) -> tuple[float, float]:
    """95 % interval of a proportion (Wilson 1927): right also at 0 of n and n of n."""
    if count == 0:
        return 0.0, 1.0
    p = successes / count
    centre = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * np.sqrt(p * (1 - p) / count + z * z / (4 * count**2)) / (1 + z * z / count)
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))


def bootstrap(values: np.ndarray, draws: int = DRAWS) -> tuple[float, float]:
    """95 % percentile interval of the mean of (N,) values; NaN for fewer than two."""
    values = np.asarray(values, float)
    if len(values) < 2:
        return float("nan"), float("nan")
    picks = np.random.default_rng(0).integers(0, len(values), (draws, len(values)))
    low, high = np.percentile(values[picks].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def complete(table: pandas.DataFrame) -> np.ndarray:
    """(N,) bool: the run ended well, visited every place it was sent to, and found the path it was asked for."""
    visited = table["places_visited"].astype("float64").fillna(0).to_numpy()
    wanted = table["places_total"].astype("float64").fillna(0).to_numpy()
    if "task" in table:  # a survey is sent to no place
        wanted = np.where(table["task"].fillna("").to_numpy() == "survey", 0, wanted)
    planned = table["plan_success"].astype("float64").fillna(1).to_numpy() if "plan_success" in table else 1.0
    return (table["status"].fillna("").to_numpy() == "ok") & (visited >= wanted) & (planned == 1.0)


def summarise(table: pandas.DataFrame, *, group: Sequence[str] = (), columns: Sequence[str] = ()) -> pandas.DataFrame:
    """One row per group: runs, failed, share complete with interval, then each column's mean and interval."""
    import pandas as pd

    check_columns(table, [*group, *columns])
    by = list(group) or _swept(table)
    wanted = list(columns) or [name for name in SHOWN if name in table.columns and table[name].notna().any()]
    wanted = [name for name in wanted if pd.api.types.is_numeric_dtype(table[name])]
    parts = [((), table)] if not by else list(table.groupby(by, dropna=False, sort=True))
    out = []
    for key, part in parts:
        out.append(dict(zip(by, key, strict=False)) | _group_row(part, wanted))
    return pd.DataFrame(out)


def _swept(table: pandas.DataFrame) -> list[str]:
    """The columns in which the runs were made to differ: parts first, then settings that differ with the same parts too
    (two parts may have a setting of one name, with other defaults)."""
    parts = [name for name in KEYS[:-1] if table[name].nunique(dropna=False) > 1]
    same_parts = table.groupby(parts, dropna=False) if parts else table.groupby(np.zeros(len(table)))
    settings = [name for name in table.columns if "." in name and (same_parts[name].nunique(dropna=False) > 1).any()]
    return parts + settings


def _group_row(part: pandas.DataFrame, wanted: Sequence[str]) -> dict[str, object]:
    good = int(complete(part).sum())
    low, high = wilson(good, len(part))
    row: dict[str, object] = {"runs": len(part), "failed": int((part["status"].fillna("") != "ok").sum()),
                              "complete": f"{good / len(part):.2f} [{low:.2f}, {high:.2f}]"}
    for name in wanted:
        values = part[name].astype("float64").dropna().to_numpy()
        row[name] = mean_text(values)
    return row


def mean_text(values: np.ndarray) -> str:
    """`mean [low, high]`, or `-` of nothing."""
    if not len(values):
        return "-"
    low, high = bootstrap(values)
    return f"{np.mean(values):.4g}" + ("" if np.isnan(low) else f" [{low:.4g}, {high:.4g}]")


def listing(table: pandas.DataFrame, columns: Sequence[str]) -> pandas.DataFrame:
    """Every run with the chosen columns, or with the ones that say most."""
    check_columns(table, columns)
    names = list(columns) or ["status", *KEYS, *(n for n in SHOWN if n in table.columns)]
    return table[names].reset_index()


def check_columns(table: pandas.DataFrame, names: Sequence[str]) -> None:
    """Refuse a column that the table lacks, with those it has that look alike."""
    from difflib import get_close_matches

    for name in names:
        if name not in table.columns:
            near = get_close_matches(name, list(table.columns), n=3)
            raise ConfigError(f"no column {name!r}; " + (f"did you mean {' or '.join(near)}?" if near else
                              f"there are {', '.join(table.columns[:12])}, ..."))


def as_text(view: pandas.DataFrame) -> str:
    """Columns of words for a terminal."""
    cells = [[short(value) for value in row] for row in view.itertuples(index=False, name=None)]
    names = [str(name) for name in view.columns]
    widths = [max([len(name), *(len(row[i]) for row in cells)]) for i, name in enumerate(names)]
    lines = ["  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip()
             for row in [names, *cells]]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def short(value: object) -> str:
    """A value as a table shows it: four digits, `-` for unknown, one line."""
    if value is None or str(value) in ("<NA>", "nan"):
        return "-"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text.replace("\n", " ")[:60]
