"""The table of planning runs: per map, problem and planner, success, lengths, time, with n, failures and intervals.

A problem is a start, a goal or a scenario, where a map has several; those of a MovingAI file stand by bucket (of four cells
of octile optimum). Success is a path that was found and is valid; figures are over those. What the planners' failures do to
a mean over successes is told by three scores: SPL and PAR-2 (rhs.reports.observations) and, where a line holds several
problems, the length above the optimum on those that every planner solved. Runs that are equal for every seed count once.
The thesis's table 3.1 stands beside ours where it has a figure: it counts cells of 0.1 m, evidently steps for the potential
field.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .export import as_markdown, write_text
from .intervals import legend, mean_interval, mean_text, median_text, share_text, units
from .observations import QUESTION, clusters, failures_told, independent, judged, numbers, planned, problems, reasons
from .varied_settings import is_setting

if TYPE_CHECKING:
    import pandas

# map -> planner -> distance in cells, seconds in 2014 MATLAB, success in percent; mean of ten runs (thesis, table 3.1)
THESIS = {
    "map1": {"potential_field": (1414.0, 4.2, 100), "rrt": (328.3, 4.8, 100), "prm": (280.0, 18.68, 50)},
    "map2": {"potential_field": (80.0, 0.18, 100), "rrt": (143.99, 0.58, 100), "prm": (105.6, 34.35, 100)},
    "map3": {"potential_field": (121.0, 0.23, 100), "rrt": (161.74, 0.36, 100), "prm": (135.5, 38.36, 100)},
    "map4": {"potential_field": (108.0, 0.34, 100), "rrt": (161.63, 4.9, 100), "prm": (137.0, 15.1, 10)},
}
TIMES = ("plan_learn_ms", "plan_ms", "plan_again_ms")
MOST_BARS = 12  # maps or problems in one picture
FIRST = ("potential_field", "rrt", "prm", "rrt_connect")  # the thesis's planners first, then the others by name


def planning_rows(table: pandas.DataFrame) -> pandas.DataFrame:
    """The rows of the planning task."""
    return table[planned(table)]


def order(names: Sequence[str]) -> list[str]:
    """Planners as they stand in tables and pictures."""
    found = set(names)
    return [name for name in FIRST if name in found] + sorted(found - set(FIRST))


class Group(NamedTuple):
    """The runs of one line: rows judged, with the columns independent_, reason_, problem_ and, of failures too, plan_ms_."""

    place: str
    problem: str
    planner: str
    settings: str
    rows: pandas.DataFrame

    @property
    def where(self) -> str:
        return f"{self.place} {self.problem}".strip()

    @property
    def who(self) -> str:
        return f"{self.planner} {self.settings}".strip()


def groups(table: pandas.DataFrame) -> Iterator[Group]:
    """The lines of the table, from rows of rhs.table: by map, problem or bucket, planner, and settings that were varied."""
    rows = planning_rows(table)
    took = {f"{name}_": numbers(rows, name) for name in TIMES}  # of failures too
    rows = judged(rows).assign(independent_=independent(rows), reason_=reasons(rows), problem_=problems(rows), **took)
    rows = rows.assign(line_=problem_lines(rows), settings_=_varied(rows))
    for world in sorted(rows["world"].dropna().unique()):
        here = rows[rows["world"] == world]
        for problem in sorted(here["line_"].unique(), key=_natural):
            one = here[here["line_"] == problem]
            for planner in order(one["planner"].dropna().unique()):
                mine = one[one["planner"] == planner]
                for settings in sorted(mine["settings_"].unique(), key=_natural):
                    yield Group(world, problem, planner, settings, mine[mine["settings_"] == settings])


def problem_lines(rows: pandas.DataFrame) -> np.ndarray:
    """(N,) words for the problem as it stands in a line: the bucket of a MovingAI problem where there are several."""
    asked = problems(rows)
    bucket = numbers(rows, "bucket")
    return np.array([f"bucket {k:.0f}" if words and np.isfinite(k) else words
                     for words, k in zip(asked, bucket, strict=True)], dtype=object)


def _varied(rows: pandas.DataFrame) -> np.ndarray:
    """(N,) words for the settings in which runs of the same planner differ, the question apart."""
    names = [name for name in rows.columns if is_setting(name) and name not in QUESTION]
    names = [name for name in names if (rows.groupby("planner")[name].nunique(dropna=False) > 1).any()]
    return np.array([", ".join(f"{name.removeprefix('planner.').removeprefix('planning.')}={value}" for name, value in
                               zip(names, values, strict=True) if str(value) not in ("<NA>", "nan", "None"))
                     for values in rows[names].itertuples(index=False, name=None)], dtype=object)


def _natural(text: str) -> list:
    """Sort key in which bucket 10 follows bucket 9."""
    return [(1, float(word), "") if word.replace(".", "", 1).isdigit() else (0, 0.0, word)
            for word in text.replace("=", " ").split()]


def planning_table(table: pandas.DataFrame) -> pandas.DataFrame:
    """One row per world, problem or bucket, and planner, from rows of rhs.table; what brackets mean in attrs["notes"]."""
    import pandas as pd

    found = list(groups(table))
    by_all = _solved_by_all(found)
    several = any(group.rows["problem_"].nunique() > 1 for group in found)
    view = pd.DataFrame([_line(group, by_all if several else None) for group in found])
    for name in ("problem", "settings"):
        if name in view and not view[name].astype(bool).any():
            view = view.drop(columns=name)
    rows = planning_rows(table)
    repeated = len(view) and (view["independent"] < view["n"]).any()
    view.attrs["notes"] = [*legend(" ".join(map(str, view.to_numpy().ravel()))),
                           *(["independent: runs that are equal for every seed count once"] if repeated else []),
                           "SPL and PAR-2 count failures (PAR-2: twice the longest time of any run of the problem)",
                           failures_told(rows)]
    return view


def _solved_by_all(found: Sequence[Group]) -> set[tuple[str, str]]:
    """(world, problem) that every planner that was asked solved in at least one run."""
    solved: dict[tuple[str, str], set[str]] = {}
    asked: dict[tuple[str, str], set[str]] = {}
    for group in found:
        for problem, done in zip(group.rows["problem_"], group.rows["success"], strict=True):
            asked.setdefault((group.place, problem), set()).add(group.who)
            if done == 1.0:
                solved.setdefault((group.place, problem), set()).add(group.who)
    return {key for key, who in asked.items() if solved.get(key) == who}


def _line(group: Group, by_all: set[tuple[str, str]] | None) -> dict[str, object]:
    part = group.rows
    sample = clusters(part)
    cells = 1.0 / numbers(part, "map_resolution_m")
    walk = "plan_walk_steps" if "plan_walk_steps" in part and part["plan_walk_steps"].notna().any() else "plan_steps_raw"
    found = part["success"].to_numpy(float) == 1.0
    above = np.round(numbers(part, "plan_above_optimum_pct"), 3)
    line: dict[str, object] = {
        "map": group.place, "problem": group.problem, "planner": group.planner, "settings": group.settings, "n": len(part),
        "failed": int((part["success"] == 0.0).sum()), "independent": part["independent_"].nunique(),
        "success %": share_text(part["success"].to_numpy(float), sample, factor=100),
        "invalid": int((part["reason_"] == "invalid path").sum()),
        "steps": mean_text(numbers(part, walk), sample),
        "raw, cells": mean_text(numbers(part, "plan_length_raw_m") * cells, sample),
        "length, cells": mean_text(numbers(part, "plan_length_m") * cells, sample),
        "optimum, cells": _span(numbers(part, "plan_optimal_m") * cells),
        "above optimum %": mean_text(above, sample),
    }
    if by_all is not None:
        common = np.array([(group.place, problem) in by_all for problem in part["problem_"]], bool)
        line["solved by all"] = len(set(part["problem_"][common]))
        line["above optimum %, those"] = mean_text(above[common], sample[common])
    line |= {
        "SPL": mean_text(numbers(part, "spl"), sample),
        "clearance, cells": mean_text(np.round(numbers(part, "plan_clearance_min_m") * cells, 3), sample),
        "smoothness, 1/m2": mean_text(numbers(part, "plan_smoothness"), sample),
        "learn ms": median_text(numbers(part, "plan_learn_ms")),
        "plan ms": median_text(numbers(part, "plan_ms")),
        "again ms": median_text(numbers(part, "plan_again_ms")),
        "PAR-2 ms": mean_text(numbers(part, "par2_ms"), sample),
        "classes": _shares(part["homotopy"].fillna("")[found] if "homotopy" in part else []),
        "reasons": _shares(part["reason_"]),
    }
    distance, seconds, success = THESIS.get(group.place, {}).get(group.planner, (np.nan,) * 3)
    thesis = {"thesis cells": f"{distance:g}", "thesis s": f"{seconds:g}", "thesis success %": f"{success:g}"}
    return line | {key: "" if value == "nan" else value for key, value in thesis.items()}


def publish(table: pandas.DataFrame, folder: FilePath) -> list[FilePath]:
    """planning_table.csv and .md, panel.png, and bars of length and time, from the rows of a sweep; the files written."""
    from .planning_pictures import panel

    rows = planning_rows(table)
    summary = planning_table(rows)
    for name, text in (("planning_table.csv", summary.to_csv(index=False)), ("planning_table.md", as_markdown(summary))):
        write_text(folder / name, text)
    worlds, planners = sorted(rows["world"].unique()), order(rows["planner"].unique())
    runs: dict[tuple[str, str], FilePath] = {}
    for run, world, planner in sorted(zip(rows.index, rows["world"], rows["planner"], strict=True)):
        if (FilePath(run) / "plan.json").is_file():
            runs.setdefault((world, planner), FilePath(run))
    written = [folder / "planning_table.csv", folder / "planning_table.md"]
    if len(worlds) <= MOST_BARS:
        written.append(panel(runs, worlds, planners, folder / "panel.png"))
        written += draw_bars(rows, folder)
    return written


def draw_bars(rows: pandas.DataFrame, folder: FilePath) -> list[FilePath]:
    """bars_COLUMN.png of lengths and times into an existing folder, from planning rows; none for too many problems."""
    from .planning_pictures import bars

    found = list(groups(rows))
    if len({group.where for group in found}) > MOST_BARS:
        return []
    title, written = _caption(planning_table(rows)), []
    for column, label, log in (("plan_length_raw_m", "raw length [m]", False), ("plan_length_m", "length [m]", False),
                               ("plan_above_optimum_pct", "above the optimum [%]", False),
                               ("plan_ms", "planning time [CPU ms]", True)):
        drawn = [_bar(group, column) for group in found]
        written.append(bars(drawn, label, folder / f"bars_{column}.png", title=title, log=log))
    return written


def _caption(summary: pandas.DataFrame) -> str:
    """What the bars stand for, and who failed how often."""
    least, most = summary["n"].min(), summary["n"].max()
    failed = [f"{row['planner']} on {row['map']} {row['failed']}" for _, row in summary.iterrows() if row["failed"]]
    runs = f"{most}" if least == most else f"{least} to {most}"
    return (f"bar: mean of the paths found, line: its 95 % interval; {runs} runs a bar; failed: "
            + (", ".join(failed[:6]) + (", ..." if len(failed) > 6 else "") if failed else "none"))


def _bar(group: Group, column: str) -> tuple[str, str, float, float, float]:
    values = numbers(group.rows, column)
    known = np.isfinite(values)
    one_each = units(values[known], clusters(group.rows)[known])
    low, high = mean_interval(one_each)
    return group.where, group.who, float(one_each.mean()) if known.any() else float("nan"), low, high


def _span(values: np.ndarray) -> str:
    """The one value, or from where to where they go."""
    words = sorted({f"{value:.2f}" for value in values[np.isfinite(values)]}, key=float)
    return f"{words[0]} to {words[-1]}" if len(words) > 1 else words[0] if words else "-"


def _shares(words: Sequence[str]) -> str:
    """`left 3, right 7`, most frequent first."""
    counts = Counter(str(word)[:40] for word in words if str(word))
    return ", ".join(f"{word} {count}" for word, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])))
