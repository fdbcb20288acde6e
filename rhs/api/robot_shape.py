"""The footprint of a robot that is not round: a convex polygon in its body frame, x ahead, y to the left, about the point
that it turns on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .errors import ConfigError

LEAST_M, MOST_M = 0.05, 2.0  # a robot's smallest and largest radius
Corners = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Footprint:
    """corners_m: (x, y) metres, counter-clockwise. Make it with `footprint_of`."""

    corners_m: Corners

    @property
    def radius_m(self) -> float:
        """Of the least circle about the turning point that holds the robot, metres."""
        return float(np.hypot(*np.array(self.corners_m).T).max())

    @property
    def half_m(self) -> float:
        """Of the largest circle about the turning point within the robot, metres: half of its width if that is what it has
        least of."""
        return float(-self.gaps_m(np.zeros((1, 2)))[0])

    def gaps_m(self, points_m: np.ndarray) -> np.ndarray:
        """(...) metres from the robot's side to points (..., 2) of its body frame; negative within it, by as much as the
        nearest side is away."""
        corners = np.array(self.corners_m)
        along = np.roll(corners, -1, axis=0) - corners
        length = np.hypot(*along.T)
        unit = along / length[:, None]
        from_corner = points_m[..., None, :] - corners
        outwards = from_corner[..., 0] * unit[:, 1] - from_corner[..., 1] * unit[:, 0]
        past = from_corner - np.clip((from_corner * unit).sum(axis=-1), 0.0, length)[..., None] * unit
        outside = outwards.max(axis=-1)
        gaps: np.ndarray = np.where(outside <= 0.0, outside, np.hypot(past[..., 0], past[..., 1]).min(axis=-1))
        return gaps

    def reach_m(self, bearings_rad: np.ndarray) -> np.ndarray:
        """(K,) metres from the turning point to the robot's side on each bearing (K,)."""
        corners = np.array(self.corners_m)
        along = np.roll(corners, -1, axis=0) - corners
        outwards = np.stack([along[:, 1], -along[:, 0]], axis=1)
        towards = outwards @ np.stack([np.cos(bearings_rad), np.sin(bearings_rad)])
        with np.errstate(divide="ignore"):
            reach = (outwards * corners).sum(axis=1)[:, None] / towards
        nearest: np.ndarray = np.where(towards > 0.0, reach, np.inf).min(axis=0)
        return nearest

    def at(self, stand: Sequence[float]) -> np.ndarray:
        """(K, 2) its corners where the robot stands: x, y, yaw."""
        c, s = np.cos(stand[2]), np.sin(stand[2])
        moved: np.ndarray = np.array(self.corners_m) @ np.array([[c, s], [-s, c]]) + np.asarray(stand[:2])
        return moved

    def gap_to_m(self, outlines_m: np.ndarray, stand: Sequence[float], within_m: float) -> float:
        """Metres from the side of a robot that stands there to the nearest of convex outlines (N, K, 2), within_m when none
        is nearer; negative where they overlap, by the way to the side that parts them (separating axes)."""
        corners = self.at(stand)
        low, high = corners.min(axis=0) - within_m, corners.max(axis=0) + within_m
        near = ((outlines_m.max(axis=1) >= low) & (outlines_m.min(axis=1) <= high)).all(axis=1)
        outlines = outlines_m[near]
        if not len(outlines):
            return within_m
        mine = np.broadcast_to(corners, (len(outlines), *corners.shape))
        apart = np.maximum(_apart(mine, outlines), _apart(outlines, mine))
        gaps = np.where(apart <= 0.0, apart, np.minimum(_to_sides(mine, outlines), _to_sides(outlines, mine)))
        return min(float(gaps.min()), within_m)


def _apart(polygons_m: np.ndarray, others_m: np.ndarray) -> np.ndarray:
    """(N,) the largest gap between the shadows of two polygons (N, K, 2), (N, L, 2) across a side of the first."""
    along = np.roll(polygons_m, -1, axis=1) - polygons_m
    length = np.hypot(along[..., 0], along[..., 1])
    across = np.stack([along[..., 1], -along[..., 0]], axis=-1) / np.maximum(length, 1e-12)[..., None]
    mine, theirs = (np.einsum("nkc,nlc->nkl", across, points) for points in (polygons_m, others_m))
    gaps = np.maximum(theirs.min(axis=2) - mine.max(axis=2), mine.min(axis=2) - theirs.max(axis=2))
    apart: np.ndarray = np.where(length > 1e-9, gaps, -np.inf).max(axis=1)
    return apart


def _to_sides(points_m: np.ndarray, polygons_m: np.ndarray) -> np.ndarray:
    """(N,) from the nearest of points (N, K, 2) to the nearest side of a polygon (N, L, 2), metres."""
    along = np.roll(polygons_m, -1, axis=1) - polygons_m
    squared = np.maximum((along**2).sum(axis=-1), 1e-18)
    from_corner = points_m[:, :, None] - polygons_m[:, None]
    share = np.clip((from_corner * along[:, None]).sum(axis=-1) / squared[:, None], 0.0, 1.0)
    past = from_corner - share[..., None] * along[:, None]
    gaps: np.ndarray = np.hypot(past[..., 0], past[..., 1]).min(axis=(1, 2))
    return gaps


def footprint_of(corners_m: Sequence[Sequence[float]] | np.ndarray, name: str) -> Footprint | None:
    """The footprint with these corners, in either order; None without any: a round robot. name: of the setting, for errors.

    Raises ConfigError where they are no convex polygon round the turning point, or too small or large."""
    points = np.array([tuple(corner) if len(corner) == 2 else (np.nan, np.nan) for corner in corners_m], float)
    if not len(points):
        return None
    example = f"for example {name}=[[0.3,0.2],[-0.3,0.2],[-0.3,-0.2],[0.3,-0.2]]"
    if len(points) < 3 or not np.isfinite(points).all():
        raise ConfigError(f"{name}: expected three corners or more, x ahead and y to the left in metres; {example}")
    for ordered in (points, points[::-1]):
        sides = np.roll(ordered, -1, axis=0) - ordered
        before = np.roll(sides, 1, axis=0)
        bends = before[:, 0] * sides[:, 1] - before[:, 1] * sides[:, 0]
        turned_rad = np.arctan2(bends, (before * sides).sum(axis=1)).sum()
        if (bends > 0.0).all() and turned_rad < 2.0 * np.pi + 0.1:
            found = Footprint(tuple((float(x), float(y)) for x, y in ordered))
            break
    else:
        raise ConfigError(f"{name}: the corners make no convex polygon, one after the other round the robot; {example}")
    if found.half_m <= 0.01:
        raise ConfigError(f"{name}: (0, 0), the point that the robot turns on, must lie within it, 1 cm from its side "
                          f"at least; {example}")
    if not LEAST_M <= found.radius_m <= MOST_M:
        raise ConfigError(f"{name}: the corners are up to {found.radius_m:g} m from the point that the robot turns on; "
                          f"expected {LEAST_M} to {MOST_M} m")
    return found
