"""Picture of a sensitivity: what halving and doubling each setting does to the measure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.files import write_whole
from rhs.plots import new_figure, save

SHOWN = 20  # settings
COLOURS = {0.5: "#2a6f97", 2.0: "#e0912f"}
MOST = 4.0  # times: beyond it points stand at the edge
WIDE = 1.6  # times: from here on ticks near one would stand on each other


def sensitivity_picture(effects: Sequence[Mapping[str, Any]], title: str, path: Path) -> Path:
    """A line for each setting, those that matter most on top; two points, half and double, with their 95 % intervals on a
    logarithmic axis of new over old. effects: key, factor, value, change, low, high, lost, won; largest first."""
    keys = list(dict.fromkeys(str(one["key"]) for one in effects))[:SHOWN]
    figure = new_figure(9.0, 1.4 + 0.34 * len(keys))
    axes = figure.subplots()
    for one in effects:
        if one["key"] not in keys:
            continue
        y = keys.index(one["key"]) + (-0.15 if one["factor"] < 1 else 0.15)
        colour = COLOURS[one["factor"]]
        change, low, high = (_inside(one[name]) for name in ("change", "low", "high"))
        if math.isfinite(low):
            axes.plot([low, high], [y, y], color=colour, linewidth=2, alpha=0.5)
        axes.plot([change], [y], "o", color=colour, markersize=5)
        counts = [f"{one[name]} {name}" for name in ("lost", "won") if one[name]]
        note = "   ".join([f"{one['value']:g}", *counts])
        axes.annotate(note, (1.01, y), xycoords=("axes fraction", "data"), fontsize=6.5, va="center", color=colour)
    axes.axvline(1.0, color="#888888", linewidth=1)
    axes.set_xscale("log")
    ends = axes.get_xlim()
    reach = max(1.1, ends[1], 1.0 / ends[0])
    steps = (0.25, 0.5, 1.0, 2.0, 4.0) if reach > WIDE else (0.5, 0.8, 0.9, 1.0, 1.1, 1.25, 2.0)
    ticks = [tick for tick in steps if 1.0 / reach <= tick <= reach]
    axes.set_xlim(1.0 / reach, reach)
    axes.set_xticks(ticks, [f"{100 * (tick - 1):+.0f} %" if tick != 1.0 else "as it is" for tick in ticks], fontsize=8)
    axes.minorticks_off()
    axes.set_ylim(len(keys) - 0.5, -0.5)
    axes.set_yticks(range(len(keys)), keys, fontsize=8)
    axes.set_yticks(np.arange(len(keys) - 1) + 0.5, minor=True)
    axes.grid(which="minor", axis="y", color="#eeeeee")
    axes.tick_params(which="minor", length=0)
    axes.set_title(title, fontsize=9)
    for factor, name in ((0.5, "half"), (2.0, "double")):
        axes.plot([], [], "o-", color=COLOURS[factor], label=name)
    figure.legend(loc="outside lower right", ncols=2, fontsize=8, frameon=False)
    return write_whole(path, lambda where: save(figure, where))


def _inside(share: float | None) -> float:
    """New over old, not beyond the edge of the picture."""
    return math.nan if share is None else float(np.clip(1.0 + share, 1.0 / MOST, MOST))
