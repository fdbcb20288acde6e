"""The page of a suite: scores, times, causes; a pure function of its rows and of what is known of their making."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rhs.reports.intervals import share_text

from . import recorded
from .suite import MEANINGS, Suite, hash_of

Rows = Sequence[Mapping[str, str]]
MOST_CAUSE = 150  # letters of one


def scores(rows: Rows) -> dict[str, str]:
    """The scores of one combination, as they stand on the page."""
    success = _column(rows, "success")
    touched = np.nan_to_num(_column(rows, "collisions"))
    ate, arrival = (_known(_column(rows, name)) for name in ("ate_m", "arrival_m"))
    wrong, extra = (_known(_column(rows, name)) for name in ("wrong_sure_share", "extra_m"))
    visited = np.nansum(_column(rows, "visited"))
    return {"success": share_text(np.nan_to_num(success)), "visited": f"{visited:g} of {_column(rows, 'reachable').sum():g}",
            "collisions": f"{touched.sum():g} in {np.count_nonzero(touched)}" if touched.any() else "0",
            "ate_m": _median_most(ate), "wrong_sure_share": f"{wrong.mean():.2g}" if len(wrong) else "-",
            "extra_m": f"{extra.mean():.3g} ({len(extra)} runs)" if len(extra) else "-", "arrival_m": _median_most(arrival)}


def _column(rows: Rows, name: str) -> np.ndarray:
    return np.array([float(row[name]) if row[name] else np.nan for row in rows])


def _known(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _median_most(values: np.ndarray) -> str:
    return f"{np.median(values):.3g}, {values.max():.3g}" if len(values) else "-"


def by_combination(rows: Rows) -> dict[str, list[Mapping[str, str]]]:
    """Name -> its rows, in their order."""
    found: dict[str, list[Mapping[str, str]]] = {}
    for row in rows:
        found.setdefault(row["combination"], []).append(row)
    return found


def rank(rows: Rows) -> tuple[float, ...]:
    """Sorts best first: places, success, touches, error of the survey."""
    ate = _known(_column(rows, "ate_m"))
    return (-float(np.nansum(_column(rows, "visited"))) / max(1, len(rows)), -float(np.nansum(_column(rows, "success"))),
            float(np.nansum(_column(rows, "collisions"))), float(np.median(ate)) if len(ate) else np.inf)


def page(suite: Suite, rows: Rows, made: Mapping[str, Mapping[str, Any]], *, note: str, mine: str = "") -> str:
    """NAME.md, best first. made: combination -> words, command, and `times_of`. note: which part of the suite this is."""
    found = by_combination(rows)
    ranked, scored, meanings = ((recorded.rank, recorded.scores, recorded.MEANINGS) if suite.recorded
                                else (rank, scores, MEANINGS))
    order = sorted(found, key=lambda name: (ranked(found[name]), name))
    title = suite.title[0].upper() + suite.title[1:]
    views = "" if suite.recorded else "; views 160 pixels wide"
    lines = [f"# {suite.name}", "", f"{title} ({suite.frozen}){views}. {note}".rstrip(),
             "`rows`: hash of the combination's rows in the csv; the same everywhere, or something differs.", "",
             f"| combination | runs | {' | '.join(meanings)} | rows |", f"|---|---|{'---|' * len(meanings)}---|"]
    for name in order:
        cells = scored(found[name])
        shown = f"**{name}**" if name == mine else name
        count = len(suite.asked(str(made.get(name, {}).get("words", ""))))
        lines.append(f"| {shown} | {len(found[name])} of {count} | {' | '.join(cells.values())} | "
                     f"{hash_of(found[name], suite.cells)} |")
    if missing := [name for name in suite.ours if name not in found]:
        lines += ["", f"Of ours not made yet: {', '.join(missing)}."]
    lines += ["", *(f"- `{name}`: {meaning}" for name, meaning in meanings.items())]
    lines += ["", "## Not everything was right in", ""]
    lines += [line for name in order for line in _causes(name, found[name], suite.recorded)] or ["none of them"]
    lines += ["", "## How they were made, and times", "", "Times are of the machine they were made on: compare within this "
              "table. Seconds of a run, median; a survey that several combinations shared counts in each.", "",
              "| combination | words | commit | s a run | views | memory MB |", "|---|---|---|---|---|---|"]
    for name in order:
        record = made.get(name, {})
        lines.append(f"| {name} | `{record.get('words', '')}` | {record.get('commit', '')} | {record.get('wall_s', '')} | "
                     f"{record.get('views', '')} | {record.get('memory_mb', '')} |")
    commands = sorted({str(record["command"]) for record in made.values() if record.get("command")})
    return "\n".join([*lines, "", "Commands: " + ", ".join(f"`{command}`" for command in commands)]) + "\n"


def _causes(name: str, rows: Rows, recorded: bool) -> list[str]:
    wrong = [row for row in rows if (row["status"] != "ok" if recorded else row["success"] != "1")]
    return [f"- {name}, {row['building']}: "
            + (f"{row['visited'] or 0} of {row['reachable']} places" if row["status"] == "ok" else row["status"])
            + (f"; {row['cause'][:MOST_CAUSE]}" if row["cause"] else "") for row in wrong]
