"""The numbers of a run, from the files of its folder alone. What is missing is NaN, never 0.

Names end in their unit. Errors of the survey stand beside the share of it they were measured on.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.api.trajectory import Trajectory, aligned, read_tum
from rhs.base.errors import RhsError
from rhs.patrol.gate_settings import GATED

from .accuracy import Pairing, absolute_errors_m, apart, consecutive, pair, relative_errors, rmse
from .calibration import knowing_values
from .map_agreement import map_agreement

NAN = float("nan")
Values = dict[str, float | int | str]
# Estimate and truth of one run carry the same stamps; a recording's truth is nearer than this at 30 Hz.
TOLERANCE_S = 0.02
# A place counts as visited when the robot truly stood this near it when it said so: twice the usual arrival distance.
VISITED_M = 0.5
# Each stage is timed where it does its work: elsewhere it only passes on.
STAGES = {"capture_ms": ("survey", "patrol"), "sense_ms": ("survey", "patrol"), "odometry_ms": ("survey", "patrol"),
          "localise_ms": ("patrol",), "map_ms": ("survey",)}
PATROL = ("patrol_steps", "places_total", "missions", "places_visited", "replans", "collisions", "clearance_min_m",
          "arrival_error_max_m", "patrol_rmse_m", "path_length_m", "path_optimal_m", "path_optimal_informed_m")


def evaluate(folder: Path) -> Values:
    """All columns that follow from the files of one run folder."""
    folder = Path(folder)
    if (folder / "plan.json").exists():  # of the planning task
        from .planning import evaluate_plan

        return evaluate_plan(folder)
    steps = _steps(folder / "steps.csv")
    survey, patrol = survey_values(folder, steps), patrol_values(folder, steps)
    knowing = knowing_values([row for row in steps if row["phase"] == "patrol"])
    return {**survey, **patrol, **knowing, **map_values(folder), **stage_values(folder, steps)}


# --- survey ----------------------------------------------------------------------------------------------------------


def survey_values(folder: Path, steps: list[dict[str, str]]) -> Values:
    """Accuracy and completeness of the survey, before and after closing the loop."""
    survey = [row for row in steps if row["phase"] == "survey"]
    truth, online = _trajectory(folder / "truth_survey.tum"), _trajectory(folder / "estimate.tum")
    closed = _trajectory(folder / "corrected.tum")
    closed = online if closed is None else closed
    values: Values = {"survey_steps": len(survey), **_status_shares(survey)}
    return values | trajectory_values(closed, truth) | _before_closing(online, truth)


def trajectory_values(estimate: Trajectory | None, truth: Trajectory | None, *, alignment: str = "se3",
                      tolerance_s: float = TOLERANCE_S) -> Values:
    """ATE and RPE of an estimate against the truth, and how much of the truth they cover."""
    if estimate is None or truth is None:
        return _no_trajectory(truth)
    both = pair(estimate, truth, tolerance_s)
    errors = absolute_errors_m(both, alignment)
    scaled = replace(both, estimate=aligned(both.estimate, both.truth, alignment))  # of weight for sim3 alone
    per_step = relative_errors(scaled, consecutive(len(both.truth)))
    per_metre = relative_errors(scaled, apart(both.truth.travelled_m, 1.0))
    per_second = relative_errors(scaled, apart(both.truth.stamps_s, 1.0))
    return {
        "matched_share": both.matched_share, "covered_share": both.covered_share,
        "distance_m": float(truth.travelled_m[-1]) if len(truth) else NAN,
        "ate_alignment": alignment, "ate_tolerance_s": tolerance_s, "ate_rmse_m": rmse(errors),
        "ate_mean_m": _of(np.mean, errors), "ate_median_m": _of(np.median, errors), "ate_max_m": _of(np.max, errors),
        "ate_unaligned_m": rmse(absolute_errors_m(both, "origin")),
        "rpe_trans_m": rmse(per_step[0]), "rpe_rot_rad": rmse(per_step[1]),
        "rpe_trans_per_metre_m": rmse(per_metre[0]), "rpe_rot_per_metre_rad": rmse(per_metre[1]),
        "rpe_trans_per_second_m": rmse(per_second[0]), "rpe_rot_per_second_rad": rmse(per_second[1]),
        "end_error_m": end_error_m(both), "half_error_m": half_error_m(both),
    }


def _no_trajectory(truth: Trajectory | None) -> Values:
    names = ("matched_share", "covered_share", "ate_rmse_m", "ate_mean_m", "ate_median_m", "ate_max_m",
             "ate_unaligned_m", "rpe_trans_m", "rpe_rot_rad", "rpe_trans_per_metre_m", "rpe_rot_per_metre_rad",
             "rpe_trans_per_second_m", "rpe_rot_per_second_rad", "end_error_m", "half_error_m")
    values: Values = dict.fromkeys(names, NAN)
    if truth is not None:
        values["matched_share"] = 0.0
    return values | {"ate_alignment": "", "ate_tolerance_s": NAN,
                     "distance_m": float(truth.travelled_m[-1]) if truth else NAN}


def end_error_m(both: Pairing) -> float:
    """Distance between the last paired poses when the first ones are made to agree."""
    errors = absolute_errors_m(both, "origin")
    return float(errors[-1]) if len(errors) else NAN


def half_error_m(both: Pairing) -> float:
    """The same half-way along the true path: on a closed loop a wrong scale cancels at the end, but not there."""
    errors = absolute_errors_m(both, "origin")
    travelled = both.truth.travelled_m
    return float(errors[np.searchsorted(travelled, 0.5 * travelled[-1])]) if len(errors) else NAN


def _before_closing(online: Trajectory | None, truth: Trajectory | None) -> Values:
    """The same of the poses as they were believed while the survey went on; drift is their end error per distance."""
    if online is None or truth is None:
        return {"ate_before_closing_m": NAN, "end_error_before_closing_m": NAN, "drift_pct": NAN}
    both = pair(online, truth, TOLERANCE_S)
    end, distance = end_error_m(both), both.truth.travelled_m[-1] if len(both.truth) else 0.0
    return {"ate_before_closing_m": rmse(absolute_errors_m(both, "se3")), "end_error_before_closing_m": end,
            "drift_pct": float(100.0 * end / distance) if distance > 0 else NAN}


def _status_shares(survey: list[dict[str, str]]) -> Values:
    count = len(survey)
    names = {"tracked_share": "ok", "degenerate_share": "degenerate", "lost_share": "lost"}
    shares: Values = {name: sum(row["motion_status"] == status for row in survey) / count if count else NAN
                      for name, status in names.items()}
    gated = sum(row["motion_reason"].startswith(GATED) for row in survey)
    return shares | {"gated_share": gated / count if count else NAN}


# --- patrol ----------------------------------------------------------------------------------------------------------


def patrol_values(folder: Path, steps: list[dict[str, str]]) -> Values:
    """What the patrol achieved, by the simulator's word wherever there is one. All unknown where nothing was asked."""
    facts = _json(folder / "facts.json") or {}
    places = [(place["x_m"], place["y_m"]) for place in facts.get("places", ())]
    if not places:
        return dict.fromkeys(PATROL, NAN)
    patrol = [row for row in steps if row["phase"] == "patrol"]
    missions = _json(folder / "missions.json") or []
    driven, believed = _trajectory(folder / "truth_patrol.tum"), _trajectory(folder / "patrol.tum")
    clearances = np.array([float(row["clearance_m"] or "nan") for row in patrol])
    errors = arrival_errors_m(missions, patrol)
    return {
        "patrol_steps": len(patrol), "places_total": len(places), "missions": len(missions),
        "places_visited": int(np.sum(~(errors > VISITED_M))), "replans": sum(int(m["replans"]) for m in missions),
        "collisions": _collisions(patrol) if np.isfinite(clearances).any() else NAN,
        "clearance_min_m": _of(np.min, clearances[np.isfinite(clearances)]),
        "arrival_error_max_m": _of(np.max, errors[np.isfinite(errors)]),
        "patrol_rmse_m": _unaligned_rmse_m(believed, driven),
        "path_length_m": float(driven.travelled_m[-1]) if driven else NAN,
        "path_optimal_m": path_optimal_m(folder, facts, patrol),
        "path_optimal_informed_m": path_optimal_informed_m(folder, facts, patrol),
    }


