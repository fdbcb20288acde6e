"""What a table says: per group, how many runs, how many independent, how many failed, means with 95 % intervals.

Means (medians of times) are over the runs that have the number, their intervals over the independent ones; `failed` stands
beside them, and scores that count failures (`spl`, `par2_ms`), since a mean over successes alone flatters. Intervals:
rhs.reports.intervals.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import TYPE_CHECKING

import numpy as np

from rhs.base.commands import aligned, plain
from rhs.base.errors import ConfigError
from rhs.config.dictionary import added
from rhs.metrics.blame import LINKS, column
from rhs.metrics.threshold import LEAST_SEEDS, between_seeds, dial_between, fit, in_words
from rhs.runfolder.row import CHOICES, KEYS

from .intervals import legend, mean_text, median_text, share_text
from .observations import clusters, failures_told, independent, judged, numbers
from .varied_settings import is_setting

if TYPE_CHECKING:
    import pandas

SHOWN = ("places_visited", "collisions", "ate_rmse_m", "rpe_trans_m", "end_error_m", "tracked_share", "map_agreement",
         "path_length_m", "kidnap_recovered_share", "kidnap_wrong_sure_share",
         "plan_length_m", "plan_above_optimum_pct", "spl", "par2_ms", "odometry_ms", "real_time_factor")
SHOWN_OF = {  # of these tasks others
    "blame": ("places_visited", *(column("places", link) for link in (*LINKS, "rest"))),
    "localise": ("found_share", "found_m", "belief_right_share", "belief_sure_share", "belief_wrong_sure_share",
                 "belief_ece", "belief_lost_share", "localise_rmse_m", "map_size_ratio", "localise_ms", "real_time_factor")}
SCORES = ("success", "spl", "par2_ms", "bucket")
LEAST_LEVELS = 4  # of a setting at which runs succeed or fail


def shown(table: pandas.DataFrame) -> list[str]:
    """The columns that say most, and those that other people's plugins have added, as far as anything stands in them."""
    strange = [name for name in added(table.columns) if not is_setting(name) and name not in SCORES]
    tasks = set(table["task"].dropna()) if "task" in table.columns else set()
    most = SHOWN_OF.get(tasks.pop(), SHOWN) if len(tasks) == 1 else SHOWN
    return [name for name in (*most, *strange) if name in table.columns and table[name].notna().any()]


def summarise(table: pandas.DataFrame, *, group: Sequence[str] = (), columns: Sequence[str] = (),
              cluster: str = "") -> pandas.DataFrame:
    """One row per group: runs, failed, share complete with interval, then each column's mean and interval.

    cluster: the column whose values the runs are samples of; see observations.clusters. The text below the table stands in
    `attrs["notes"]`."""
    import pandas as pd

    scored = judged(table)
    check_columns(scored, [*group, *columns])
    by = list(group) or _swept(scored)
    wanted = [name for name in list(columns) or shown(scored) if pd.api.types.is_numeric_dtype(scored[name])]
    scored = scored.assign(independent_=independent(table))
    parts = [((), scored)] if not by else list(scored.groupby(by, dropna=False, sort=True))
    view = pd.DataFrame([dict(zip(by, key, strict=False)) | _group_row(part, wanted, cluster) for key, part in parts])
    view.attrs["notes"] = _notes(table, view)
    return view


def _swept(table: pandas.DataFrame) -> list[str]:
    """The columns in which the runs were made to differ: parts first, then settings that differ with the same parts too
    (two parts may have a setting of one name, with other defaults). Problems of a MovingAI file go by bucket."""
    parts = [name for name in CHOICES if name in table.columns and table[name].nunique(dropna=False) > 1]
    same_parts = table.groupby(parts, dropna=False) if parts else table.groupby(np.zeros(len(table)))
    settings = [name for name in table.columns if (is_setting(name) or name == "presets") and
                (same_parts[name].nunique(dropna=False) > 1).any()]
    if "planning.scenario" in settings and "bucket" in table.columns:
        settings[settings.index("planning.scenario")] = "bucket"
    return parts + settings


