"""Picture of an atlas: how much of each dial each combination withstands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.files import write_whole
from rhs.plots import new_figure, save

CELL_IN = (1.75, 0.62)
DARK = 0.55  # of the colours: below it letters are white


def atlas_picture(accounts: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Rows: combinations; columns: dials. Colour: share of the dial, from its harmless end on, at which half of the runs
    fail; in the cell the value there and its 95 % interval."""
    names, dials = (list(dict.fromkeys(one[key] for one in accounts)) for key in ("combination", "dial"))
    longest = max(len(name) for name in names)
    figure = new_figure(1.6 + 0.09 * longest + CELL_IN[0] * len(dials), 1.5 + CELL_IN[1] * len(names))
    axes = figure.subplots()
    shares = np.full((len(names), len(dials)), np.nan)
    ends = {one["dial"]: one["ends"] for one in accounts}
    for one in accounts:
        at = names.index(one["combination"]), dials.index(one["dial"])
        shares[at] = one["withstood"]
        axes.text(at[1], at[0], _in_cell(one), ha="center", va="center", fontsize=8,
                  color="white" if one["withstood"] < DARK else "black")
    image = axes.imshow(shares, cmap="cividis", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_yticks(range(len(names)), names, fontsize=9)
    axes.set_xticks(range(len(dials)), [f"{_broken(dial)}\n{ends[dial][0]:g} to {ends[dial][1]:g}" for dial in dials],
                    fontsize=8)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.set_xticks(np.arange(len(dials) - 1) + 0.5, minor=True)
    axes.set_yticks(np.arange(len(names) - 1) + 0.5, minor=True)
    axes.grid(which="minor", color="white", linewidth=2)
    axes.tick_params(which="minor", length=0)
    figure.colorbar(image, ax=axes, label="share of the dial withstood", ticks=[0.0, 0.5, 1.0])
    return write_whole(path, lambda where: save(figure, where))


def _broken(dial: str) -> str:
    """The key over two lines."""
    above, _, last = dial.rpartition(".")
    return f"{above}.\n{last}" if above else last


def _in_cell(one: Mapping[str, Any]) -> str:
    if not one["found"]:
        return f"{'does not break' if one['withstood'] else 'always fails'}\n{one['runs']} runs"
    side = "above" if one["direction"] > 0 else "below"
    return f"{one['middle']:.3g}, more {side}\n{one['low']:.3g} to {one['high']:.3g}"
