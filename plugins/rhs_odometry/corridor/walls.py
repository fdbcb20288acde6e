"""Which wall a track lies on, which walls are new, which two walls are one. Delayed: a track is triangulated first and
attached to a wall only if its own depth agrees; nothing is ever forced onto a wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rhs.estimation.filters.kalman import correct, nees

from .config import WallRules
from .fit import TrackFit
from .state import BIN_M, CorridorState, Plane


@dataclass(frozen=True, eq=False)
class Attachment:
    """wall (T,): index of the wall each track lies on, -1 for none. strong (T,): the track has a depth of its own.
    stray (T,): strong and on no known wall."""

    wall: np.ndarray
    strong: np.ndarray
    stray: np.ndarray

    def only(self, some: np.ndarray) -> Attachment:
        """The same for `some` (T,) bool of the tracks; the others lie on no wall."""
        wall = np.where(some, self.wall, -1)
        return Attachment(wall, self.strong, self.strong & (wall < 0))


def attach(state: CorridorState, fit: TrackFit, rules: WallRules) -> Attachment:
    """Wall of every track: best agreement for tracks with depth, nearest hit for tracks with some, none otherwise."""
    t = len(fit.rho)
    strong = fit.good & (fit.rho > 1.0 / rules.farthest_m) & (fit.rho_sigma < rules.strong_share * fit.rho)
    some = fit.good & ~strong & (fit.rho_sigma < rules.some_per_m)
    wall, best, nearest = np.full(t, -1), np.full(t, np.inf), np.zeros(t)
    upright, directions = sum(not p.is_floor for p in state.planes), fit.directions()
    for j, plane in enumerate(state.planes):
        if plane.is_floor and upright < rules.walls_before_floor:
            continue
        rho, miss = _miss(state, j, fit, directions, rules)
        take = (miss < 1.0) & np.where(strong, miss < best, some & (rho > nearest))
        wall[take], best[take], nearest[take] = j, miss[take], rho[take]
    return Attachment(wall, strong, strong & (wall < 0))


def _miss(
    state: CorridorState, j: int, fit: TrackFit, directions: np.ndarray, rules: WallRules
) -> tuple[np.ndarray, np.ndarray]:
    """Inverse distance (T,) at which each ray (T, 3) meets plane j, and by how much of the tolerance (T,) the track's own
    depth misses it; infinite where the ray does not meet the plane within its reach."""
    plane, block = state.planes[j], state.plane_slice(j).start
    rho, gap = met_at(plane, fit.anchor, directions)
    hit = fit.anchor + directions / np.where(rho > 0, rho, 1.0)[:, None]
    reachable = (rho > 0.03) & within(plane, hit, rules.reach_m)
    plane_sigma = np.minimum(np.sqrt(state.covariance[block, block]) * np.abs(rho / gap), np.abs(rho))
    tolerance = rules.agree_sigmas * np.hypot(fit.rho_sigma, plane_sigma) + 0.03 * np.abs(fit.rho)
    return rho, np.where(reachable, np.abs(rho - fit.rho) / tolerance, np.inf)


def met_at(plane: Plane, anchor: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse distance (T,) at which rays (T, 3) from their anchors (T, 3) meet a plane, negative behind them, and how far
    the anchors are off it (T,), metres along its normal."""
    gap = plane.level() - anchor @ plane.normal()
    gap = np.where(np.abs(gap) < 1e-6, 1e-6, gap)
    return directions @ plane.normal() / gap, gap


def within(plane: Plane, points: np.ndarray, reach_m: float) -> np.ndarray:
    """(T,) bool: the point's coordinate along the wall lies in its extent, widened by `reach_m`. Floors have no end."""
    if plane.is_floor:
        return np.ones(len(points), bool)
    along = points[:, 1 - plane.axis]
    return (along > plane.low_m - reach_m) & (along < plane.high_m + reach_m)


def record_hits(planes: list[Plane], wall: np.ndarray, points: np.ndarray, cameras: np.ndarray) -> list[Plane]:
    """The planes with the extents, counts and sides of the tracks found on them: wall (T,), points (T, 3), and
    from where each was seen last, cameras (T, 3)."""
    out = list(planes)
    for j in np.unique(wall[wall >= 0]):
        p, hit = out[j], points[wall == j]
        above = int((cameras[wall == j] @ p.normal() > p.level()).sum())
        sides = (p.sides[0] + len(hit) - above, p.sides[1] + above)
        out[j] = with_hits(replace(p, sides=sides), hit[:, p.along])
    return out


def with_hits(plane: Plane, along: np.ndarray) -> Plane:
    """The plane with more hits at the (M,) coordinates along it. It reaches as far as stretches with three hits do: a
    single track attached wrongly beyond the end must not draw the wall out."""
    support = dict(plane.support)
    for k in np.floor(along / BIN_M).astype(int).tolist():
        support[k] = support.get(k, 0) + 1
    low, high = min(plane.low_m, float(along.min())), max(plane.high_m, float(along.max()))
    plane = replace(plane, hits=plane.hits + len(along), support=support)
    if firm := plane.firm:
        low, high = max(low, BIN_M * min(firm)), min(high, BIN_M * (max(firm) + 1))
    return replace(plane, low_m=low, high_m=high)


