"""`bench corridor-v1 --blame`: of the runs that lost something, which link of the chain it was; of all, idleness beside its
bound. A table beside the frozen one, whose columns stay what they are."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

CELLS = ("combination", "building", "seed", "idleness_worst_s", "idleness_bound_s", "link", "measure", "blame")
Rows = Sequence[Mapping[str, str]]


def lost(row: Mapping[str, Any]) -> bool:
    """Whether a run came to its end without having done all of its mission."""
    return row["status"] == "ok" and row.get("success") != 1


def cells_of(name: str, building: tuple[str, int], row: Mapping[str, Any], blamed: Mapping[str, Any] | None,
             ) -> dict[str, str]:
    """A run, and the row of its task=blame where it lost something."""
    idle = {cell: row.get(cell) for cell in CELLS[3:5]}
    told = {cell: f"{value:.9g}" if isinstance(value, int | float) and np.isfinite(value) else ""
            for cell, value in idle.items()}
    why = {} if blamed is None else {"link": blamed.get("blame_link"), "measure": blamed.get("blame_measure"),
                                     "blame": blamed.get("blame") or blamed.get("reason") or blamed["status"]}
    cells = {"combination": name, "building": building[0], "seed": str(building[1]), **told, **why}
    return {cell: str(cells.get(cell) or "") for cell in CELLS}


def csv_of(rows: Rows) -> str:
    """The rows; no time of a machine."""
    text = io.StringIO()
    table = csv.DictWriter(text, CELLS, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def page(name: str, rows: Rows) -> str:
    """NAME_blame.md."""
    lines = [f"# Why: {name}", "", "`idleness`: longest time that a place went without a visit, over the exact bound: "
             "the shortest way through all places that can be reached, in any order, at the highest speed: median, "
             "largest.",
             "`named`: runs that did not do all of their mission, by the link that `task=blame` names (`rhs/blame`).", "",
             "| combination | runs | idleness | lost something | named |", "|---|---|---|---|---|"]
    for one in dict.fromkeys(row["combination"] for row in rows):
        own = [row for row in rows if row["combination"] == one]
        over = np.array([float(row["idleness_worst_s"]) / float(row["idleness_bound_s"]) for row in own
                         if row["idleness_worst_s"] and float(row["idleness_bound_s"] or 0) > 0])
        idle = f"{np.median(over):.3g}, {over.max():.3g}" if len(over) else "-"
        blamed = [row for row in own if row["blame"]]
        counts = Counter(row["link"] or "nobody" for row in blamed)
        named = ", ".join(f"{link} {count}" for link, count in counts.most_common())
        lines.append(f"| {one} | {len(own)} | {idle} | {len(blamed)} | {named or '-'} |")
    told = [f"- {row['combination']}, {row['building']}: {row['blame']}" for row in rows if row["blame"]]
    return "\n".join([*lines, "", *told]) + "\n"
