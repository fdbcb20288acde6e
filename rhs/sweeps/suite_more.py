"""What the runs of a suite tell beside its frozen columns: idleness beside its bound, how precisely places are come back to
and, with `--blame`, which link of the chain it was where something was lost. A table beside the frozen one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.metrics.idleness import arrivals
from rhs.runfolder.run import Run

CELLS = ("combination", "building", "seed", "idleness_worst_s", "idleness_bound_s", "stood_m", "link", "measure", "blame")
Rows = Sequence[Mapping[str, str]]


def lost(row: Mapping[str, Any]) -> bool:
    """Whether a run came to its end without having done all of its mission."""
    return row["status"] == "ok" and row.get("success") != 1


def cells_of(name: str, building: tuple[str, int], row: Mapping[str, Any], blamed: Mapping[str, Any] | None, folder: Path,
             ) -> dict[str, str]:
    """A run, its folder, and the row of its task=blame where it lost something."""
    idle = {cell: row.get(cell) for cell in CELLS[3:5]}
    figures = {cell: f"{value:.9g}" if isinstance(value, int | float) and np.isfinite(value) else ""
            for cell, value in idle.items()}
    stood = ";".join(f"{place}:{x:.6f} {y:.6f}" for place, _, (x, y) in arrivals(Run(folder)))
    why = {} if blamed is None else {"link": blamed.get("blame_link"), "measure": blamed.get("blame_measure"),
                                     "blame": blamed.get("blame") or blamed.get("reason") or blamed["status"]}
    cells = {"combination": name, "building": building[0], "seed": str(building[1]), **figures, "stood_m": stood, **why}
    return {cell: str(cells.get(cell) or "") for cell in CELLS}


def precision_m(rows: Rows) -> tuple[float, int]:
    """(root mean square distance of where the robot truly stood at a place from the mean of where it stood there, how many
    times) over the places that several of these runs came to in the same building; of n times at a place n - 1 count."""
    at: dict[tuple[str, str], list[list[float]]] = {}
    for row in rows:
        for word in filter(None, row["stood_m"].split(";")):
            place, _, where = word.rpartition(":")
            at.setdefault((row["building"], place), []).append([float(value) for value in where.split()])
    again = [np.array(stood) for stood in at.values() if len(stood) > 1]
    if not again:
        return float("nan"), 0
    square = sum(float(((stood - stood.mean(axis=0)) ** 2).sum()) for stood in again)
    return float(np.sqrt(square / sum(len(stood) - 1 for stood in again))), sum(map(len, again))


def page(name: str, rows: Rows) -> str:
    """NAME_more.md."""
    lines = [f"# Beside {name}", "", "`idleness`: longest time that a place went without a visit, over the exact bound: "
             "the shortest way through all places that can be reached, in any order, at the highest speed: median, "
             "largest.",
             "`precision`: how far apart the robot truly stood when it came to the same place of the same building again, "
             "with another seed: root mean square distance from their mean; of how many visits.",
             "`named`: runs that did not do all of their mission, by the link that `task=blame` names (`rhs/blame`); with "
             "`--blame`.", "", "| combination | runs | idleness | precision | blamed | named |", "|---|---|---|---|---|---|"]
    for one in dict.fromkeys(row["combination"] for row in rows):
        own = [row for row in rows if row["combination"] == one]
        over = np.array([float(row["idleness_worst_s"]) / float(row["idleness_bound_s"]) for row in own
                         if row["idleness_worst_s"] and float(row["idleness_bound_s"] or 0) > 0])
        idle = f"{np.median(over):.3g}, {over.max():.3g}" if len(over) else "-"
        spread_m, visits = precision_m(own)
        precise = f"{spread_m:.3f} m ({visits})" if visits else "-"
        blamed = [row for row in own if row["blame"]]
        counts = Counter(row["link"] or "nobody" for row in blamed)
        named = ", ".join(f"{link} {count}" for link, count in counts.most_common())
        lines.append(f"| {one} | {len(own)} | {idle} | {precise} | {len(blamed)} | {named or '-'} |")
    details = [f"- {row['combination']}, {row['building']}: {row['blame']}" for row in rows if row["blame"]]
    return "\n".join([*lines, "", *details]).rstrip() + "\n"
