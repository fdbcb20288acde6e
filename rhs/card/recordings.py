"""The card of a localiser or an odometry on somebody's recordings: what runs of it, and of ours beside it, came to.

The runs are those of the command line (task=localise, or the survey of a replay), made elsewhere; here is what is read off
their folders. Nothing is known of a recording but what its truth says, and where it has none little can be judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.belief import RIGHT_M, RIGHT_RAD
from rhs.api.geometry import wrap
from rhs.config.dictionary import lines
from rhs.metrics.accuracy import nees_of
from rhs.metrics.calibration import Beliefs, beliefs_of, searches
from rhs.metrics.localise import FOUND_WITHIN_M
from rhs.plots import new_figure
from rhs.reports.calibration_pictures import SURE, UNSURE, draw_knowing
from rhs.reports.drawing import COLOURS, draw_grid
from rhs.reports.ways import ways
from rhs.runfolder.row import number_in
from rhs.runfolder.run import Run, StepLine

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = {
    "localiser": ("starts", "found_share", "found_m", "belief_right_share", "belief_sure_share", "belief_wrong_sure_share",
                  "belief_lost_share", "belief_ece", "localise_rmse_m", "apart_share", "localise_ms", "peak_memory_mb"),
    "odometry": ("tracked_share", "ate_rmse_m", "rpe_trans_m", "rpe_rot_rad", "nees", "relations_trans_m",
                 "map_inconsistency", "odometry_ms", "peak_memory_mb")}
OF_CARD = {"nees": "squared error of the position, as believed on the way, by its stated variance, per dimension, mean: 1 "
                   "is honest, more is too sure",
           "apart_share": "views in which it and the part of this card both say that they track and stand more than 0.25 m "
                          "or 5 degrees apart: one of them is wrong. Needs no truth"}
JUDGED = {"localiser": "belief_right_share", "odometry": "rpe_trans_m"}  # not known without a truth
TOLD = {"localiser": "only how often it says that it is lost, whether others agree, its time and memory are "
                      "known",
        "odometry": "only how many views it could follow, its time and memory are known"}
WRONG_SURE, HONEST_ECE, FOUND = 0.01, 0.05, 0.9  # as a run of task=localise succeeds; ECE of the honest
BESIDE = {"localiser": ("particle_filter_scan", "sift_db", "particle_filter"),  # ours, of which those that can are asked
          "odometry": ("keyframe", "procrustes", "scan_to_map", "monocular_vo", "wheel")}
MOST_BESIDE = 3
RESTART_M = 15.0  # of way from one start to the next, unless something else is typed: one start says little
WRONG = "#c1121f"
PARTS, RECORDINGS = 3, 4  # more have no panel in the picture of beliefs
PANEL_IN, MARGIN_M = 4.4, 4.0
Runs = Mapping[str, Sequence[Path]]  # part -> the folders of its runs, one for each recording


def meanings(kind: str) -> dict[str, str]:
    """What each column says."""
    known = {name: meaning for section, name, meaning in lines() if section == "Columns of a row"} | OF_CARD
    return {name: known[name] for name in COLUMNS[kind] if name in known}


def of_card(kind: str, folder: Path, mine: Path | None) -> dict[str, float]:
    """What no row has of a run, of OF_CARD. mine: the run of the part of the card on the same recording, None for itself."""
    if kind == "odometry":
        return {"nees": nees_of(folder)}
    return {} if mine is None else {"apart_share": apart_share(_steps(folder), _steps(mine))}


def apart_share(steps: Sequence[Mapping[str, str]], others: Sequence[Mapping[str, str]]) -> float:
    """Of the views that both saw, those in which both are sure and stand apart; NaN where there is none."""
    beside = {step["stamp_s"]: step for step in others}
    both = [(step, beside[step["stamp_s"]]) for step in steps if step["stamp_s"] in beside]
    return float(np.mean([_apart(one, other) for one, other in both])) if both else float("nan")


def _apart(one: Mapping[str, str], other: Mapping[str, str]) -> bool:
    if not one["belief_status"] == other["belief_status"] == "tracking":
        return False
    x_m, y_m, yaw_rad = (float(one[name]) - float(other[name]) for name in ("x_m", "y_m", "yaw_rad"))
    return bool(np.hypot(x_m, y_m) > RIGHT_M or abs(wrap(np.array(yaw_rad))) > RIGHT_RAD)


def figures(kind: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """The columns of a part, the mean over its recordings of those that are known; the most memory."""
    found = {}
    for name in COLUMNS[kind]:
        values = np.array([number_in(row, name) for row in rows])
        values = values[np.isfinite(values)]
        if len(values):
            found[name] = float({"starts": values.sum(), "peak_memory_mb": values.max()}.get(name, values.mean()))
    return found


def sentences(kind: str, mine: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """What is to be said of a part. mine: recording -> its row."""
    said = []
    for name, row in mine.items():
        if row["status"] != "ok":
            said.append(f"{name}: {row['status']}: {row.get('reason') or 'it left no row'}")
        elif np.isfinite(number_in(row, "relations_trans_m")):
            said.append(f"{name}: {100 * number_in(row, 'relations_trans_m'):.3g} cm off in the mean by its relations; "
                        f"of the walls {100 * number_in(row, 'map_inconsistency'):.1f} % are seen through from elsewhere")
        elif not np.isfinite(number_in(row, JUDGED[kind])):
            said.append(f"{name} has no truth (source.truth=FILE): {TOLD[kind]}")
        elif kind == "localiser":
            said.append(f"{name}: {_localised(row)}")
        else:
            said.append(f"{name}: {100 * number_in(row, 'ate_rmse_m'):.3g} cm off after closing (ATE), "
                        f"{100 * number_in(row, 'tracked_share'):.0f} % of the views followed")
    return said


def _localised(row: Mapping[str, Any]) -> str:
    share, metres = number_in(row, "found_share"), number_in(row, "found_m")
    wrong, ece = number_in(row, "belief_wrong_sure_share"), number_in(row, "belief_ece")
    found = (f"found after {share * number_in(row, 'starts'):.0f} of {row.get('starts')} starts"
             f"{f' ({100 * FOUND:.0f} % wanted)' if share < FOUND else ''}"
             f"{f', within {metres:.1f} m' if np.isfinite(metres) else ''}")
    sure = f"wrong and sure in {100 * wrong:.1f} % of the views" + (" (1 % at most wanted)" if wrong > WRONG_SURE else "")
    honest = f"calibration error {ece:.3f}" + (f" ({HONEST_ECE:g} wanted)" if ece > HONEST_ECE else "")
    return f"{found}, {sure}, {honest}"


def pictures(kind: str, part: str, runs: Runs) -> list[tuple[str, Figure]]:
    """What there is to be seen."""
    if kind == "localiser":
        drives = {name: [beliefs_of(_steps(folder)) for folder in folders] for name, folders in runs.items()}
        return [*_of_localisers(part, drives), *beliefs_in_maps(runs)]
    from rhs.reports.table import rows

    figure = ways(rows([folder for folders in runs.values() for folder in folders]), ["odometry"])
    return [] if figure is None else [("The ways over one another, and the truth where it is known", figure)]


def _steps(folder: Path) -> list[StepLine]:
    return [row for row in Run(folder).steps if row["phase"] == "localise"]


def _of_localisers(part: str, drives: Mapping[str, Sequence[Beliefs]]) -> list[tuple[str, Figure]]:
    known = {name: [one for one in each if len(one.wrong_m)] for name, each in drives.items()}
    if not any(known.values()):
        return []
    starts = [each for one in known[part] for each in searches(one, one.kidnapped | one.started, FOUND_WITHIN_M)]
    return [("What followed each start; reliability of its stated chances beside ours",
             draw_knowing(starts, known, what="start"))]


def beliefs_in_maps(runs: Mapping[str, Sequence[Path]]) -> list[tuple[str, Figure]]:
    """The picture and its title; none where no view was believed. runs: part -> a folder for each recording."""
    found = {(part, row): steps for part, folders in list(runs.items())[:PARTS] for row, folder in
             enumerate(folders[:RECORDINGS]) if (steps := _steps(folder))}
    if not found:
        return []
    parts, rows = list(dict.fromkeys(part for part, _ in found)), 1 + max(row for _, row in found)
    figure = new_figure(PANEL_IN * len(parts), PANEL_IN * rows)
    for (part, row), steps in found.items():
        axes = figure.add_subplot(rows, len(parts), row * len(parts) + parts.index(part) + 1)
        axes.set_title(part if rows == 1 else f"{part}, recording {row + 1}", fontsize=9)
        _panel(axes, runs[part][row], steps)
    return [("Where it believed to be [m] (blue: says tracking, grey: does not, red: says so and is wrong; line: the truth)",
             figure)]


def _panel(axes: Axes, folder: Path, steps: Sequence[StepLine]) -> None:
    if (grid := Run(folder).grid("map")) is not None:
        draw_grid(axes, grid)
    xy_m = np.array([[float(step["x_m"]), float(step["y_m"])] for step in steps])
    sure = np.array([step["belief_status"] == "tracking" for step in steps])
    beliefs, wrong = beliefs_of(steps), np.zeros(len(steps), bool)
    wrong[[bool(step["true_x_m"]) for step in steps]] = ~beliefs.right
    axes.plot(beliefs.xy_m[:, 0], beliefs.xy_m[:, 1], color=COLOURS["truth"], linewidth=0.6)
    for which, colour, size in ((~sure, UNSURE, 3), (sure & ~wrong, SURE, 3), (sure & wrong, WRONG, 7)):
        axes.scatter(xy_m[which, 0], xy_m[which, 1], s=size, color=colour, linewidths=0, zorder=3)
    went = beliefs.xy_m if len(beliefs.xy_m) else xy_m
    (west, south), (east, north) = went.min(axis=0) - MARGIN_M, went.max(axis=0) + MARGIN_M
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    axes.set_aspect("equal", adjustable="box")
    axes.tick_params(labelsize=7)