def _group_row(part: pandas.DataFrame, wanted: Sequence[str], cluster: str) -> dict[str, object]:
    samples = clusters(part, cluster)
    row: dict[str, object] = {"runs": len(part), "independent": part["independent_"].nunique(),
                              "failed": int((part["success"] == 0.0).sum()),
                              "complete": share_text(part["success"].to_numpy(float), samples)}
    if "blame_link" in part.columns:  # of task=blame: which links were named, and in how many runs
        named = Counter(str(link) for link in part["blame_link"].dropna() if link)
        row["blame_link"] = ", ".join(f"{link} {count}" for link, count in named.most_common())
    for name in wanted:
        values = numbers(part, name)
        row[name] = median_text(values) if name.endswith("_ms") and name != "par2_ms" else mean_text(values, samples)
    return row


def _notes(table: pandas.DataFrame, view: pandas.DataFrame) -> list[str]:
    text = " ".join(map(str, view.to_numpy().ravel()))
    notes = legend(text)
    if (view["independent"] < view["runs"]).any():
        notes.append("independent: runs that give the same row for every seed count once and have no interval; so do runs "
                     "done twice")
    if "par2_ms" in view.columns:
        notes.append("par2_ms: a failure counts twice the longest time that any run of its problem took")
    return [*notes, failures_told(table)]


def thresholds(table: pandas.DataFrame) -> list[str]:
    """The break points that a plain sweep shows (rhs.metrics.threshold): a line for each numeric setting that the runs vary
    over four levels and more, and each combination of parts in which some succeeded and some failed."""
    import pandas as pd

    lines = []
    settings = [name for name in table.columns if "." in name and pd.api.types.is_numeric_dtype(table[name])
                and not pd.api.types.is_bool_dtype(table[name]) and table[name].nunique() >= LEAST_LEVELS]
    for setting in settings:
        known = table[table[setting].notna() & table["success"].notna()]
        dial = dial_between(setting, float(known[setting].min()), float(known[setting].max()))
        for name, part in _combinations(known, setting):
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


def _combinations(table: pandas.DataFrame, setting: str) -> Iterator[tuple[str, pandas.DataFrame]]:
    """The rows of each combination of parts, worlds and other settings; seeds together."""
    keys = [name for name in table.columns if (name in CHOICES or "." in name) and name != setting
            and table[name].nunique(dropna=False) > 1]
    if not keys:
        yield "", table
        return
    for values, part in table.groupby(keys, dropna=False, sort=True):
        yield f"{' '.join(map(str, values))}: ", part


def listing(table: pandas.DataFrame, columns: Sequence[str]) -> pandas.DataFrame:
    """Every run with the chosen columns, or with the ones that say most."""
    scored = judged(table)
    table = table.assign(**{name: scored[name] for name in SCORES if name in scored.columns})
    check_columns(table, columns)
    swept = [name for name in _swept(table) if name not in KEYS]
    names = list(columns) or ["status", "success", *KEYS[:-1], *swept, "seed", *shown(table)]
    view = table[[name for name in names if name in table.columns]].reset_index()
    view.attrs["notes"] = [failures_told(table)]
    return view


def check_columns(table: pandas.DataFrame, names: Sequence[str]) -> None:
    """Refuse a column that the table lacks, with those it has that look alike."""
    for name in names:
        if name not in table.columns:
            near = get_close_matches(name, list(table.columns), n=3)
            raise ConfigError(f"no column {name!r}; " + (f"did you mean {' or '.join(near)}?" if near else
                              f"there are {', '.join(table.columns[:12])}, ..."))


def as_text(view: pandas.DataFrame) -> str:
    """Columns of words for a terminal, and the notes below them."""
    cells = [[short(value) for value in row] for row in view.itertuples(index=False, name=None)]
    names = [str(name) for name in view.columns]
    rules = ["-" * max(map(len, column)) for column in zip(names, *cells, strict=True)]
    return "\n".join([*aligned([names, rules, *cells]), *notes_of(view)])


def notes_of(view: pandas.DataFrame) -> list[str]:
    """What stands below a table, a line each."""
    return [plain(note) for note in view.attrs.get("notes", ())]


def short(value: object, longest: int = 60) -> str:
    """A value as a table shows it: four digits, `-` for unknown, one line without control characters."""
    if value is None or str(value) in ("<NA>", "nan"):
        return "-"
    return plain(f"{value:.4g}" if isinstance(value, float) else str(value))[:longest]
