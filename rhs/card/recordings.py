"""The card of a localiser or an odometry on somebody's recordings: what runs of it, and of ours beside it, came to.

The runs are those of the command line (task=localise, or the survey of a replay), made elsewhere; here is what is read off
their folders. Nothing is known of a recording but what its truth says, and where it has none little can be judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.config.dictionary import lines
from rhs.metrics.calibration import Beliefs, beliefs_of, searches
from rhs.metrics.localise import FOUND_WITHIN_M
from rhs.plots import new_figure
from rhs.runfolder.row import number_in
from rhs.runfolder.run import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = {
    "localiser": ("starts", "found_share", "found_m", "belief_right_share", "belief_sure_share", "belief_wrong_sure_share",
                  "belief_lost_share", "belief_ece", "localise_rmse_m", "localise_ms", "peak_memory_mb"),
    "odometry": ("tracked_share", "ate_rmse_m", "rpe_trans_m", "rpe_rot_rad", "relations_trans_m", "map_inconsistency",
                 "odometry_ms", "peak_memory_mb")}
JUDGED = {"localiser": "belief_right_share", "odometry": "rpe_trans_m"}  # not known without a truth
TOLD = {"localiser": "only how often it says that it is lost, its time and memory are known",
        "odometry": "only how many views it could follow, its time and memory are known"}
WRONG_SURE, HONEST_ECE, FOUND = 0.01, 0.05, 0.9  # as a run of task=localise succeeds; ECE of the honest
BESIDE = {"localiser": ("particle_filter_scan", "sift_db", "particle_filter"),  # ours, of which those that can are asked
          "odometry": ("keyframe", "procrustes", "scan_to_map", "monocular_vo", "wheel")}
MOST_BESIDE = 3
RESTART_M = 15.0  # of way from one start to the next, unless something else is typed: one start says little
Runs = Mapping[str, Sequence[Path]]  # part -> the folders of its runs, one for each recording


def meanings(kind: str) -> dict[str, str]:
    """What each column says."""
    known = {name: meaning for section, name, meaning in lines() if section == "Columns of a row"}
    return {name: known[name] for name in COLUMNS[kind] if name in known}


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
        return _of_localisers(part, {name: [_beliefs(folder) for folder in folders] for name, folders in runs.items()})
    from rhs.reports.table import rows
    from rhs.reports.ways import ways

    figure = ways(rows([folder for folders in runs.values() for folder in folders]), ["odometry"])
    return [] if figure is None else [("The ways over one another, and the truth where it is known", figure)]


def _beliefs(folder: Path) -> Beliefs:
    return beliefs_of([row for row in Run(folder).steps if row["phase"] == "localise"])


def _of_localisers(part: str, drives: Mapping[str, Sequence[Beliefs]]) -> list[tuple[str, Figure]]:
    from rhs.reports.calibration_pictures import draw_kidnaps, draw_reliability

    known = {name: [one for one in each if len(one.wrong_m)] for name, each in drives.items()}
    if not any(known.values()):
        return []
    figure = new_figure(10.0, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    starts = [each for one in known[part] for each in searches(one, one.kidnapped | one.started, FOUND_WITHIN_M)]
    draw_kidnaps(left, starts, what="start")
    draw_reliability(right, {name: (np.concatenate([one.probability for one in each]),
                                    np.concatenate([one.right for one in each])) for name, each in known.items() if each})
    return [("What followed each start; reliability of its stated chances beside ours", figure)]
