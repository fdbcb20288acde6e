"""How long places went without a visit, beside the exact least that was possible, and what blocked ways cost.

Idleness: Machado, Ramalho, Zucker and Drogoul, "Multi-agent patrolling: an empirical analysis of alternative architectures",
MABS 2002: of a place at a time, the seconds since it was last visited. The survey counts as a visit of all when the patrol
begins. Bounds: Chevaleyre, "Theoretical analysis of the multi-agent patrolling problem", IAT 2004; for one robot the worst
idleness of a patrol that goes on for ever is at least the shortest round trip over its speed, and following that trip
attains it. Of a patrol that visits each place once and ends, it is at least the shortest way through all of them.
"""

from __future__ import annotations

import numpy as np

from rhs.api.metric import RunFiles, columns_of

from .patrol import _shortest_m, _true_xy, patrol_steps
from .survey import NAN, Values

MOST_PLACES = 12  # more are not tried: the exact search takes 2^n steps
LOST_PLACE = 0.5  # an arrival further from the place is none, metres: as places_visited has it


def arrivals(run: RunFiles) -> list[tuple[str, float, tuple[float, float]]]:
    """(place, seconds of the patrol, where the robot truly stood) of each time that it said it had arrived and truly had."""
    patrol = patrol_steps(run)
    if not patrol or not patrol[0]["true_x_m"]:
        return []
    begun_s = float(patrol[0]["stamp_s"])
    arrived = [m for m in run.json("missions") or [] if m["status"] == "arrived"]
    said = [step for step in patrol if "arrived" in step["event"].split("+")]
    return [(str(mission["place"]), float(step["stamp_s"]) - begun_s, _true_xy(step))
            for mission, step in zip(arrived, said, strict=False)
            if np.hypot(*np.subtract(_true_xy(step), mission["goal_m"][:2])) <= LOST_PLACE]


def visits(run: RunFiles) -> tuple[list[tuple[float, float]], list[list[float]], float]:
    """(places (x, y), times in seconds of the patrol at which the robot truly stood at each, how long the patrol took)."""
    facts, patrol = run.json("facts") or {}, patrol_steps(run)
    places = {str(place["name"]): (float(place["x_m"]), float(place["y_m"])) for place in facts.get("places", ())}
    times: dict[str, list[float]] = {name: [] for name in places}
    if not patrol or not patrol[0]["true_x_m"]:
        return list(places.values()), list(times.values()), NAN
    for place, when_s, _ in arrivals(run):
        if place in times:
            times[place].append(when_s)
    return list(places.values()), list(times.values()), float(patrol[-1]["stamp_s"]) - float(patrol[0]["stamp_s"])


def idleness(times_s: list[list[float]], end_s: float) -> tuple[float, float]:
    """(worst, mean) idleness in seconds over the places and over the time from 0 to end_s; all were visited at 0."""
    gaps = [np.diff([0.0, *sorted(times), end_s]) for times in times_s]
    worst = max(float(gap.max()) for gap in gaps)
    mean = sum(0.5 * float((gap**2).sum()) for gap in gaps) / (len(gaps) * end_s) if end_s > 0.0 else 0.0
    return worst, mean


def shortest_trips(lengths: np.ndarray) -> tuple[float, float]:
    """(shortest way from node 0 through all others, shortest round trip through the others), of a symmetric matrix (N, N) of
    lengths: exact, by dynamic programming over subsets (Held and Karp 1962; Bellman 1962)."""
    return _held_karp(lengths, closed=False), _held_karp(lengths[1:, 1:], closed=True)


def _held_karp(lengths: np.ndarray, *, closed: bool) -> float:
    """Shortest way that begins in node 0 and passes all others; closed: and ends there."""
    count = len(lengths) - 1
    if count <= 0:
        return 0.0
    best = np.full((1 << count, count), np.inf)
    best[1 << np.arange(count), np.arange(count)] = lengths[0, 1:]
    for visited in range(1, 1 << count):
        for last in np.nonzero(np.isfinite(best[visited]))[0]:
            for new in range(count):
                if not visited >> new & 1:
                    longer = best[visited, last] + lengths[last + 1, new + 1]
                    best[visited | 1 << new, new] = min(best[visited | 1 << new, new], longer)
    return float((best[-1] + lengths[1:, 0]).min() if closed else best[-1].min())


