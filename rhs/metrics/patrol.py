"""What the patrol achieved, and what each stage of the loop cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.api.metric import LOOP, RunFiles, columns_of
from rhs.api.robot_shape import Footprint

from .accuracy import absolute_errors_m, pair, rmse
from .survey import NAN, TOLERANCE_S, Values, of_any, touches

# A place counts as visited when the robot truly stood this near it when it said so: twice the usual arrival distance.
VISITED_M = 0.5
# Each stage is timed where it does its work: elsewhere it only passes on.
EVERY_PHASE = ("survey", "patrol", "localise")
STAGES = {"capture_ms": EVERY_PHASE, "sense_ms": EVERY_PHASE, "odometry_ms": EVERY_PHASE,
          "localise_ms": ("patrol", "localise"), "map_ms": ("survey",)}


def patrol_steps(run: RunFiles) -> Sequence[Mapping[str, str]]:
    """The lines of steps.csv that belong to the patrol."""
    return [row for row in run.steps if row["phase"] == "patrol"]


def patrol_values(run: RunFiles) -> Values:
    """What the patrol achieved, by the simulator's word wherever there is one. All unknown where nothing was asked."""
    facts = run.json("facts") or {}
    places = _places(facts)
    if not places:
        return {metric.name: NAN for metric in PATROL}
    patrol = patrol_steps(run)
    missions = run.json("missions") or []
    driven, believed = run.trajectory("truth_patrol"), run.trajectory("patrol")
    errors = arrival_errors_m(missions, patrol)
    return {
        "patrol_steps": len(patrol), "places_total": len(places), "missions": len(missions),
        **within_reach(run, facts),
        "places_visited": int(np.sum(~(errors > VISITED_M))), "replans": sum(int(m["replans"]) for m in missions),
        **touches(patrol, ""),
        "arrival_error_max_m": of_any(np.max, errors[np.isfinite(errors)]),
        "patrol_rmse_m": NAN if believed is None or driven is None else rmse(
            absolute_errors_m(pair(believed, driven, TOLERANCE_S), "none")),
        "path_length_m": float(driven.travelled_m[-1]) if driven else NAN,
        "path_optimal_m": path_optimal_m(run, facts, patrol),
        "path_optimal_informed_m": path_optimal_informed_m(run, facts, patrol),
    }


def within_reach(run: RunFiles, facts: dict) -> Values:
    """How many places a robot of this size can get to, and of how many nobody can tell; unknown without a true plan."""
    found = run.json("reach")
    if found is None:
        return {"places_reachable": NAN, "places_undecided": NAN}
    surely, perhaps = gets_to(found, facts)
    return {"places_reachable": int(surely.sum()), "places_undecided": int((perhaps & ~surely).sum())}


def gets_to(found: dict, facts: dict) -> tuple[np.ndarray, np.ndarray]:
    """((N,) bool: a robot of this size surely gets to each place of reach.json, (N,) bool: at least perhaps)."""
    room_m, unsure_m = np.array([place["room_m"] for place in found["places"]]), found["unsure_m"]
    wide_m, narrow_m = body_radii_m(facts)
    return room_m >= wide_m + unsure_m, room_m >= narrow_m - unsure_m


def body_radii_m(facts: dict) -> tuple[float, float]:
    """Radii of the discs about the turning point that hold the robot's body, and that it holds: the same of a round one."""
    wide_m = float(facts["robot_radius_m"])
    if not (corners := facts.get("footprint_m")):
        return wide_m, wide_m
    return wide_m, Footprint(tuple((x, y) for x, y in corners)).half_m


def arrival_errors_m(missions: list[dict], patrol: Sequence[Mapping[str, str]]) -> np.ndarray:
    """(N,) true distance to the place in each step in which the robot said it had arrived; NaN where nobody knows."""
    said = [row for row in patrol if "arrived" in row["event"].split("+")]
    goals = [m["goal_m"][:2] for m in missions if m["status"] == "arrived"]
    at = [(float(row["true_x_m"] or "nan"), float(row["true_y_m"] or "nan")) for row in said]
    count = min(len(at), len(goals))
    return np.linalg.norm(np.reshape(at[:count], (-1, 2)) - np.reshape(goals[:count], (-1, 2)), axis=1)


def arrived_elsewhere(missions: list[dict], patrol: Sequence[Mapping[str, str]]) -> dict[str, float]:
    """Number of each mission that ended where the robot only believed its place to be: how far from it it truly stood,
    metres. None where nobody knows the truth."""
    errors, arrived = arrival_errors_m(missions, patrol), (m for m in missions if m["status"] == "arrived")
    return {str(m["mission"]): float(off) for m, off in zip(arrived, errors, strict=False) if off > VISITED_M}


def path_optimal_m(run: RunFiles, facts: dict, patrol: Sequence[Mapping[str, str]]) -> float:
    """Length of the shortest way from where the patrol truly began through the places in order, on the true plan grown
    by the robot's radius; NaN without a true plan or where a place cannot be reached."""
    return _shortest_m(run.grid("true_map"), facts, patrol, _places(facts))


