"""Loop closers on surveys of small rooms whose odometry drifts: what is left of the error, and which loops are believed."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.geometry import compose_covariance, inverse, log_se3, se2
from rhs.api.records import Closure, FeatureSettings, Motion, Tracking, View
from rhs.api.validate import check_closure
from rhs.testing.loop_closers import EDGE_M, EDGE_RAD
from rhs.testing.room import CORRIDOR, FURNISHED, HALL, Room, context

from .forked import ForkResult
from .laps import LAP, STRAIGHT, round_room, stretch

SIGMA = np.array([0.01, 0.01, 1e-3, 1e-3, 1e-3, np.radians(0.5)])  # said of one motion: metres, radians
Drift = tuple[float, float, float]  # what each motion is wrong by all along: x m, y m, yaw rad
BEND: Drift = (0.002, 0.001, np.radians(0.15))
SURVEYS: dict[str, tuple[Room, tuple[tuple[float, float], ...], Drift]] = {
    "two laps, noise alone": (round_room(HALL), (*LAP, *LAP[1:]), (0.0, 0.0, 0.0)),
    "two laps that bend": (round_room(HALL), (*LAP, *LAP[1:]), BEND),
    "two laps of a furnished room": (round_room(FURNISHED), (*LAP, *LAP[1:]), BEND),
    "no loop: a corridor": (CORRIDOR, STRAIGHT, BEND)}
COLUMNS = {
    "before_m": "error of the positions before, RMSE, mean of the surveys; all begin where they truly do",
    "error_m": "the same after closing",
    "left_pct": "what is left of the error where there are loops, mean",
    "harm_pct": "the error after, share of the error before, where there is no loop: more than 100 is harm done",
    "accepted": "loops that are believed",
    "false_share": "of these, further than 0.3 m or 9 degrees from the truth",
    "close_ms": "CPU time of a survey, median",
    "memory_mb": "memory taken beyond the process it began in",
}


@dataclass(frozen=True, eq=False)
class Closed:
    """One survey: errors before and after, metres; loops believed and how many of them are false; poses (N, 4, 4) after."""

    survey: str
    before_m: float
    after_m: float
    accepted: int
    false: int
    cpu_ms: float
    poses: np.ndarray


def prepare() -> None:
    """Make every survey once, for all parts."""
    for title in SURVEYS:
        survey(title)


def work(settings: Any, *, degraded: bool = True) -> Iterator[Closed]:
    """Every survey. degraded: nothing more is asked."""
    with tempfile.TemporaryDirectory() as name:
        for title, (room, *_) in SURVEYS.items():
            views, truth = survey(title)
            part = complete("loop_closer", settings.build(context(Path(name), 0, room)))
            began = process_time()
            closure = check_closure(part.close(views), views, who="close()")
            yield judged(title, views, truth, closure, 1e3 * (process_time() - began))


@cache
def survey(title: str) -> tuple[tuple[View, ...], np.ndarray]:
    """Views believed where motions that drift lead, every second one kept as a place, and their true poses (N, 4, 4)."""
    from rhs.estimation.views.features import features

    room, steps, drift = SURVEYS[title]
    rng, views = np.random.default_rng(4), []
    driven = stretch(room, steps, 1)
    believed, spread, covariance = driven[0].world_from_body, 1e-9 * np.eye(6), np.diag(SIGMA**2)
    for index, one in enumerate(driven):
        step = np.eye(4)
        if index:
            noise = SIGMA[[0, 1, 5]] * rng.standard_normal(3)
            step = inverse(driven[index - 1].world_from_body) @ one.world_from_body @ se2(*(np.array(drift) + noise))
            believed, spread = believed @ step, compose_covariance(spread, step, covariance)
        seen = one.observation
        kept = features(seen, FeatureSettings()) if index % 2 == 0 else None
        motion = Motion(step, covariance, Tracking.OK)
        views.append(freeze(View(index, seen.stamp_s, seen.camera, motion, believed, spread, seen.scan, kept)))
    return tuple(views), np.array([one.world_from_body for one in driven])


def judged(title: str, views: tuple[View, ...], truth: np.ndarray, closure: Closure, cpu_ms: float) -> Closed:
    """Positions and loops against the truth."""
    believed = [edge for edge in closure.edges if edge.accepted]
    off = [log_se3(inverse(inverse(truth[edge.earlier]) @ truth[edge.later]) @ edge.earlier_from_later) for edge in believed]
    false = sum(np.linalg.norm(one[:3]) > EDGE_M or np.linalg.norm(one[3:]) > EDGE_RAD for one in off)
    before = np.array([view.map_from_body for view in views])
    return Closed(title, rmse_m(before, truth), rmse_m(closure.poses, truth), len(believed), int(false), cpu_ms,
                  closure.poses)


def rmse_m(poses: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square distance of positions, of poses (N, 4, 4); both begin at one place."""
    return float(np.sqrt(((poses[:, :3, 3] - truth[:, :3, 3]) ** 2).sum(axis=1).mean()))


def figures(result: ForkResult) -> dict[str, float]:
    """The columns, over all surveys; NaN where there is none."""
    found: list[Closed] = result.items
    if not found:
        return {}
    shares = {loops: [100.0 * one.after_m / one.before_m for one in found if one.survey.startswith("no loop") != loops]
              for loops in (True, False)}
    accepted, nan = sum(one.accepted for one in found), float("nan")
    return {"before_m": float(np.mean([one.before_m for one in found])),
            "error_m": float(np.mean([one.after_m for one in found])),
            **{name: float(np.mean(shares[loops])) if shares[loops] else nan
               for name, loops in (("left_pct", True), ("harm_pct", False))},
            "accepted": accepted, "false_share": sum(one.false for one in found) / accepted if accepted else nan,
            "close_ms": float(np.median([one.cpu_ms for one in found])), "memory_mb": result.memory_mb}


def details(result: ForkResult) -> dict[str, Any]:
    """The surveys one by one."""
    return {"rooms": {one.survey: figures(ForkResult([one])) for one in result.items}}
