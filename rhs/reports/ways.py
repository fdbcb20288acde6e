"""The ways of a sweep's runs over one another: a panel for each recording or building that several runs went through."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.errors import RhsError
from rhs.api.trajectory import Trajectory, read_tum
from rhs.plots import new_figure
from rhs.worlds.random.names import building_of

from .drawing import COLOURS, broken_at_leaps, laid_onto

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS, LINES = 6, 10  # more are not told apart
PANEL_IN = 4.6  # side of a panel, inches


def ways(table: pandas.DataFrame, group: Sequence[str]) -> Figure | None:
    """The survey of each run as it was settled (of task=localise the way as believed), along the two axes on which it goes
    furthest, with the truth where there is one; None where no two runs went the same way. table: rows by run folder.
    group: columns that say which run a line is.

    A way is laid onto the truth as its ATE was; where nobody knows the truth it begins where the others do."""
    found: dict[str, list[tuple[Path, Any]]] = {}
    for name, row in table.iterrows():
        if (folder := Path(str(name))).is_dir() and _settled(folder) is not None:
            found.setdefault(building_of(str(row.get("world")), row.get("seed")), []).append((folder, row))
    shared = {where: runs for where, runs in sorted(found.items()) if len(runs) > 1}
    shown = list(shared.items())[:PANELS]
    if not shown:
        return None
    columns = min(2, len(shown))
    lines = -(-len(shown) // columns)
    figure = new_figure(PANEL_IN * columns, PANEL_IN * lines)
    for place, (where, runs) in enumerate(shown):
        axes = figure.add_subplot(lines, columns, place + 1)
        seeds = len({row.get("seed") for _, row in runs}) > 1
        names = [name for name in group if name != "world"] + (["seed"] if seeds else [])
        _panel(axes, [(folder, row, " · ".join(f"seed {row[name]}" if name == "seed" else str(row[name]) for name in names))
                      for folder, row in runs[:LINES]])
        left = f", {LINES} of {len(runs)} runs" if len(runs) > LINES else ""
        axes.set_title(f"{where}{left}", fontsize=9)
    if len(shared) > PANELS:
        figure.suptitle(f"{PANELS} of {len(shared)} recordings or buildings", fontsize=9)
    return figure


def _panel(axes: Axes, runs: Sequence[tuple[Path, Any, str]]) -> None:
    true_ways = (_first(folder, "truth_survey.tum", "truth_localised.tum") for folder, _, _ in runs)
    truth = next((way for way in true_ways if way is not None), None)
    true: dict[str, Any] = {"color": COLOURS["truth"], "linewidth": 2.2}
    lines = [] if truth is None else [(truth, "true", true)]
    for folder, row, label in runs:
        if (way := _settled(folder)) is not None:
            laid = way if truth is None else laid_onto(way, truth, str(row.get("ate_alignment") or "none"))
            lines.append((laid, label, {"linewidth": 1.1}))
    across, up = sorted(np.argsort(-np.ptp(lines[0][0].positions_m, axis=0), kind="stable")[:2])
    for way, label, style in lines:
        seen_m = broken_at_leaps(way.positions_m[:, [across, up]])
        axes.plot(seen_m[:, 0], seen_m[:, 1], label=label, **style)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{'xyz'[across]} [m]", fontsize=8)
    axes.set_ylabel(f"{'xyz'[up]} [m]", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.legend(fontsize=7, frameon=False)


def _settled(folder: Path) -> Trajectory | None:
    """The survey's way as it was corrected, else as it was believed, else that of task=localise."""
    return _first(folder, "corrected.tum", "estimate.tum", "localised.tum")


def _first(folder: Path, *names: str) -> Trajectory | None:
    return next((way for name in names if (way := _read(folder / name)) is not None), None)


def _read(path: Path) -> Trajectory | None:
    try:
        way = read_tum(path) if path.is_file() else None
    except (OSError, RhsError):
        return None
    return way if way is not None and len(way) else None
