"""A scan laid onto a map near where the robot believes to be: the pose that fits best, and what the scan can tell of it.

Gauss-Newton on the distance of each beam's end to the line of the nearest wall (the distance transform finds the wall, as
in the likelihood field of Thrun, Burgard, Fox, Probabilistic Robotics, 6.4; the line through the wall's cells is that of
point-to-line matching, Censi 2008), robust weights, with the believed pose as prior. Along a plain corridor the ends slide
over the walls without a change: the Hessian says so, and what it does not see the prior keeps. Deviations from plain
Gauss-Newton: information that is small against the best seen direction is noise of the cells and set to zero, and no
direction is ever called sharper than the map is drawn. A wall that the map knows from one side only is met from that
side only: the unseen back of a pillar is no part of its mapped front. A surface seen before a wall pulls by the chance that
it is that wall, and not something before it that the map does not hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.api.records import Scan
from rhs.estimation.filters.kalman import gate

from .planar_poses import between, composed
from .settings import MatchSettings


@dataclass(frozen=True, eq=False)
class ScanMatch:
    """state (3,): x m, y m, yaw rad of the body. information (3, 3): of the scan alone about a right perturbation of that
    state. covariance (3, 3): prior and scan together. share: of the ends that lie on walls. seen: directions observed."""

    state: np.ndarray
    information: np.ndarray
    covariance: np.ndarray
    share: float
    seen: int


class _Met(NamedTuple):
    """Of ends: metres off the nearest wall's line (B,), signed along its normal (B, 2), how that changes with the state's
    perturbation (B, 3), the sign of what lies on the robot's side (B,), 0 without a line, and if it is near (B,)."""

    away: np.ndarray
    jacobian: np.ndarray
    normal: np.ndarray
    side: np.ndarray
    on_wall: np.ndarray


