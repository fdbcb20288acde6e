"""Picture of break points: the chance of success over the dial, what was tried, the level at which half fail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.files import write_whole
from rhs.metrics.threshold import fit
from rhs.plots import new_figure, save

SHOWN = 12  # combinations in one picture
COLOURS = ("#2a6f97", "#b03a48", "#2a9d5c", "#e0912f", "#7b5ea7", "#555555")


def threshold_picture(accounts: Sequence[Mapping[str, Any]], dial_value: Any, path: Path) -> Path:
    """A row for each combination: curve with its 95 % band, outcomes as ticks (up: success), the break point with its
    interval. dial_value: level (share of the dial) -> value of the setting."""
    shown = accounts[:SHOWN]
    figure = new_figure(9.0, 1.2 + 1.5 * len(shown))
    panels = np.atleast_1d(figure.subplots(len(shown), 1, sharex=True))
    levels = np.linspace(0.0, 1.0, 101)
    for number, (axes, told) in enumerate(zip(panels, shown, strict=True)):
        colour = COLOURS[number % len(COLOURS)]
        tried = [(level, bool(success)) for level, success in told["levels"]]
        expected, low, high = fit(*zip(*tried, strict=True)).curve(levels)
        axes.fill_between(levels, low, high, color=colour, alpha=0.2, linewidth=0)
        axes.plot(levels, expected, color=colour)
        for succeeded, at in ((True, 1.06), (False, -0.06)):
            alike = [level for level, success in tried if success is succeeded]
            axes.plot(alike, [at] * len(alike), "|", color="#222222", markersize=7)
        if told["found"]:
            level = float(np.interp(0.5, *_rising(expected, levels)))
            axes.axvline(level, color=colour, linestyle=":")
        axes.set(ylim=(-0.15, 1.15), xlim=(-0.02, 1.02), yticks=[0.0, 0.5, 1.0])
        axes.set_title(f"{told['combination']}: {told['says']}; {told['runs']} runs", fontsize=9)
        axes.set_ylabel("success", fontsize=8)
    ticks = np.linspace(0.0, 1.0, 6)
    panels[-1].set_xticks(ticks, [f"{dial_value(tick):.3g}" for tick in ticks])
    panels[-1].set_xlabel(f"{accounts[0]['dial']} (ticks: runs that succeeded above, that failed below; band: 95 %)",
                          fontsize=8)
    return write_whole(path, lambda where: save(figure, where))


def _rising(expected: np.ndarray, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chance and level, sorted by chance, as np.interp wants them."""
    order = np.argsort(expected, kind="stable")
    return expected[order], levels[order]