def bounds_s(run: RunFiles, places: list[tuple[float, float]]) -> tuple[float, float]:
    """(least worst idleness of a patrol that visits every reachable place once and ends, of one that goes on for ever),
    seconds: the exact shortest trips on the true plan at the highest speed that was commanded."""
    from .path_judge import Optimum

    facts, patrol = run.json("facts") or {}, patrol_steps(run)
    plan = run.grid("true_map_patrol") or run.grid("true_map")
    speeds = [float(step["forward_mps"]) for step in patrol if step["forward_mps"]]
    if plan is None or len(places) > MOST_PLACES or not speeds or max(speeds) <= 0.0:
        return NAN, NAN
    optimum = Optimum(plan.blocked(float(facts["robot_radius_m"])), plan.resolution_m, plan.origin_m)
    nodes = [_true_xy(patrol[0]), *dict.fromkeys(places)]
    lengths = np.zeros((len(nodes), len(nodes)))
    for i in range(len(nodes)):
        for j in range(i):
            lengths[i, j] = lengths[j, i] = optimum.length_m(np.array([nodes[i], nodes[j]]))
    can = np.isfinite(lengths[0])
    if can.sum() < 2:
        return NAN, NAN
    once_m, for_ever_m = shortest_trips(lengths[np.ix_(can, can)])
    return once_m / max(speeds), for_ever_m / max(speeds)


def idleness_values(run: RunFiles) -> Values:
    """All columns; unknown where nobody drove."""
    places, times, end_s = visits(run)
    patrol, missions = patrol_steps(run), run.json("missions") or []
    if not places or not patrol:
        return {metric.name: NAN for metric in IDLENESS}
    worst, mean = idleness(times, end_s) if np.isfinite(end_s) else (NAN, NAN)
    once_s, for_ever_s = bounds_s(run, places) if np.isfinite(end_s) else (NAN, NAN)
    put_off = {(m["place"], *m["goal_m"]) for m in missions if m["status"] == "skipped"}
    later = {(m["place"], *m["goal_m"]) for m in missions if m["status"] == "arrived"} & put_off
    waiting = [step for step in patrol if {"wait", "ask"} & set(step["event"].split("+"))]
    return {"idleness_worst_s": worst, "idleness_mean_s": mean, "idleness_bound_s": once_s, "idleness_cycle_s": for_ever_s,
            "views_waited": len(waiting), "extra_way_m": extra_way_m(run), "places_skipped": len(put_off),
            "places_visited_later": len(later)}


def extra_way_m(run: RunFiles) -> float:
    """Metres driven beyond the shortest way through the places that the robot said it reached, in the order of the world, on
    the plan without obstacles and people."""
    driven, facts, missions = run.trajectory("truth_patrol"), run.json("facts") or {}, run.json("missions") or []
    arrived = [m["goal_m"][:2] for m in missions if m["status"] == "arrived"]
    stops = [(p["x_m"], p["y_m"]) for p in facts.get("places", ()) if [p["x_m"], p["y_m"]] in arrived]
    if driven is None or not stops:
        return NAN
    return float(driven.travelled_m[-1]) - _shortest_m(run.grid("true_map"), facts, patrol_steps(run), stops)


IDLENESS = columns_of(
    idleness_values,
    ("idleness_worst_s", "s", "longest time that a place went without a visit, the patrol's beginning and end counted",
     "Machado et al. 2002"),
    ("idleness_mean_s", "s", "mean over places and time of the time since the last visit", "Machado et al. 2002"),
    ("idleness_bound_s", "s", "least idleness_worst_s possible: the shortest way through all places that can be reached, in "
     "any order, at the highest speed that was commanded", "Held and Karp 1962"),
    ("idleness_cycle_s", "s", "the same of an endless patrol: the shortest round trip", "Chevaleyre 2004"),
    ("views_waited", "", "views in which the robot waited for something on its path", "steps.csv"),
    ("extra_way_m", "m", "way driven beyond the shortest through the places reached, in the order of the world, on the true "
     "plan without obstacles and people; below 0 where arriving mission.arrive_m short of each saves more",
     "rhs.metrics.path_judge"),
    ("places_skipped", "", "places put off because the way was blocked", "missions.json"),
    ("places_visited_later", "", "of those, places at which the robot said it had arrived in the end", "missions.json"),
    tasks=("patrol", "blame"),
    counts=("views_waited", "places_skipped", "places_visited_later"), more_is_better=("places_visited_later",),
)
