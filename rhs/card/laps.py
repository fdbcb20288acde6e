"""Laps through the small rooms of rhs.testing, with true poses: what localisers and odometries are measured on.

Views are those of `rhs.testing.room.drive`: exact ray casting, and the noise of good sensors of every kind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from rhs.api.frozen import freeze
from rhs.api.geometry import inverse
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Capture, Observation, View
from rhs.config import registry
from rhs.testing.localisers import as_survey
from rhs.testing.room import RATE_HZ, Room, context, drive, empty_grid

AHEAD_M, LEFT_RAD = 0.13, 0.1  # per view of a lap: round a circle of 1.3 m
MIDDLE_M, RADIUS_M = (0.0, -0.2), 1.3
LAP = ((0.0, 0.0), *[(AHEAD_M, LEFT_RAD)] * 63)
STRAIGHT = ((0.0, 0.0), *[(0.15, 0.02)] * 10, *[(0.15, -0.02)] * 20, *[(0.15, 0.02)] * 10)
BOX_SEEN_AT_M = 1.0  # height of the scan


@dataclass(frozen=True, eq=False)
class Seen:
    """One view: what was seen, the true pose, and whether the robot was carried here since the view before."""

    observation: Observation
    world_from_body: np.ndarray
    carried: bool = False


def round_room(room: Room, at_rad: float = 0.0, *, beside_m: float = 0.0, yaw_rad: float = 0.0) -> Room:
    """The room entered at an angle of the circle, so far outside it, turned by yaw_rad."""
    radius = RADIUS_M + beside_m
    x, y = MIDDLE_M[0] + radius * math.sin(at_rad), MIDDLE_M[1] - radius * math.cos(at_rad)
    return replace(room, start=(x, y, at_rad + yaw_rad))


def stretch(room: Room, steps: Sequence[tuple[float, float]], seed: int) -> list[Seen]:
    """A drive through the room from its start."""
    return [Seen(observation, pose) for pose, observation in drive(room, tuple(steps), seed)]


def numbered(stretches: Sequence[list[Seen]]) -> list[Seen]:
    """Stretches one after another: the robot is carried from the end of one to the start of the next."""
    out: list[Seen] = []
    for number, one in enumerate(stretches):
        for k, seen in enumerate(one):
            index = len(out)
            observation = freeze(replace(seen.observation, index=index, stamp_s=index / RATE_HZ))
            out.append(replace(seen, observation=observation, carried=number > 0 and k == 0))
    return out


@cache
def surveyed(room: Room) -> tuple[View, ...]:
    """One lap as a survey with true poses, every second view kept as a place."""
    return as_survey(drive(round_room(room), LAP, 0))


def true_grid(room: Room) -> OccupancyGrid:
    """The true map: walls, and boxes that the scan meets."""
    grid = empty_grid(room)
    probability = np.array(grid.probability)
    rows, columns = np.indices(grid.shape)
    x = (columns + 0.5) * grid.resolution_m + grid.origin_m[0]
    y = (rows + 0.5) * grid.resolution_m + grid.origin_m[1]
    for low, high in room.boxes:
        if low[2] <= BOX_SEEN_AT_M <= high[2]:
            probability[(low[0] <= x) & (x <= high[0]) & (low[1] <= y) & (y <= high[1])] = 0.98
    return OccupancyGrid(probability, grid.resolution_m, grid.origin_m)


# --- degradations ---------------------------------------------------------------------------------------------------

# degradation -> (its dial, levels from little to much)
DIALS = {"blur": ("exposure_share", (0.2, 0.4, 0.7, 1.0)), "low_light": ("dark_share", (0.8, 0.9, 0.95, 0.98)),
         "fog": ("extinction_per_m", (0.05, 0.1, 0.2, 0.4)), "side_light": ("side_share", (0.6, 0.8, 0.9, 1.0))}


def levels(folder: Any) -> Iterator[tuple[str, float, Any]]:
    """(dial, level, degradation as built) for all that are installed and for each of their levels."""
    for name, (dial, values) in DIALS.items():
        if name in registry.names("degrade") and registry.failure("degrade", name) is None:
            for value in values:
                part = registry.load("degrade", name)(**{dial: value}).build(context(folder))  # type: ignore[attr-defined]
                yield f"degrade.{dial}", value, part


def spoiled(views: Sequence[Seen], degradation: Any) -> list[Seen]:
    """The views as the degradation leaves them: of those that arrive, what was seen; poses stay."""
    out, previous = [], views[0].world_from_body
    for one in views:
        seen = one.observation
        capture = Capture(seen.index, seen.stamp_s, seen.image, seen.depth, seen.command, seen.wheel, seen.scan)
        moved = np.eye(4) if one.carried else inverse(previous) @ one.world_from_body
        left, previous = degradation.degrade(capture, moved), one.world_from_body
        out.append(replace(one, observation=freeze(replace(seen, image=left.image, depth=left.depth, scan=left.scan,
                                                           wheel=left.travel))))
    return out


def breaks_at(items: Sequence[Any], whole: float) -> list[dict[str, Any]]:
    """A row for each dial: its levels and scores, and the first level at which less than half is left of the score `whole`
    without degradation; None where it holds. items: those with a `level` are (dial, level, score)."""
    scores: dict[str, list[tuple[float, float]]] = {}
    for dial, *level_and_score in (one.level for one in items if one.level is not None):
        scores.setdefault(dial, []).append((level_and_score[0], level_and_score[1]))
    out = []
    for dial, found in scores.items():
        below = [level for level, score in found if score < whole / 2]
        out.append({"dial": dial, "levels": [level for level, _ in found], "scores": [score for _, score in found],
                    "undegraded": whole, "breaks_at": below[0] if below and whole > 0 else None})
    return out
