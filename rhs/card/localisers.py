"""Localisers in two small rooms: right, sure, and whether the one means the other; carried away and left to find itself."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.geometry import exp_se3, inverse, log_se3
from rhs.api.records import Belief, BeliefStatus, Motion, Tracking
from rhs.api.validate import check_belief
from rhs.metrics.calibration import Beliefs, calibration_error, kidnaps, recovered
from rhs.testing.localisers import FINE, SIGMA
from rhs.testing.odometry import PLANE
from rhs.testing.room import FURNISHED, HALL, Room, context, for_part

from .forked import ForkResult
from .laps import (
    AHEAD_M,
    LEFT_RAD,
    Seen,
    breaks_at,
    levels,
    numbered,
    round_room,
    spoiled,
    stretch,
    surveyed,
    true_grid,
)

ROOMS = (HALL, FURNISHED)
SEEDS = (1, 2)
STEPS = ((0.0, 0.0), *[(AHEAD_M, LEFT_RAD)] * 27)
SHORT = 2 * len(STEPS)  # views of the patrol that is spoiled
COLUMNS = {
    "right_share": "views in which the belief is right: 0.25 m, 5 degrees",
    "sure_share": "views in which it says that it tracks",
    "wrong_sure_share": "views in which it says so and is wrong",
    "ece": "expected calibration error of the stated chance of being right, ten bins (Guo et al. 2017); of an honest part "
           "not 0: 0.02 to 0.2 by luck in 336 views, of which neighbours are right or wrong together",
    "recovered_share": "of being carried away while standing still: it was right and sure again within 3.5 m",
    "recovery_m": "way until then, median",
    "error_m": "error of the position while it tracks, median",
    "nees": "normalised squared error per dimension while it tracks, median: 0.79 is honest, more is too sure",
    "update_ms": "CPU time of a view, median",
    "memory_mb": "memory taken beyond the process it began in",
}


@dataclass(frozen=True, eq=False)
class Patrolled:
    """What was believed on one patrol; level: instead, (dial, level, share that is right of the views after
    being carried)."""

    room: str
    beliefs: Beliefs | None
    nees: np.ndarray
    cpu_ms: np.ndarray
    level: tuple[str, float, float] | None = None


def prepare() -> None:
    """Look at every room once, for all parts."""
    for room in ROOMS:
        surveyed(room)
        for seed in SEEDS:
            patrol(room, seed)


def work(settings: Any, *, degraded: bool = True) -> Iterator[Patrolled]:
    """Every patrol, then, if asked for, the first two stretches of the first one under each degradation."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for room in ROOMS:
            learnt = surveyed(room), freeze(true_grid(room))
            for seed in SEEDS:
                yield patrolled(settings, room, learnt, patrol(room, seed), folder)
        learnt = surveyed(HALL), freeze(true_grid(HALL))
        views = patrol(HALL, SEEDS[0])[:SHORT]
        for dial, level, degradation in levels(folder) if degraded else ():
            found = patrolled(settings, HALL, learnt, spoiled(views, degradation), folder)
            assert found.beliefs is not None
            yield Patrolled("", None, found.nees, found.cpu_ms, (dial, level, after_carried(found.beliefs)))


def after_carried(beliefs: Beliefs) -> float:
    """Share of the second stretch that is right: before it was carried, a robot is right without a look."""
    return float(beliefs.right[len(STEPS):SHORT].mean())


def patrol(room: Room, seed: int) -> list[Seen]:
    """Three stretches beside the surveyed lap; the robot is carried from one to the next."""
    starts = (round_room(room, 0.0, beside_m=0.05), round_room(room, 4.7, beside_m=-0.1, yaw_rad=0.08),
              round_room(room, 2.9 + 0.2 * seed, beside_m=0.12, yaw_rad=-0.08))
    return numbered([stretch(start, STEPS, 10 * seed + k) for k, start in enumerate(starts)])


def patrolled(settings: Any, room: Room, learnt: tuple[Any, Any], views: Sequence[Seen], folder: Path) -> Patrolled:
    """One patrol: told where it begins, led by motions as wrong as their covariance says, never told of being carried."""
    part = complete("localiser", settings.build(context(folder, 0, room)))
    part.learn(*learnt)
    part.start(freeze(Belief(np.array(views[0].world_from_body), FINE.copy())))
    rng, said, cpu_ms = np.random.default_rng(7), [], []
    previous = views[0].world_from_body
    for one in views:
        moved = np.eye(4) if one.carried else inverse(previous) @ one.world_from_body
        noise = SIGMA * rng.standard_normal(6) * [1, 1, 0, 0, 0, 1] * bool(one.observation.index)
        motion = freeze(Motion(moved @ exp_se3(noise), np.diag(SIGMA**2), Tracking.OK))
        previous, began = one.world_from_body, process_time()
        said.append(check_belief(part.update(for_part(settings, one.observation), motion), who="update()"))
        cpu_ms.append(1e3 * (process_time() - began))
    return judged(room.name, views, said, np.array(cpu_ms))


def judged(room: str, views: Sequence[Seen], said: Sequence[Belief], cpu_ms: np.ndarray) -> Patrolled:
    """What was believed, against the truth."""
    errors = np.array([log_se3(inverse(one.world_from_body) @ belief.map_from_body)
                       for one, belief in zip(views, said, strict=True)])
    sure = np.array([belief.status is BeliefStatus.TRACKING for belief in said])
    nees = np.array([error[PLANE] @ np.linalg.solve(belief.covariance[np.ix_(PLANE, PLANE)], error[PLANE]) / len(PLANE)
                     for error, belief in zip(errors, said, strict=True)])
    beliefs = Beliefs(np.array([one.observation.stamp_s for one in views]),
                      np.array([one.world_from_body[:2, 3] for one in views]), np.hypot(errors[:, 0], errors[:, 1]),
                      np.abs(errors[:, 5]), np.array([belief.probability for belief in said], float), sure,
                      np.array([one.carried for one in views]), np.arange(len(views)) == 0)
    return Patrolled(room, beliefs, nees[sure], cpu_ms)


def figures(result: ForkResult) -> dict[str, float]:
    """The columns, over all patrols."""
    found = [one for one in result.items if one.beliefs is not None]
    if not found:
        return {}
    probability, right, sure, wrong_m = (np.concatenate([getattr(one.beliefs, name) for one in found])
                                         for name in ("probability", "right", "sure", "wrong_m"))
    again = recovered([each for one in found for each in kidnaps(one.beliefs)])
    nees = np.concatenate([one.nees for one in found])
    nan = float("nan")
    return {"right_share": float(right.mean()), "sure_share": float(sure.mean()),
            "wrong_sure_share": float((sure & ~right).mean()),
            "ece": calibration_error(probability, right), "recovered_share": again["share"], "recovery_m": again["metres"],
            "error_m": float(np.median(wrong_m[sure])) if sure.any() else nan,
            "nees": float(np.median(nees)) if len(nees) else nan,
            "update_ms": float(np.median(np.concatenate([one.cpu_ms for one in found]))), "memory_mb": result.memory_mb}


def details(result: ForkResult) -> dict[str, Any]:
    """Where it breaks, and the reliability of its chances for the picture."""
    found = [one for one in result.items if one.beliefs is not None]
    first = [after_carried(one.beliefs) for one in found[:1]]
    return {"breaks": breaks_at(result.items, first[0]) if first else []}
