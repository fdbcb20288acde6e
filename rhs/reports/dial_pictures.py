"""Pictures of break points: the chance of success over one dial, and how much of many dials many combinations withstand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.files import write_whole
from rhs.metrics.threshold import Dial, fit, three_digits
from rhs.plots import new_figure, save

SHOWN = 12  # combinations in one picture
CELL_IN = (1.75, 0.62)
DARK = 0.55  # of the colours: below it letters are white
COLOURS = ("#2a6f97", "#b03a48", "#2a9d5c", "#e0912f", "#7b5ea7", "#555555")


def threshold_picture(accounts: Sequence[Mapping[str, Any]], dial: Dial, path: Path) -> Path:
    """A row for each combination: curve with its 95 % band, outcomes as ticks (up: success), the break point with its
    interval."""
    shown = accounts[:SHOWN]
    figure = new_figure(9.0, 1.2 + 1.5 * len(shown))
    panels = np.atleast_1d(figure.subplots(len(shown), 1, sharex=True))
    levels = np.linspace(0.0, 1.0, 101)
    for number, (axes, account) in enumerate(zip(panels, shown, strict=True)):
        colour = COLOURS[number % len(COLOURS)]
        tried = [(level, bool(success)) for level, success in account["levels"]]
        expected, low, high = fit(*zip(*tried, strict=True)).curve(levels)
        axes.fill_between(levels, low, high, color=colour, alpha=0.2, linewidth=0)
        axes.plot(levels, expected, color=colour)
        for succeeded, at in ((True, 1.06), (False, -0.06)):
            alike = [level for level, success in tried if success is succeeded]
            axes.plot(alike, [at] * len(alike), "|", color="#222222", markersize=7)
        if account["found"]:
            order = np.argsort(expected, kind="stable")  # np.interp wants chances that rise
            axes.axvline(float(np.interp(0.5, expected[order], levels[order])), color=colour, linestyle=":")
        axes.set(ylim=(-0.15, 1.15), xlim=(-0.02, 1.02), yticks=[0.0, 0.5, 1.0])
        axes.set_title(f"{account['combination']}: {account['says']}; {account['runs']} runs", fontsize=9)
        axes.set_ylabel("success", fontsize=8)
    values = list(dict.fromkeys(dial.value(tick) for tick in np.linspace(0.0, 1.0, 6).tolist()))
    panels[-1].set_xticks([dial.level(value) for value in values], [three_digits(value) for value in values])
    panels[-1].set_xlabel(f"{accounts[0]['dial']} (ticks: runs that succeeded above, that failed below; band: 95 %)",
                          fontsize=8)
    return write_whole(path, lambda where: save(figure, where))


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
    return f"{three_digits(one['middle'])}, more {side}\n{one['between']}"
