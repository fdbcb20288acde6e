"""The table of planning runs: per map and planner, success, validity, lengths, time, with n, failures and intervals.

Shares of runs have Wilson's 95 % interval; means have a bootstrapped one (rhs.summary), medians (of times) that of their
order statistics; both are over the runs that found a path, whose number stands beside them. A problem that one planner
fails stays in every other planner's row. The thesis's table 3.1 stands beside ours where it has a figure: it counts cells
of 0.1 m, evidently steps for the potential field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from rhs.api.files import replacing

from .summary import bootstrap, mean_text, wilson

if TYPE_CHECKING:
    import pandas

# map -> planner -> distance in cells, seconds in 2014 MATLAB, success in percent; mean of ten runs (thesis, table 3.1)
THESIS = {
    "map1": {"potential_field": (1414.0, 4.2, 100), "rrt": (328.3, 4.8, 100), "prm": (280.0, 18.68, 50)},
    "map2": {"potential_field": (80.0, 0.18, 100), "rrt": (143.99, 0.58, 100), "prm": (105.6, 34.35, 100)},
    "map3": {"potential_field": (121.0, 0.23, 100), "rrt": (161.74, 0.36, 100), "prm": (135.5, 38.36, 100)},
    "map4": {"potential_field": (108.0, 0.34, 100), "rrt": (161.63, 4.9, 100), "prm": (137.0, 15.1, 10)},
}
FIRST = ("potential_field", "rrt", "prm", "rrt_connect")  # the thesis's planners first, then the others by name


def planning_rows(table: pandas.DataFrame) -> pandas.DataFrame:
    """The rows of the planning task."""
    if "plan_success" not in table.columns:
        return table.iloc[:0]
    return table[table["plan_success"].notna() | (table.get("task", "") == "planning")]


def order(names: Sequence[str]) -> list[str]:
    """Planners as they stand in tables and pictures."""
    found = set(names)
    return [name for name in FIRST if name in found] + sorted(found - set(FIRST))


def planning_table(table: pandas.DataFrame) -> pandas.DataFrame:
    """One row per world and planner, from rows of rhs.table."""
    import pandas as pd

    rows = planning_rows(table)
    out = []
    for world in sorted(rows["world"].dropna().unique()):
        for planner in order(rows.loc[rows["world"] == world, "planner"].dropna().unique()):
            out.append(_line(world, planner, rows[(rows["world"] == world) & (rows["planner"] == planner)]))
    return pd.DataFrame(out)


def _line(world: str, planner: str, part: pandas.DataFrame) -> dict[str, object]:
    number = _column(part, "plan_success")
    found = np.nan_to_num(number) == 1.0
    valid = _column(part, "plan_valid")[found] == 1.0
    low, high = wilson(int(found.sum()), len(part))
    cells = 1.0 / _column(part, "map_resolution_m")
    walk = "plan_walk_steps" if "plan_walk_steps" in part and part["plan_walk_steps"].notna().any() else "plan_steps_raw"
    line: dict[str, object] = {
        "map": world, "planner": planner, "n": len(part), "failed": int(len(part) - found.sum()),
        "success %": f"{100 * found.mean():.0f} [{100 * low:.0f}, {100 * high:.0f}]",
        "valid %": f"{100 * valid.mean():.0f}" if len(valid) else "-",
        "steps": mean_text(_column(part, walk)[found]),
        "raw, cells": mean_text((_column(part, "plan_length_raw_m") * cells)[found]),
        "length, cells": mean_text((_column(part, "plan_length_m") * cells)[found]),
        "optimum, cells": _least(_column(part, "plan_optimal_m") * cells),
        "above optimum %": mean_text(np.round(_column(part, "plan_above_optimum_pct")[found], 3)),
        "clearance, cells": _mean(np.round(_column(part, "plan_clearance_min_m") * cells, 3)[found]),
        "smoothness, 1/m2": _mean(_column(part, "plan_smoothness")[found]),
        "learn ms": _median(_column(part, "plan_learn_ms")[found]),
        "plan ms": _median(_column(part, "plan_ms")[found]),
        "again ms": _median(_column(part, "plan_again_ms")[found]),
        "classes": _shares(part["homotopy"].fillna("") if "homotopy" in part else []),
        "reasons": _shares(part.loc[~found, "plan_reason"].fillna(part.loc[~found, "status"])),
    }
    distance, seconds, success = THESIS.get(world, {}).get(planner, (np.nan,) * 3)
    told = {"thesis cells": f"{distance:g}", "thesis s": f"{seconds:g}", "thesis success %": f"{success:g}"}
    return line | {key: "" if value == "nan" else value for key, value in told.items()}


def as_markdown(table: pandas.DataFrame) -> str:
    """A table for a README."""
    rows = [list(map(str, table.columns)), ["---"] * len(table.columns)]
    rows += [[str(value).replace("|", "/") for value in row] for row in table.itertuples(index=False, name=None)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def publish(table: pandas.DataFrame, folder: FilePath) -> list[FilePath]:
    """planning_table.csv and .md, panel.png, and bars of length and time, from the rows of a sweep; the files written."""
    from .planning_pictures import panel

    rows = planning_rows(table)
    summary = planning_table(rows)
    for name, text in (("planning_table.csv", summary.to_csv(index=False)), ("planning_table.md", as_markdown(summary))):
        with replacing(folder / name) as file:
            file.write(text)
    worlds, planners = sorted(rows["world"].unique()), order(rows["planner"].unique())
    runs: dict[tuple[str, str], FilePath] = {}
    for run, world, planner in sorted(zip(rows.index, rows["world"], rows["planner"], strict=True)):
        if (FilePath(run) / "plan.json").is_file():
            runs.setdefault((world, planner), FilePath(run))
    written = [folder / "planning_table.csv", folder / "planning_table.md"]
    if len(worlds) <= 12:
        written.append(panel(runs, worlds, planners, folder / "panel.png"))
        written += draw_bars(rows, folder)
    return written


def draw_bars(rows: pandas.DataFrame, folder: FilePath) -> list[FilePath]:
    """bars_COLUMN.png of lengths and times into an existing folder, from planning rows."""
    from .planning_pictures import bars

    worlds, planners, title = sorted(rows["world"].unique()), order(rows["planner"].unique()), _told(planning_table(rows))
    written = []
    for column, label, log in (("plan_length_raw_m", "raw length [m]", False), ("plan_length_m", "length [m]", False),
                               ("plan_above_optimum_pct", "above the optimum [%]", False),
                               ("plan_ms", "planning time [CPU ms]", True)):
        groups = [_bar(rows, world, planner, column) for world in worlds for planner in planners]
        written.append(bars(groups, label, folder / f"bars_{column}.png", title=title, log=log))
    return written


def _told(summary: pandas.DataFrame) -> str:
    """What the bars stand for, and who failed how often."""
    least, most = summary["n"].min(), summary["n"].max()
    failed = [f"{row['planner']} on {row['map']} {row['failed']}" for _, row in summary.iterrows() if row["failed"]]
    runs = f"{most}" if least == most else f"{least} to {most}"
    return (f"bar: mean of the paths found, line: its 95 % interval; {runs} runs a bar; failed: "
            + (", ".join(failed[:6]) + (", ..." if len(failed) > 6 else "") if failed else "none"))


def _bar(rows: pandas.DataFrame, world: str, planner: str, column: str) -> tuple[str, str, float, float, float]:
    part = rows[(rows["world"] == world) & (rows["planner"] == planner) & (rows["plan_success"] == 1)]
    values = _column(part, column)
    values = values[np.isfinite(values)]
    low, high = bootstrap(values)
    return world, planner, float(values.mean()) if len(values) else float("nan"), low, high


def _column(part: pandas.DataFrame, name: str) -> np.ndarray:
    if name not in part.columns:
        return np.full(len(part), np.nan)
    return part[name].astype("float64").to_numpy()


def _mean(values: np.ndarray) -> str:
    return mean_text(values[~np.isnan(values)])


def _median(values: np.ndarray) -> str:
    """`median [low, high]`: from six runs on, the order statistics that hold it with 95 % (sign test)."""
    values = np.sort(values[np.isfinite(values)])
    if not len(values):
        return "-"
    rank = interval_rank(len(values))
    text = f"{np.median(values):.3g}"
    return text if rank is None else f"{text} [{values[rank]:.3g}, {values[-1 - rank]:.3g}]"


def interval_rank(count: int) -> int | None:
    """How many values may be cut off at either end so that the median of what `count` draws came from still lies between
    with at least 95 %; None when there are too few."""
    tail, rank = 0.0, 0
    while (tail := tail + math.comb(count, rank) / 2.0**count) <= 0.025:
        rank += 1
    return rank - 1 if rank else None


def _least(values: np.ndarray) -> str:
    values = values[np.isfinite(values)]
    return f"{values.min():.2f}" if len(values) else "-"


def _shares(words: Sequence[str]) -> str:
    """`left 3, right 7`, most frequent first."""
    from collections import Counter

    counts = Counter(str(word) for word in words if str(word))
    return ", ".join(f"{word} {count}" for word, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])))