class ScanMatcher:
    """A map made ready for matching."""

    def __init__(self, grid: OccupancyGrid, settings: MatchSettings | None = None) -> None:
        from scipy.ndimage import distance_transform_edt

        self.settings = settings or MatchSettings()
        self._corner, self._cell = np.asarray(grid.origin_m, float), grid.resolution_m
        occupied = grid.occupied()
        self._shape, self._empty = grid.shape, not occupied.any()
        if self._empty:
            return
        gap, nearest = distance_transform_edt(~occupied, return_indices=True)
        self._gap = gap * grid.resolution_m
        normal, middle = wall_lines_of(np.where(occupied, np.nan_to_num(grid.probability), 0.0))
        row, column = nearest
        self._facing = _facing(grid, normal, self.settings.behind_cells)[row, column]
        self._normal = normal[row, column]
        self._point = (np.stack([column, row], axis=-1) + 0.5 + middle[row, column]) * grid.resolution_m + self._corner

    def match(self, scan: Scan, state: np.ndarray, covariance: np.ndarray) -> ScanMatch | None:
        """The scan laid onto the map near `state` (3,), believed with covariance (3, 3) of its right perturbation."""
        return self.match_points(ends(scan, self.settings), state, covariance)

    def match_points(self, points: np.ndarray, state: np.ndarray, covariance: np.ndarray) -> ScanMatch | None:
        """The same for points (B, 2) of walls in the body frame, in the order of their beams. None when too few lie on
        walls, when nothing is seen, or when the fit lies where the prior cannot be."""
        if self._empty or len(points) < 8:
            return None
        prior = np.linalg.inv(covariance)
        start, at = np.asarray(state, float), np.array(state, float)
        chance = self._mapped(points, start, covariance)
        for _ in range(self.settings.iterations):
            information, pull, _ = self._linear(points, at, chance)
            kept, seen = self._trusted(information)
            if seen == 0:
                return None
            fit = np.linalg.pinv(information, rcond=1e-6, hermitian=True) @ pull
            step = np.linalg.solve(prior + kept, prior @ between(at, start) + kept @ fit)
            at = composed(at, np.clip(step, -0.3, 0.3))
            if np.abs(step).max() < 1e-4:
                break
        information, _, share = self._linear(points, at, chance)
        kept, seen = self._trusted(information)
        shift = between(start, at)
        if share < self.settings.least_share or shift @ prior @ shift > gate(3, self.settings.gate_probability):
            return None
        return ScanMatch(at, kept, np.linalg.inv(prior + kept), share, seen)

    def share(self, scan: Scan, state: np.ndarray) -> float:
        """Share of the ends that lie within reach of a wall, seen from a state (3,); NaN without ends or without walls."""
        points = ends(scan, self.settings)
        return self._linear(points, np.asarray(state, float))[2] if len(points) and not self._empty else float("nan")

    def room_m(self, state: np.ndarray) -> float:
        """Metres from a state (3,) to the nearest wall; inf in a map without walls."""
        return float("inf") if self._empty else float(self._lookup(np.asarray(state, float)[None, :2])[0][0])

    def _mapped(self, points: np.ndarray, state: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(B,) chance of each end, in the order of the beams, to be of the wall next to it.

        One for each surface, a run of neighbours: the error of the pose moves all of its ends alike, and so does a thing
        before the wall. The chance is that of probabilistic data association (Bar-Shalom and Tse 1975, Tracking in a
        cluttered environment with probabilistic data association, Automatica 11): the surface's distance as likely as
        belief, map and beams leave it, against a thing anywhere within reach. Deviation: none stands behind a wall."""
        s, chance = self.settings, np.ones(len(points))
        if s.unmapped <= 0.0:
            return chance
        met = self._against_walls(points, state)
        jacobian, before, known = met.jacobian * met.side[:, None], met.away * met.side, met.on_wall & (met.side != 0.0)
        normal = met.normal * met.side[:, None]
        bent = (normal[1:] * normal[:-1]).sum(axis=1) < np.cos(np.radians(s.bend_deg))
        apart = np.abs(np.diff(before)) > s.step_sigmas * s.sigma_m
        surface = np.cumsum(np.append(True, bent | apart | ~known[1:] | ~known[:-1]))
        for one in np.unique(surface[known]):
            mine = surface == one
            gap_m, slope = float(np.median(before[mine])), jacobian[mine].mean(axis=0)
            if gap_m > 0.0:
                variance = slope @ covariance @ slope + s.floor_m**2 + s.sigma_m**2 / (s.trust * mine.sum())
                wall = (1.0 - s.unmapped) * np.exp(-0.5 * gap_m**2 / variance) / np.sqrt(2.0 * np.pi * variance)
                chance[mine] = wall / (wall + s.unmapped / s.reach_m)
        return chance

    def _linear(self, points: np.ndarray, at: np.ndarray,
                chance: np.ndarray | float = 1.0) -> tuple[np.ndarray, np.ndarray, float]:
        """Information (3, 3), its vector (3,) and the share of ends on walls, at a state. chance (B,): of each end."""
        met = self._against_walls(points, at)
        weight = np.where(met.on_wall, self.settings.trust / self.settings.sigma_m**2, 0.0) * chance
        weight = weight / (1.0 + (met.away / (2.0 * self.settings.sigma_m)) ** 2)
        weighted = met.jacobian * weight[:, None]
        return weighted.T @ met.jacobian, -weighted.T @ met.away, float(met.on_wall.mean())

    def _against_walls(self, points: np.ndarray, at: np.ndarray) -> _Met:
        """What the ends (B, 2) seen from a state (3,) lie next to."""
        c, s = np.cos(at[2]), np.sin(at[2])
        turned = points @ np.array([[c, s], [-s, c]])
        gap, away, slope, facing = self._lookup(turned + at[:2])
        from_behind = (turned * facing).sum(axis=1) > self.settings.behind_cos * np.hypot(*turned.T)
        by_x, by_y = slope @ np.array([c, s]), slope @ np.array([-s, c])
        by_yaw = slope[:, 0] * -turned[:, 1] + slope[:, 1] * turned[:, 0]
        jacobian = np.stack([by_x, by_y, by_yaw], axis=1)
        side = -np.sign((turned * slope).sum(axis=1))
        return _Met(away, jacobian, slope, side, (gap < self.settings.reach_m) & ~from_behind)

    def _lookup(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """At map positions (N, 2): distance to the nearest wall (N,), signed distance to its line (N,), the line's normal
        (N, 2), zero where the wall has no direction, and where the wall looks (N, 2). Far away outside the map."""
        rows, columns = self._shape
        x, y = np.floor((places - self._corner) / self._cell).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < columns) & (y < rows)
        x, y = np.where(inside, x, 0), np.where(inside, y, 0)
        normal = self._normal[y, x]
        away = ((places - self._point[y, x]) * normal).sum(axis=1)
        return np.where(inside, self._gap[y, x], 1e3), away, np.where(inside[:, None], normal, 0.0), self._facing[y, x]

    def _trusted(self, information: np.ndarray) -> tuple[np.ndarray, int]:
        """The information without the directions that are hardly seen, none sharper than floor_m; how many are left."""
        scale = np.array([1.0, 1.0, 1.0 / self.settings.lever_m])
        values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
        kept = np.where(values > self.settings.blind_below * values.max(), values, 0.0)
        kept = np.where(kept > 0, 1.0 / (1.0 / np.where(kept > 0, kept, 1.0) + self.settings.floor_m**2), 0.0)
        return (vectors * kept) @ vectors.T / np.outer(scale, scale), int((kept > 0).sum())


def wall_lines_of(mass: np.ndarray, sigma_cells: float = 2.5) -> tuple[np.ndarray, np.ndarray]:
    """For each cell of (H, W) wall mass: normal (H, W, 2) of the line through the walls around it, zero where they have no
    direction (a corner, a lone cell), and the middle of these walls (H, W, 2) from the cell's own, in cells. x, then y."""
    from scipy.ndimage import correlate1d

    reach = np.arange(-7, 8)
    bell = np.exp(-0.5 * (reach / sigma_cells) ** 2)

    def moment(in_x: int, in_y: int) -> np.ndarray:
        along = correlate1d(mass, bell * reach**in_x, axis=1, mode="constant")
        smooth: np.ndarray = correlate1d(along, bell * reach**in_y, axis=0, mode="constant")
        return smooth

    whole = np.maximum(moment(0, 0), 1e-9)
    middle = np.stack([moment(1, 0), moment(0, 1)], axis=-1) / whole[..., None]
    xx, xy, yy = moment(2, 0) / whole, moment(1, 1) / whole, moment(0, 2) / whole
    xx, xy, yy = xx - middle[..., 0] ** 2, xy - middle[..., 0] * middle[..., 1], yy - middle[..., 1] ** 2
    half, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)  # the variances are half +- apart
    straight = (half - apart < 0.35 * (half + apart)) & (whole > 1e-6)
    along = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    normal = np.stack([-np.sin(along), np.cos(along)], axis=-1)
    return np.where(straight[..., None], normal, 0.0), middle


