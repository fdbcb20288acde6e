"""How good the survey is: accuracy before and after closing the loop, beside the share of it that was measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rhs.api.metric import RunFiles, columns_of
from rhs.api.trajectory import Trajectory, aligned

from .accuracy import Pairing, absolute_errors_m, apart, consecutive, pair, relative_errors, rmse
from .truth_clock import truth_offset

NAN = float("nan")
Values = dict[str, float | int | str]
# Estimate and truth of one run carry the same stamps; a recording's truth is nearer than this at 30 Hz.
TOLERANCE_S = 0.02
STATUSES = {"tracked_share": "ok", "degenerate_share": "degenerate", "lost_share": "lost"}


def survey_values(run: RunFiles) -> Values:
    """Accuracy and completeness of the survey, before and after closing the loop."""
    survey = [row for row in run.steps if row["phase"] == "survey"]
    truth, online, closed = (run.trajectory(name) for name in ("truth_survey", "estimate", "corrected"))
    closed = online if closed is None else closed
    shares = {name: share(survey, "motion_status", status) for name, status in STATUSES.items()}
    values: Values = {"survey_steps": len(survey), **shares, "gated_share": share(survey, "motion_replaced", "1"),
                      **touches(survey, "survey_")}
    known = scale_known(survey)
    how = "sim3" if known == 0.0 else "se3"
    return values | {"scale_known": known} | trajectory_values(closed, truth, alignment=how) | _before_closing(
        online, truth, how)


def scale_known(survey: Sequence[Mapping[str, str]]) -> float:
    """1 where the odometry's metres are metres, 0 where it says itself at the end that nobody told it the scale; NaN without
    views. Only the word against itself is believed."""
    if not survey:
        return NAN
    return 0.0 if survey[-1].get("motion_scale_known", "") in ("0", "0.0") else 1.0


def touches(steps: Sequence[Mapping[str, str]], phase: str) -> Values:
    """Touches and least clearance of the steps of a phase, by the simulator; unknown where nobody judged. A touch that lasts
    several steps counts once."""
    clearances = np.array([float(row["clearance_m"] or "nan") for row in steps])
    judged = clearances[np.isfinite(clearances)]
    touching = np.array([row["collided"] == "1" for row in steps], dtype=int)
    count = int((np.diff(touching, prepend=0) == 1).sum())
    return {f"{phase}collisions": count if len(judged) else NAN, f"{phase}clearance_min_m": of_any(np.min, judged)}


def trajectory_values(estimate: Trajectory | None, truth: Trajectory | None, *, alignment: str = "se3",
                      tolerance_s: float = TOLERANCE_S) -> Values:
    """ATE and RPE of an estimate against the truth, and how much of the truth they cover."""
    if estimate is None or truth is None:
        unknown: Values = dict.fromkeys(ACCURACY, NAN)
        return unknown | {"ate_alignment": "", "matched_share": NAN if truth is None else 0.0,
                          "distance_m": float(truth.travelled_m[-1]) if truth else NAN}
    both = pair(estimate, truth, tolerance_s)
    errors = absolute_errors_m(both, alignment) if len(both.truth) > 1 else np.zeros(0)  # one pose fits any truth
    scaled = _scaled(both, alignment)
    per_step = relative_errors(scaled, consecutive(len(both.truth)))
    per_metre = relative_errors(scaled, apart(both.truth.travelled_m, 1.0))
    per_second = relative_errors(scaled, apart(both.truth.stamps_s, 1.0))
    offset_s, ate_at_offset_m = truth_offset(estimate, truth, alignment)
    return {
        "matched_share": both.matched_share, "covered_share": both.covered_share,
        "distance_m": float(truth.travelled_m[-1]) if len(truth) else NAN,
        "ate_alignment": alignment, "ate_tolerance_s": tolerance_s, "ate_rmse_m": rmse(errors),
        "ate_mean_m": of_any(np.mean, errors), "ate_median_m": of_any(np.median, errors),
        "ate_max_m": of_any(np.max, errors), "ate_unaligned_m": rmse(absolute_errors_m(both, "origin")),
        "rpe_trans_m": rmse(per_step[0]), "rpe_rot_rad": rmse(per_step[1]),
        "rpe_trans_per_metre_m": rmse(per_metre[0]), "rpe_rot_per_metre_rad": rmse(per_metre[1]),
        "rpe_trans_per_second_m": rmse(per_second[0]), "rpe_rot_per_second_rad": rmse(per_second[1]),
        "end_error_m": end_error_m(scaled), "half_error_m": half_error_m(scaled),
        "truth_offset_s": offset_s, "ate_at_offset_m": ate_at_offset_m,
    }


def _scaled(both: Pairing, alignment: str) -> Pairing:
    """The pairing whose metres are metres: of an estimate without a scale, that of the alignment."""
    return replace(both, estimate=aligned(both.estimate, both.truth, alignment)) if alignment == "sim3" else both


def end_error_m(both: Pairing) -> float:
    """Distance between the last paired poses when the first ones are made to agree."""
    errors = absolute_errors_m(both, "origin")
    return float(errors[-1]) if len(errors) else NAN


def half_error_m(both: Pairing) -> float:
    """The same half-way along the true path: on a closed loop a wrong scale cancels at the end, but not there."""
    errors = absolute_errors_m(both, "origin")
    travelled = both.truth.travelled_m
    return float(errors[np.searchsorted(travelled, 0.5 * travelled[-1])]) if len(errors) else NAN


def _before_closing(online: Trajectory | None, truth: Trajectory | None, how: str) -> Values:
    """The same of the poses as they were believed while the survey went on; drift is their end error per distance."""
    if online is None or truth is None:
        return {"ate_before_closing_m": NAN, "end_error_before_closing_m": NAN, "drift_pct": NAN}
    both = pair(online, truth, TOLERANCE_S)
    end, distance = end_error_m(_scaled(both, how)), both.truth.travelled_m[-1] if len(both.truth) else 0.0
    return {"ate_before_closing_m": rmse(absolute_errors_m(both, how)), "end_error_before_closing_m": end,
            "drift_pct": float(100.0 * end / distance) if distance > 0 else NAN}


def share(steps: Sequence[Mapping[str, str]], column: str, word: str) -> float:
    """Share of the steps that have this word in a column; NaN of none."""
    return sum(row.get(column) == word for row in steps) / len(steps) if steps else NAN


def of_any(function: Callable[[np.ndarray], float], values: np.ndarray) -> float:
    """A statistic of (N,) values; NaN of none."""
    return float(function(values)) if len(values) else NAN


ACCURACY = (
    "matched_share", "covered_share", "ate_tolerance_s", "ate_rmse_m", "ate_mean_m", "ate_median_m", "ate_max_m",
    "ate_unaligned_m", "rpe_trans_m", "rpe_rot_rad", "rpe_trans_per_metre_m", "rpe_rot_per_metre_rad",
    "rpe_trans_per_second_m", "rpe_rot_per_second_rad", "end_error_m", "half_error_m", "truth_offset_s", "ate_at_offset_m",
)

SURVEY = columns_of(
    survey_values,
    ("survey_steps", "", "views of the survey", "steps.csv"),
    ("survey_collisions", "",
     "separate contacts with anything in the survey, by the simulator, whether the robot was led or explored",
     "steps.csv, truth"),
    ("survey_clearance_min_m", "m", "least distance from the robot's body to anything in the survey", "steps.csv, truth"),
    ("tracked_share", "share", "views of the survey whose motion was measured (status ok)", "steps.csv"),
    ("degenerate_share", "share", "views in which some direction was not observed", "steps.csv"),
    ("lost_share", "share", "views in which nothing was measured", "steps.csv"),
    ("gated_share", "share",
     "views whose motion the gate replaced because it contradicted the wheels or jumped",
     "rhs.patrol.gate"),
    ("scale_known", "",
     "0: the scale of a single camera is unknown; ATE and RPE are then after an alignment with scale (sim3)",
     "steps.csv"),
    ("matched_share", "share", "poses of the truth that the estimate was compared with", "rhs.metrics.accuracy.pair"),
    ("covered_share", "share",
     "length of the true trajectory between the first and the last pose compared",
     "rhs.metrics.accuracy.pair"),
    ("distance_m", "m", "length of the survey's true trajectory", "truth_survey.tum"),
    ("ate_alignment", "", "alignment of the absolute trajectory error: se3, sim3, origin or none", "Sturm et al. 2012"),
    ("ate_tolerance_s", "s", "most time between an estimate and the truth it is compared with", "Sturm et al. 2012"),
    ("ate_rmse_m", "m", "absolute trajectory error after closing the loop, root mean square", "Sturm et al. 2012"),
    ("ate_mean_m", "m", "absolute trajectory error, mean", "Sturm et al. 2012"),
    ("ate_median_m", "m", "absolute trajectory error, median", "Sturm et al. 2012"),
    ("ate_max_m", "m", "absolute trajectory error, largest", "Sturm et al. 2012"),
    ("ate_unaligned_m", "m",
     "absolute trajectory error with only the first poses made to agree, root mean square",
     "Sturm et al. 2012"),
    ("rpe_trans_m", "m", "relative pose error from view to view, root mean square", "Sturm et al. 2012"),
    ("rpe_rot_rad", "rad", "the same of the rotation", "Sturm et al. 2012"),
    ("rpe_trans_per_metre_m", "m",
     "relative pose error over stretches of one metre, root mean square",
     "Sturm et al. 2012"),
    ("rpe_rot_per_metre_rad", "rad", "the same of the rotation", "Sturm et al. 2012"),
    ("rpe_trans_per_second_m", "m",
     "relative pose error over stretches of one second, root mean square",
     "Sturm et al. 2012"),
    ("rpe_rot_per_second_rad", "rad", "the same of the rotation", "Sturm et al. 2012"),
    ("end_error_m", "m", "distance of the last poses when the first ones agree, after closing the loop", "thesis 3.5"),
    ("half_error_m", "m",
     "the same half-way along the true trajectory: on a closed loop a wrong scale cancels at the end, not there",
     "rhs.metrics.survey"),
    ("truth_offset_s", "s",
     "by which the stamps of the truth are later than those of the recording at the same instants, by how the body turns "
     "and goes; 0 where the clocks agree as far as can be told; no figure is corrected by it", "rhs.metrics.truth_clock"),
    ("ate_at_offset_m", "m", "absolute trajectory error with that offset taken off; unknown where it is 0",
     "rhs.metrics.truth_clock"),
    ("ate_before_closing_m", "m", "absolute trajectory error before loop closing, as estimated during the survey",
     "Sturm et al. 2012"),
    ("end_error_before_closing_m", "m", "end error before loop closing, as estimated during the survey", "thesis 3.5"),
    ("drift_pct", "%", "end error before closing, share of the distance", "rhs.metrics.survey"),
    words=("ate_alignment",),
    counts=("survey_steps", "survey_collisions"),
    more_is_better=("survey_clearance_min_m", "tracked_share", "matched_share", "covered_share"),
)
