"""Odometries in four small rooms: how wrong a motion is, and whether its covariance says so."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.geometry import inverse, log_se3
from rhs.api.records import Tracking
from rhs.api.validate import check_motion
from rhs.testing.odometry import PLANE
from rhs.testing.room import CORRIDOR, FURNISHED, HALL, TUBE, Room, context, for_part

from .forked import ForkResult
from .laps import LAP, STRAIGHT, Seen, breaks_at, levels, round_room, spoiled, stretch

DRIVES = {"room": (round_room(HALL), LAP), "furnished room": (round_room(FURNISHED), LAP), "corridor": (CORRIDOR, STRAIGHT),
          "tube": (TUBE, STRAIGHT)}
SHORT = 32  # views of the drive that is spoiled
CHI2_95 = 7.8147  # of three dimensions
GOOD_M, GOOD_RAD = 0.02, np.radians(1.0)  # a motion of 0.13 m
COLUMNS = {
    "ok_share": "motions with status ok",
    "error_m": "error of the position of a motion that is ok, RMSE, of 0.13 to 0.15 m driven",
    "error_deg": "error of its turn, RMSE, of up to 6 degrees",
    "drift_pct": "error of the whole way at its end, share of the way: of motions that are ok and those that are not",
    "nees": "normalised squared error per dimension of motions that are ok, mean: 1 is honest, more is too sure",
    "wide_m": "stated sigma of the position over its error, by NEES: 1 is honest, more is too unsure",
    "wide_rad": "stated sigma of the turn over its error, by NEES",
    "within_95_share": "of these, errors within the ellipse that holds 95 of 100 honest ones",
    "update_ms": "CPU time of a view, median",
    "memory_mb": "memory taken beyond the process it began in",
}


@dataclass(frozen=True, eq=False)
class Driven:
    """One drive. errors (N, 3): x, y, yaw of each motion; nees (N,): squared, normalised, of three dimensions; ok (N,);
    apart (N, 2): the same per dimension of the position and of the turn, each by its own part of the covariance.
    level: instead, (dial, level, share of motions that are good)."""

    room: str
    errors: np.ndarray
    nees: np.ndarray
    ok: np.ndarray
    drift: float
    cpu_ms: np.ndarray
    apart: np.ndarray
    level: tuple[str, float, float] | None = None

    @property
    def good(self) -> float:
        """Share of the motions that are ok and right."""
        right = (np.hypot(self.errors[:, 0], self.errors[:, 1]) < GOOD_M) & (np.abs(self.errors[:, 2]) < GOOD_RAD)
        return float((self.ok & right).mean())


def prepare() -> None:
    """Look at every room once, for all parts."""
    for room, steps in DRIVES.values():
        stretch(room, steps, 1)


def work(settings: Any, *, degraded: bool = True) -> Iterator[Driven]:
    """Every drive, then, if asked for, half of the first one under each degradation."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, (room, steps) in DRIVES.items():
            yield driven(settings, title, room, stretch(room, steps, 1), folder)
        room, steps = DRIVES["room"]
        views = stretch(room, steps, 1)[:SHORT]
        for dial, level, degradation in levels(folder) if degraded else ():
            found = driven(settings, "room", room, spoiled(views, degradation), folder)
            yield replace(found, level=(dial, level, found.good))


def driven(settings: Any, title: str, room: Room, views: Sequence[Seen], folder: Path) -> Driven:
    """One drive, every motion held against the truth."""
    part = complete("odometry", settings.build(context(folder, 0, room)))
    motions, cpu_ms = [], []
    for one in views:
        began = process_time()
        motions.append(check_motion(part.update(for_part(settings, one.observation)), who="update()"))
        cpu_ms.append(1e3 * (process_time() - began))
    said, way_m, errors, nees, apart = np.eye(4), 0.0, [], [], []
    for before, now, motion in zip(views[:-1], views[1:], motions[1:], strict=True):
        moved = inverse(before.world_from_body) @ now.world_from_body
        said, way_m = said @ motion.previous_from_body, way_m + float(np.linalg.norm(moved[:3, 3]))
        error = log_se3(inverse(moved) @ motion.previous_from_body)[PLANE]
        errors.append(error)
        spread = motion.covariance[np.ix_(PLANE, PLANE)]
        nees.append(error @ np.linalg.solve(spread, error))
        apart.append((error[:2] @ np.linalg.solve(spread[:2, :2], error[:2]) / 2.0, error[2] ** 2 / spread[2, 2]))
    true = inverse(views[0].world_from_body) @ views[-1].world_from_body
    return Driven(title, np.array(errors), np.array(nees), np.array([m.status is Tracking.OK for m in motions[1:]]),
                  float(np.linalg.norm(said[:3, 3] - true[:3, 3])) / way_m, np.array(cpu_ms), np.array(apart))


def figures(result: ForkResult) -> dict[str, float]:
    """The columns, over the drives in which at least half of the motions were ok; NaN where there is none."""
    every = [one for one in result.items if one.level is None]
    if not every:
        return {}
    found = [one for one in every if one.ok.mean() >= 0.5]
    nan = float("nan")
    known = dict.fromkeys(COLUMNS, nan) | {"ok_share": float(np.concatenate([one.ok for one in every]).mean()),
                                          "memory_mb": result.memory_mb,
                                          "update_ms": float(np.median(np.concatenate([one.cpu_ms for one in every])))}
    if not found:
        return known
    errors, nees, apart = (np.concatenate([getattr(one, name)[one.ok] for one in found])
                           for name in ("errors", "nees", "apart"))
    wide = 1.0 / np.sqrt(np.maximum(apart.mean(axis=0), 1e-12))
    return known | {"error_m": float(np.sqrt((errors[:, :2]**2).sum(axis=1).mean())),
                   "error_deg": float(np.degrees(np.sqrt((errors[:, 2]**2).mean()))),
                   "drift_pct": 100.0 * float(np.mean([one.drift for one in found])),
                   "nees": float(nees.mean() / len(PLANE)), "wide_m": float(wide[0]), "wide_rad": float(wide[1]),
                   "within_95_share": float((nees <= CHI2_95).mean())}


def details(result: ForkResult) -> dict[str, Any]:
    """The drives one by one, and where it breaks."""
    drives = {one.room: figures(ForkResult([one])) for one in result.items if one.level is None}
    first = [one for one in result.items if one.level is None and one.room == "room"]
    if not first:
        return {"rooms": drives, "breaks": []}
    short = replace(first[0], errors=first[0].errors[:SHORT - 1], ok=first[0].ok[:SHORT - 1])
    return {"rooms": drives, "breaks": breaks_at(result.items, short.good)}
