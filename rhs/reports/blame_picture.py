"""Picture of task=blame: what each link cost, measure by measure."""

from __future__ import annotations

import textwrap
from pathlib import Path

from rhs.api.files import write_whole
from rhs.metrics.blame import MEASURES
from rhs.plots import new_figure, save

from .drawing import json_of

LINK, REST, LOSS = "#b03a48", "#9aa0a6", "#222222"


def blame_picture(folder: Path) -> Path | None:
    """blame.png: a panel per measure, a bar per link, the whole loss as a line; None where there is no blame.json."""
    blame = json_of(folder / "blame.json")
    if not blame:
        return None
    errors = blame.get("off_by", {})
    names = [*blame["links"], "no link tried"]
    figure = new_figure(12.5, 1.6 + 0.34 * len(names))
    panels = figure.subplots(1, len(MEASURES), sharey=True)
    places = list(range(len(names)))[::-1]
    for axes, (measure, (unit, what)) in zip(panels, MEASURES.items(), strict=True):
        shares, loss = blame["shares"][measure], blame["loss"][measure]
        values = [_known(shares[link]) for link in blame["links"]] + [_known(blame["rest"][measure])]
        spread = [_known(errors.get(measure, {}).get(link)) for link in blame["links"]] + [0.0]
        axes.barh(places, values, xerr=spread if any(spread) else None, height=0.62, ecolor=LOSS,
                  color=[LINK] * len(blame["links"]) + [REST])
        axes.axvline(0.0, color=LOSS, linewidth=0.8)
        if loss is not None:
            axes.axvline(loss, color=LOSS, linewidth=1.0, linestyle=":")
        axes.set_title(f"{what}:\n" + ("unknown" if loss is None else f"{loss:.3g} {unit}"), fontsize=8)
        axes.set_xlabel(f"cost of the link{f' [{unit}]' if unit else ''}", fontsize=8)
        if not any(values) and not loss:
            axes.set_xlim(0.0, 1.0)
        axes.tick_params(labelsize=8)
    panels[0].set_yticks(places, names)
    drawn = "dotted: the whole loss" + ("; black: how far a share may be off" if errors else "")
    figure.suptitle("\n".join(textwrap.wrap(blame["verdict"], 130)) + f"\n({drawn})", fontsize=10)
    return write_whole(folder / "blame.png", lambda path: save(figure, path))


def _known(value: float | None) -> float:
    return 0.0 if value is None else value