def _unaligned_rmse_m(believed: Trajectory | None, driven: Trajectory | None) -> float:
    if believed is None or driven is None:
        return NAN
    return rmse(absolute_errors_m(pair(believed, driven, TOLERANCE_S), "none"))


def arrival_errors_m(missions: list[dict], patrol: list[dict[str, str]]) -> np.ndarray:
    """(N,) true distance to the place in each step in which the robot said it had arrived; NaN where nobody knows."""
    said = [row for row in patrol if "arrived" in row["event"].split("+")]
    goals = [m["goal_m"][:2] for m in missions if m["status"] == "arrived"]
    at = [(float(row["true_x_m"] or "nan"), float(row["true_y_m"] or "nan")) for row in said]
    count = min(len(at), len(goals))
    return np.linalg.norm(np.reshape(at[:count], (-1, 2)) - np.reshape(goals[:count], (-1, 2)), axis=1)


def _collisions(patrol: list[dict[str, str]]) -> int:
    """Number of separate touches: a touch that lasts several steps counts once."""
    touching = np.array([row["collided"] == "1" for row in patrol], dtype=int)
    return int((np.diff(touching, prepend=0) == 1).sum())


def path_optimal_m(folder: Path, facts: dict, patrol: list[dict[str, str]]) -> float:
    """Length of the shortest way from where the patrol truly began through the places in order, on the true plan grown
    by the robot's radius; NaN without a true plan or where a place cannot be reached."""
    return _shortest_m(_map(folder / "true_map.yaml"), facts, patrol, _places(facts))