def _facing(grid: OccupancyGrid, normal: np.ndarray, reach_cells: int) -> np.ndarray:
    """(H, W, 2) unit vector to the side from which a wall was seen: free cells on this side, none on the other. Zero for
    walls seen from both sides and where there is no wall line."""
    rows, columns = np.nonzero(grid.occupied() & normal.any(axis=-1))
    free, towards = np.pad(grid.free(), reach_cells + 1), normal[rows, columns]
    sides = []
    for sign in (1.0, -1.0):
        seen = np.zeros(len(rows), bool)
        for cells in range(1, reach_cells + 1):
            step = np.rint(sign * cells * towards).astype(int) + reach_cells + 1
            seen |= free[rows + step[:, 1], columns + step[:, 0]]
        sides.append(seen)
    facing = np.zeros_like(normal)
    facing[rows, columns] = towards * (sides[0].astype(float) - sides[1])[:, None]
    return facing


def ends(scan: Scan, settings: MatchSettings) -> np.ndarray:
    """(B, 2) where some evenly spaced beams end, body frame, metres."""
    known = np.nonzero(np.isfinite(scan.ranges_m) & (scan.ranges_m <= settings.range_max_m))[0]
    if len(known) > settings.beams:
        known = known[np.linspace(0, len(known) - 1, settings.beams).astype(int)]
    reach, bearing = np.asarray(scan.ranges_m, float)[known], np.asarray(scan.bearings_rad, float)[known]
    points: np.ndarray = np.stack([np.cos(bearing), np.sin(bearing)], axis=1) * reach[:, None] + scan.origin_xy_m
    return points
