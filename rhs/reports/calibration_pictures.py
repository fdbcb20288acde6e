"""Pictures of calibration: what followed each kidnap, how reliable the stated chances were, precision against recall."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rhs.api.belief import RIGHT_M
from rhs.api.files import write_whole
from rhs.metrics.calibration import PHASES, WITHIN_M, Beliefs, Kidnap, beliefs_of, calibration_error, reliability, searches
from rhs.metrics.localise import FOUND_WITHIN_M
from rhs.plots import new_figure, save
from rhs.runfolder.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SURE, UNSURE = "#1f6fb4", "#bbbbbb"


def calibration_picture(folder: Path) -> Path | None:
    """knowing.png of a run folder: its kidnaps and its reliability; None where nobody knows the truth. Of task=localise
    every start is shown as a kidnap is."""
    beliefs = beliefs_of([row for row in Run(folder).steps if row["phase"] in PHASES])
    if not len(beliefs.wrong_m):
        return None
    started = bool(beliefs.started.any())
    begins, within_m = beliefs.kidnapped | beliefs.started, FOUND_WITHIN_M if started else WITHIN_M
    figure = draw_knowing(searches(beliefs, begins, within_m), {"this drive" if started else "this patrol": [beliefs]},
                          what="start" if started else "kidnap", wide=1.5)
    return write_whole(Path(folder) / "knowing.png", lambda partial: save(figure, partial))


def draw_knowing(happened: Sequence[Kidnap], drives: Mapping[str, Sequence[Beliefs]], *, what: str = "kidnap",
                 wide: float = 1.2) -> Figure:
    """What followed each kidnap or start; how reliable the chances were that were stated on some drives, by name. wide: the
    left picture over the right one."""
    figure = new_figure(10.0, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=[wide, 1.0])
    draw_kidnaps(left, happened, what=what)
    draw_reliability(right, {name: (np.concatenate([one.probability for one in each]),
                                    np.concatenate([one.right for one in each])) for name, each in drives.items() if each})
    return figure


def draw_kidnaps(axes: Axes, happened: Sequence[Kidnap], *, what: str = "kidnap") -> None:
    """Error against the way since the kidnap, dark where the robot called itself tracking."""
    for one in happened:
        wrong = np.maximum(one.wrong_m, 1e-3)
        axes.plot(one.way_m, wrong, color=UNSURE, linewidth=0.8, zorder=1)
        axes.scatter(one.way_m[one.sure], wrong[one.sure], s=9, color=SURE, zorder=2, linewidths=0)
        axes.scatter(one.way_m[~one.sure], wrong[~one.sure], s=9, color=UNSURE, zorder=2, linewidths=0)
    axes.axhline(RIGHT_M, color="#c1121f", linewidth=1)
    axes.set_yscale("log")
    axes.set_xlabel(f"metres driven since the {what}")
    axes.set_ylabel("error of the believed position [m]")
    found = sum(np.isfinite(one.metres) for one in happened)
    words = f"{found} recovered" if what == "kidnap" else f"found after {found}"
    several = "s" * (len(happened) != 1)
    axes.set_title(f"{len(happened)} {what}{several}, {words} (red: 0.25 m; blue: says tracking)", fontsize=9)


def draw_reliability(axes: Axes, curves: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> None:
    """Share that was right against the stated chance, a bin per mark, sized by its views; the diagonal is honest."""
    axes.plot([0, 1], [0, 1], color="#888888", linestyle="--", linewidth=1)
    for name, (probability, right) in curves.items():
        table = reliability(probability, right)
        line = axes.plot(table[:, 0], table[:, 1], linewidth=1.2,
                         label=f"{name}: ECE {calibration_error(probability, right):.3f}, n {len(right)}")[0]
        axes.scatter(table[:, 0], table[:, 1], s=8 + 90 * table[:, 2] / table[:, 2].sum(), color=line.get_color())
    axes.set_xlabel("stated chance of being right")
    axes.set_ylabel("share that was right")
    axes.set_xlim(-0.03, 1.03)
    axes.set_ylim(-0.03, 1.03)
    axes.legend(fontsize=7, frameon=False, loc="lower right")


# One colour for a way of retrieval, alone and checked; checked curves that lie on one another stay visible by their widths.
COLOUR_OF = {"votes": "C0", "kd_tree": "C2", "vlad": "C4"}
WIDTH_OF = {"votes+check": 5.0, "kd_tree+check": 3.0}


def precision_recall_picture(folder: Path) -> Path:
    """precision_recall.png from precision_recall.csv of a places run."""
    curves: dict[str, list[tuple[float, float]]] = {}
    with (Path(folder) / "precision_recall.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            curves.setdefault(row["method"], []).append((float(row["recall"]), float(row["precision"])))
    protocols = {name: name.partition(": ")[0] if ": " in name else "" for name in curves}
    panels = [word for word in dict.fromkeys(protocols.values()) if word] or [""]
    figure = new_figure(5.5 * len(panels), 4.6)
    for number, panel in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), number + 1)
        for method, points in curves.items():
            if protocols[method] not in (panel, ""):
                continue
            recall, precision = np.array(points).T
            name = method.removeprefix(f"{panel}: ")
            kind, check, _ = name.partition("+check")
            colour = COLOUR_OF.get(kind, "black")
            style = "-" if check else ":" if method == "sequence" else "--"
            axes.plot(recall, precision, style, color=colour, linewidth=WIDTH_OF.get(name, 1.5), label=name)
            axes.plot(recall[-1], precision[-1], "o", color=colour, markersize=4)
        axes.set_title(f"queries: {panel}" if panel else "", fontsize=9)
        axes.set_xlabel("recall: share of all queries answered correctly")
        axes.set_ylabel("precision: share of the answers given that are correct")
        axes.set_ylim(min(0.7, axes.get_ylim()[0]), 1.01)
        axes.legend(fontsize=8, frameon=False, loc="lower center")
    return write_whole(Path(folder) / "precision_recall.png", lambda partial: save(figure, partial))