def path_optimal_informed_m(run: RunFiles, facts: dict, patrol: Sequence[Mapping[str, str]]) -> float:
    """Length of the shortest way that learns of an unknown obstacle where this robot saw it: through the places it reached,
    and the true poses at which a mission was broken off, in the order they happened, on the true plan with obstacles."""
    plan = run.grid("true_map_patrol")
    places, stops = _places(facts), []
    for step in patrol:
        events = step["event"].split("+")
        if {"arrived", "gave_up"} & set(events) and places:
            place = places.pop(0)
            stops += [place] if "arrived" in events else []
        if "skipped" in events and places:
            places.append(places.pop(0))
        stops += [_true_xy(step)] if {"blocked", "skipped"} & set(events) else []
    return _shortest_m(run.grid("true_map") if plan is None else plan, facts, patrol, stops)


def _shortest_m(plan: OccupancyGrid | None, facts: dict, patrol: Sequence[Mapping[str, str]], stops: list) -> float:
    """From where the patrol truly began through the stops, on the plan grown by the robot's radius."""
    if plan is None or not patrol or not patrol[0]["true_x_m"]:
        return NAN
    from .path_judge import shortest_length_m

    blocked = plan.blocked(float(facts["robot_radius_m"]))
    return float(shortest_length_m(blocked, plan.resolution_m, plan.origin_m, np.array([_true_xy(patrol[0]), *stops])))


def _places(facts: dict) -> list[tuple[float, float]]:
    return [(place["x_m"], place["y_m"]) for place in facts.get("places", ())]


def _true_xy(step: Mapping[str, str]) -> tuple[float, float]:
    return float(step["true_x_m"]), float(step["true_y_m"])


def stage_values(run: RunFiles) -> Values:
    """Median time of each stage per view; plan_ms: median time of one call of the planner."""
    medians: Values = {}
    for stage, phases in STAGES.items():
        times = [float(row[stage]) for row in run.steps if row["phase"] in phases and row.get(stage)]
        medians[stage] = float(np.median(times)) if times else NAN
    calls = [float(plan["plan_ms"]) for plan in run.json("plans") or []]
    return medians | {"plan_ms": float(np.median(calls)) if calls else NAN}


PATROL = columns_of(
    patrol_values,
    ("patrol_steps", "", "views of the patrol", "steps.csv"),
    ("places_total", "", "places to visit", "facts.json"),
    ("places_reachable", "",
     "of those, places to which a disc of the robot's size gets (within 0.5 m) from where the patrol began, among walls and "
     "boxes as they then stood, with 1.4 cm to spare beside it: as far as the widest way is known (more beyond 20 x 20 m)",
     "reach.json, truth"),
    ("places_undecided", "", "of those, places of which that margin leaves open whether it does: not counted as reachable",
     "reach.json, truth"),
    ("missions", "", "missions begun: a place whose way was blocked counts again", "missions.json"),
    ("places_visited", "",
     "places at which the robot truly stood (within 0.5 m) when it said that it had arrived",
     "steps.csv, truth"),
    ("replans", "", "new plans because the path was blocked or left", "missions.json"),
    ("collisions", "", "separate contacts with anything in the patrol, by the simulator", "steps.csv, truth"),
    ("clearance_min_m", "m", "least distance from the robot's body to anything in the patrol", "steps.csv, truth"),
    ("arrival_error_max_m", "m",
     "largest true distance to the place when the robot said that it had arrived",
     "steps.csv, truth"),
    ("patrol_rmse_m", "m",
     "error of the belief in the patrol, root mean square, nothing aligned",
     "patrol.tum, truth_patrol.tum"),
    ("path_length_m", "m", "true length of the patrol's trajectory", "truth_patrol.tum"),
    ("path_optimal_m", "m",
     "shortest way from where the patrol began through all places, on the true plan without obstacles",
     "rhs.metrics.path_judge"),
    ("path_optimal_informed_m", "m",
     "shortest way that learns of obstacles where this robot saw them, through the places it reached",
     "rhs.metrics.path_judge"),
    tasks=("patrol", "blame"),  # a survey alone was asked to visit none
    counts=("patrol_steps", "places_total", "places_reachable", "places_undecided", "missions", "places_visited", "replans",
            "collisions"),
    more_is_better=("places_visited", "clearance_min_m"),
)
STAGES_MS = columns_of(
    stage_values,
    ("capture_ms", "ms", "median time of rendering or reading a view", "steps.csv"),
    ("sense_ms", "ms", "median time of the sensor", "steps.csv"),
    ("odometry_ms", "ms", "median time of the odometry", "steps.csv"),
    ("localise_ms", "ms", "median time of the localiser, in the patrol or in task=localise", "steps.csv"),
    ("map_ms", "ms", "median time of the mapper in the survey", "steps.csv"),
    ("plan_ms", "ms", "median time of a call of the planner in the patrol", "plans.json"),
    tasks=(*LOOP, "localise"),
)
