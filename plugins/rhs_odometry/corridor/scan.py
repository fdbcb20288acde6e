"""The scan that the filter's walls would give, and what a beam may not conclude from them.

Walls are incomplete: some were never seen. A beam that meets the back of a wall, a side nobody ever saw, must have gone
through a wall that is not known; it says nothing. A beam that leaves a corridor where its walls are not drawn any
further says that the corridor is free up to there, and nothing behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import planar
from rhs.api.records import Scan, Wall
from rhs.estimation.scans.wall_rays import meet_walls

from .config import DrawingRules

USUAL = DrawingRules()


@dataclass(frozen=True, eq=False)
class Drawn:
    """A wall with the sides it was seen from: left and right of the way from its start to its end."""

    wall: Wall
    left: bool = True
    right: bool = True


def believed_scan(
    drawn: Sequence[Drawn], mouths: Sequence[Mouth], map_from_body: np.ndarray, bearings_rad: np.ndarray, max_range_m: float,
    *, sight_m: float = USUAL.sight_m,
) -> Scan:
    """Scan from a pose: NaN where nothing is known, +inf where it is free up to max_range_m."""
    x, y, yaw = planar(map_from_body)
    here, angles = np.array([x, y]), bearings_rad + yaw
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    seen, unseen = _faces(drawn, here)
    front, back = meet_walls(seen, here, directions), meet_walls(unseen, here, directions)
    ranges = np.where(front < np.minimum(back, sight_m), np.where(front > max_range_m, np.inf, front), np.nan)
    open_at = meet_walls([m.segment for m in mouths if m.encloses(here)], here, directions)
    leaves = np.isnan(ranges) & np.isfinite(open_at) & (open_at < back) & (open_at > max_range_m)
    return Scan(np.asarray(bearings_rad, float), np.where(leaves, np.inf, ranges), float(max_range_m))


def _faces(drawn: Sequence[Drawn], here: np.ndarray) -> tuple[list[Wall], list[Wall]]:
    """Walls that show `here` (2,) a side that was seen, and those that show it one that never was."""
    faces: tuple[list[Wall], list[Wall]] = ([], [])
    for d in drawn:
        along, out = d.wall.end_xy_m - d.wall.start_xy_m, here - d.wall.start_xy_m
        on_left = along[0] * out[1] - along[1] * out[0] > 0.0
        faces[0 if (d.left if on_left else d.right) else 1].append(d.wall)
    return faces


@dataclass(frozen=True, eq=False)
class Mouth:
    """Where a corridor is drawn no further: a segment from the end of one of its walls to the wall across, and the frame of
    the corridor: origin (2,), along (2,) unit vector, length_m, across_m signed, left positive."""

    segment: Wall
    origin: np.ndarray
    along: np.ndarray
    length_m: float
    across_m: float

    def encloses(self, here: np.ndarray) -> bool:
        """Whether a point (2,) lies in the corridor, between the two walls."""
        out = here - self.origin
        aside = (self.along[0] * out[1] - self.along[1] * out[0]) / self.across_m
        return bool(0.0 <= out @ self.along <= self.length_m and 0.0 < aside < 1.0)


def mouths_of(drawn: Sequence[Drawn], rules: DrawingRules = USUAL) -> list[Mouth]:
    """The ends of all walls that have a parallel wall across from them, at most widest_m away."""
    out = []
    for wall in (d.wall for d in drawn):
        way = wall.end_xy_m - wall.start_xy_m
        length = float(np.linalg.norm(way))
        along = way / length
        for other in (d.wall for d in drawn if d.wall is not wall):
            ends = np.stack([other.start_xy_m, other.end_xy_m]) - wall.start_xy_m
            at, aside = ends @ along, along[0] * ends[:, 1] - along[1] * ends[:, 0]
            across = float(aside.mean())
            parallel = abs(at[1] - at[0]) > rules.straight * np.linalg.norm(ends[1] - ends[0])
            if not parallel or not rules.narrowest_m < abs(across) < rules.widest_m:
                continue
            frame = (wall.start_xy_m, along, length, across)
            for end in (0.0, length):
                if at.min() <= end <= at.max():
                    share = (end - at[0]) / (at[1] - at[0])
                    foot = wall.start_xy_m + ends[0] + share * (ends[1] - ends[0])
                    out.append(Mouth(Wall(wall.start_xy_m + along * end, foot), *frame))
    return out