def path_optimal_informed_m(folder: Path, facts: dict, patrol: list[dict[str, str]]) -> float:
    """Length of the shortest way that learns of an unknown obstacle where this robot saw it: through the places it reached,
    and the true poses at which a mission was broken off, in the order they happened, on the true plan with obstacles."""
    plan = _map(folder / "true_map_patrol.yaml")
    places, stops = _places(facts), []
    for step in patrol:
        events = step["event"].split("+")
        if {"arrived", "gave_up"} & set(events) and places:
            place = places.pop(0)
            stops += [place] if "arrived" in events else []
        stops += [_true_xy(step)] if "blocked" in events else []
    return _shortest_m(_map(folder / "true_map.yaml") if plan is None else plan, facts, patrol, stops)


def _shortest_m(plan: OccupancyGrid | None, facts: dict, patrol: list[dict[str, str]], stops: list) -> float:
    """From where the patrol truly began through the stops, on the plan grown by the robot's radius."""
    if plan is None or not patrol or not patrol[0]["true_x_m"]:
        return NAN
    from .path_judge import shortest_length_m

    blocked = plan.blocked(float(facts["robot_radius_m"]))
    return float(shortest_length_m(blocked, plan.resolution_m, plan.origin_m, np.array([_true_xy(patrol[0]), *stops])))


def _places(facts: dict) -> list[tuple[float, float]]:
    return [(place["x_m"], place["y_m"]) for place in facts["places"]]


def _true_xy(step: dict[str, str]) -> tuple[float, float]:
    return float(step["true_x_m"]), float(step["true_y_m"])


def map_values(folder: Path) -> Values:
    """How far the map agrees with the true plan, and how much of the true free space was seen."""
    mine, true = _map(folder / "map.yaml"), _map(folder / "true_map.yaml")
    if mine is None or true is None:
        return {"map_agreement": NAN, "map_observed_share": NAN}
    return {**map_agreement(mine, true)}


# --- files -----------------------------------------------------------------------------------------------------------


def stage_values(folder: Path, steps: list[dict[str, str]]) -> Values:
    """Median time of each stage per view; plan_ms: median time of one call of the planner."""
    medians: Values = {}
    for stage, phases in STAGES.items():
        times = [float(row[stage]) for row in steps if row["phase"] in phases and row.get(stage)]
        medians[stage] = float(np.median(times)) if times else NAN
    calls = [float(plan["plan_ms"]) for plan in _json(folder / "plans.json") or []]
    return medians | {"plan_ms": float(np.median(calls)) if calls else NAN}


def _steps(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _trajectory(path: Path) -> Trajectory | None:
    trajectory = read_tum(path) if path.exists() else None
    return trajectory if trajectory is not None and len(trajectory) else None


def _json(path: Path):
    try:
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
    except ValueError as error:
        raise RhsError(f"{path} is not JSON: {error}") from error


def _map(path: Path) -> OccupancyGrid | None:
    if not path.exists():
        return None
    from rhs.worlds.maps import load_map

    return load_map(path)


def _of(function, values: np.ndarray) -> float:
    return float(function(values)) if len(values) else NAN
