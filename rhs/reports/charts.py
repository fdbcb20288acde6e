"""Charts of runs and sweeps: error over time, time per stage, bars with intervals, what each link cost. matplotlib's home,
without pyplot."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rhs.api.files import write_whole
from rhs.api.geometry import wrap
from rhs.metrics.blame import MEASURES
from rhs.plots import draw_errors, new_figure, save
from rhs.runfolder.run import Run

from .drawing import COLOURS

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

LINK, REST, LOSS = "#b03a48", "#9aa0a6", "#222222"  # colours of task=blame
STAGES = ("capture_ms", "sense_ms", "odometry_ms", "localise_ms", "map_ms", "plan_ms")


def errors_over_time(steps: pandas.DataFrame) -> Figure | None:
    """True error of the believed position over time, with the error the robot itself expected (3 sigma)."""
    known = steps.dropna(subset=["true_x_m"])
    if known.empty:
        return None
    figure = new_figure(8.0, 3.0)
    axes = figure.add_subplot()
    error = np.hypot(known["x_m"] - known["true_x_m"], known["y_m"] - known["true_y_m"])
    expected = 3.0 * np.sqrt(known["sigma_x_m"] ** 2 + known["sigma_y_m"] ** 2)
    axes.plot(known["stamp_s"], error, color=COLOURS["estimate"], label="error of the believed position")
    axes.plot(known["stamp_s"], expected, color="#888888", linestyle="--", linewidth=1, label="expected, 3 sigma")
    patrol = known[known["phase"] == "patrol"]
    if len(patrol):
        axes.axvspan(patrol["stamp_s"].iloc[0], patrol["stamp_s"].iloc[-1], color=COLOURS["patrol"], alpha=0.08,
                     label="patrol")
    label = "the odometry doubts itself"
    for stamp_s in known.loc[known["motion_status"] != "ok", "stamp_s"]:
        axes.axvline(stamp_s, color=COLOURS["place"], alpha=0.25, linewidth=1, label=label)
        label = "_"  # one entry in the legend, not one per view
    axes.set_ylim(0.0, max(1.1 * float(error.max()), 1e-3))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("[m]")
    axes.legend(fontsize=8, frameon=False, loc="upper left")
    return figure


def errors_by_axis(steps: dict[str, np.ndarray], unit: str = "m") -> Figure | None:
    """True error in x, y and heading against the view, inside the band of three sigma that the robot itself gave.

    steps: columns of steps.csv as (N,) float arrays, NaN unknown; `trusted` (N,) bool where the motion was ok,
    `patrol` (N,) bool of the patrol: it begins with the loop closed, which error and band show by a leap."""
    if not np.isfinite(steps["true_x_m"]).any():
        return None
    figure = new_figure(9.0, 6.5)
    axes = figure.subplots(3, 1, sharex=True)
    turn = wrap(steps["yaw_rad"] - steps["true_yaw_rad"])
    panels = ((f"x [{unit}]", steps["x_m"] - steps["true_x_m"], steps["sigma_x_m"]),
              (f"y [{unit}]", steps["y_m"] - steps["true_y_m"], steps["sigma_y_m"]),
              ("heading [deg]", np.degrees(turn), np.degrees(steps["sigma_yaw_rad"])))
    begin = int(np.argmax(steps["patrol"]))
    for panel, (label, error, sigma) in zip(axes, panels, strict=True):
        draw_errors(panel, error, sigma, steps["trusted"])
        if 0 < begin < len(turn):
            panel.axvline(begin - 0.5, color="#555555", linewidth=0.8, linestyle="--", label="survey ends, patrol begins")
        panel.set_ylabel(f"error in {label}")
    axes[0].legend(fontsize=8, frameon=False, loc="upper left", ncols=4)
    axes[-1].set_xlabel("view")
    return figure


def stage_times(steps: pandas.DataFrame) -> Figure | None:
    """Time per view and stage: median with the middle 90 %."""
    stages = [name for name in STAGES if name in steps.columns and steps[name].notna().any()]
    if not stages:
        return None
    figure = new_figure(8.0, 0.5 + 0.4 * len(stages))
    axes = figure.add_subplot()
    for place, name in enumerate(reversed(stages)):
        low, middle, high = np.percentile(steps[name].dropna(), [5, 50, 95])
        axes.barh(place, middle, color=COLOURS["corrected"], height=0.6)
        axes.plot([low, high], [place, place], color="#222222", linewidth=1)
    axes.set_yticks(range(len(stages)), [name.removesuffix("_ms") for name in reversed(stages)])
    axes.set_xlabel("milliseconds per view (bar: median, line: 5 to 95 %)")
    return figure


def bars(table: pandas.DataFrame, column: str, group: Sequence[str]) -> Figure | None:
    """Mean of a column per group with its 95 % interval, every run as a dot, and the share that ended well."""
    from .intervals import mean_interval

    if column not in table.columns or not table[column].notna().any():
        return None
    parts = list(table.groupby(list(group), dropna=False, sort=True)) if group else [(("all runs",), table)]
    figure = new_figure(8.0, 0.9 + 0.42 * len(parts))
    axes = figure.add_subplot()
    labels = []
    for place, (key, part) in enumerate(reversed(parts)):
        values = part[column].astype("float64").dropna().to_numpy()
        labels.append(f"{' · '.join(map(str, key))} ({len(values)}/{len(part)})")
        if not len(values):
            continue
        axes.barh(place, values.mean(), color=COLOURS["corrected"], alpha=0.55, height=0.6)
        axes.plot(values, np.full(len(values), place), ".", color="#222222", markersize=4, alpha=0.6, zorder=3)
        low, high = mean_interval(values)
        if np.isfinite(low):
            axes.plot([low, high], [place, place], color=COLOURS["place"], linewidth=2)
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.set_xlabel(f"{column} (bar: mean, line: 95 % interval, dots: runs; in brackets: runs with a value / runs)",
                    fontsize=8)
    return figure


def blame_picture(folder: Path) -> Path | None:
    """blame.png: a panel per measure, a bar per link, the whole loss as a line; None where there is no blame.json."""
    blame = Run(folder).json("blame")
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