class WallFinder:
    """Remembers points that lie on no known wall and says when enough of them line up."""

    def __init__(self, rules: WallRules, camera_height_m: float) -> None:
        self._rules, self._eye = rules, camera_height_m
        self._points = np.zeros((0, 3))
        self._views = np.zeros(0, int)

    def remember(self, points: np.ndarray, view: int) -> None:
        fresh = self._views > view - self._rules.memory
        self._points = np.concatenate([self._points[fresh], points])
        self._views = np.concatenate([self._views[fresh], np.full(len(points), view)])

    def rescale(self, factor: float, centre: np.ndarray) -> None:
        self._points = centre + factor * (self._points - centre)

    def find(self, planes: list[Plane]) -> Plane | None:
        """The best supported new wall (floor and ceiling only once two walls are known), or None."""
        axes = (0, 1, 2) if sum(not p.is_floor for p in planes) >= 2 else (0, 1)
        found = [self._best_slot(axis, planes) for axis in axes]
        ranked = sorted((f for f in found if f is not None), key=lambda f: -f[0])
        if not ranked:
            return None
        _, plane, used = ranked[0]
        self._points, self._views = self._points[~used], self._views[~used]
        return plane

    def _best_slot(self, axis: int, planes: list[Plane]):
        """(support, plane, mask of its points) of the fullest slot along one axis, or None."""
        r, values = self._rules, self._points[:, axis]
        if len(values) < r.points:
            return None
        free = self._unclaimed(axis, planes)
        order = np.sort(values[free])
        if len(order) < r.points:
            return None
        counts = np.searchsorted(order, order + r.slot_m, side="right") - np.arange(len(order))
        start = order[np.argmax(counts)]
        used = free & (values >= start) & (values <= start + r.slot_m)
        if used.sum() < r.points or not self._spread_out(axis, self._points[used]):
            return None
        return int(used.sum()), self._plane(axis, self._points[used]), used

    def _unclaimed(self, axis: int, planes: list[Plane]) -> np.ndarray:
        """Points not near a known plane of this axis; of floor and ceiling each only one may exist."""
        free = np.ones(len(self._points), bool)
        if axis == 2:
            height = self._points[:, 2] - self._eye
            free &= np.abs(height) > 0.7
            for p in planes:
                if p.is_floor:
                    free &= (height > 0) != (p.offset_m > self._eye)
            return free
        for p in planes:
            if p.axis == axis:
                off = self._points[:, axis] - p.at(self._points[:, 1 - axis])
                free &= ~((np.abs(off) < self._rules.near_m) & within(p, self._points, 1.0))
        return free

    def _spread_out(self, axis: int, points: np.ndarray) -> bool:
        """Enough extent and enough filled stretches along the plane; for walls enough heights too."""
        r = self._rules
        across = 2 if axis < 2 else 1
        along = points[:, 1 - axis] if axis < 2 else points[:, 0]
        bands = len(np.unique(np.floor(points[:, across] / 0.15)))
        stretches = len(np.unique(np.floor(along / 0.2)))
        return bool(np.ptp(along) >= r.spread_m and stretches >= r.bins and bands >= r.heights)

    def _plane(self, axis: int, points: np.ndarray) -> Plane:
        along = points[:, 1 - axis] if axis < 2 else points[:, 0]
        offset, pivot = float(np.median(points[:, axis])), float(along.mean())
        return with_hits(Plane(axis, offset, 0.0, pivot, float(along.min()), float(along.max())), along)


def merge_one(state: CorridorState, rules: WallRules) -> bool:
    """Join the first two parallel walls that are one: constrain them to each other, keep the better seen one."""
    for i in range(len(state.planes)):
        for j in range(i + 1, len(state.planes)):
            if state.planes[i].axis == state.planes[j].axis and _same(state, i, j, rules):
                _join(state, i, j)
                return True
    return False


def _difference(state: CorridorState, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
    """(2,) difference of the walls in offset, where they overlap or meet, and in angle; its Jacobian (2, D)."""
    a, b = state.planes[i], state.planes[j]
    middle = 0.5 * (max(a.low_m, b.low_m) + min(a.high_m, b.high_m)) if not a.is_floor else 0.0
    gap, row = state.apart(i, j, middle)
    turned = np.zeros(len(row))
    turned[[state.plane_slice(i).start + 1, state.plane_slice(j).start + 1]] = 1.0, -1.0
    return np.array([gap, a.angle_rad - b.angle_rad]), np.stack([row, turned])


def _same(state: CorridorState, i: int, j: int, rules: WallRules) -> bool:
    a, b = state.planes[i], state.planes[j]
    overlap = min(a.high_m, b.high_m) - max(a.low_m, b.low_m)
    if not a.is_floor and overlap < -rules.merge_gap_m:
        return False
    difference, jacobian = _difference(state, i, j)
    if abs(difference[0]) >= rules.merge_m:
        return False
    spread = jacobian @ state.covariance @ jacobian.T + np.diag([0.02, 0.003]) ** 2
    return nees(difference, spread) < rules.merge_chi2


def _join(state: CorridorState, i: int, j: int) -> None:
    difference, jacobian = _difference(state, i, j)
    change = correct(state.covariance, jacobian, -difference, np.diag([0.02, 0.003]) ** 2)
    state.add(change.delta, change.covariance)
    keep, drop = (i, j) if state.planes[i].hits >= state.planes[j].hits else (j, i)
    a, b = state.planes[keep], state.planes[drop]
    joined = replace(
        a,
        low_m=min(a.low_m, b.low_m),
        high_m=max(a.high_m, b.high_m),
        hits=a.hits + b.hits,
        support={k: a.support.get(k, 0) + b.support.get(k, 0) for k in {*a.support, *b.support}},
        paired=a.paired or b.paired,
        sides=(a.sides[0] + b.sides[0], a.sides[1] + b.sides[1]),
    )
    state.planes[keep] = joined
    state.remove_plane(drop)
