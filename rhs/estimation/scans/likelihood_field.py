"""How well a scan fits a map seen from many poses: the likelihood field. Loads numba: import it when it is needed.

Source: Thrun, Burgard, Fox, Probabilistic Robotics, 6.4. Each beam's end is compared with the nearest obstacle. Three
additions: a pose inside an obstacle is punished, and so is a beam that passes an obstacle half way (the plain field lets
scans see through walls); beams that end in the open, well before any wall, may cost `surprise` at most all together:
something new may stand there, whereas nothing lets a beam through a wall. The logarithm is multiplied by `trust`, because
neighbouring beams share their errors.
"""

from __future__ import annotations

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.api.jit import compiled
from rhs.api.records import Scan

from .settings import FieldSettings


class LikelihoodField:
    """The map as a table of log-likelihoods, ready for thousands of poses."""

    def __init__(self, grid: OccupancyGrid, settings: FieldSettings, *, trust: float = 0.25, surprise: float = 1.0) -> None:
        """trust: exponent on the product of the beams. surprise: most that all beams ending in the open cost together, as a
        logarithm after `trust`."""
        from scipy.ndimage import distance_transform_edt

        self.settings, self.grid, self._cell_m = settings, grid, grid.resolution_m
        self._trust, self._surprise = trust, surprise
        occupied = grid.occupied()
        far = np.full(grid.shape, 1e3)
        gap_m = distance_transform_edt(~occupied) * grid.resolution_m if occupied.any() else far
        hit = (1.0 - settings.stray) * np.exp(-0.5 * (gap_m / settings.sigma_m) ** 2)
        self._log_end = np.log(hit + settings.stray).astype(np.float32)
        self._log_stray = np.float32(np.log(settings.stray))
        self._solid = (gap_m < 0.5 * grid.resolution_m).astype(np.uint8)
        self._open = (grid.free() & (gap_m > settings.open_m)).astype(np.uint8)
        free = np.argwhere(grid.free() & (gap_m > 0.2))
        self._room = grid.centres(free) if len(free) else np.empty((0, 2))

    def anywhere(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, 3) states spread evenly over the free room, any heading."""
        if len(self._room) == 0:
            return np.zeros((count, 3))
        spot = self._room[rng.integers(0, len(self._room), count)]
        jitter = rng.uniform(-0.5, 0.5, (count, 2)) * self.grid.resolution_m
        return np.column_stack([spot + jitter, rng.uniform(-np.pi, np.pi, count)])

    @property
    def area_m2(self) -> float:
        """Size of the free room, square metres."""
        return max(len(self._room), 1) * self.grid.resolution_m**2

    def log_likelihood(self, states: np.ndarray, scan: Scan, *, forgiving: bool = False) -> np.ndarray:
        """(N,) of the scan seen from states (N, 3); all zero when the scan holds no usable beam. forgiving: something new
        may stand in the open (`surprise`); for a robot that knows where it is, not for one that is looking for itself."""
        ends = self._ends(scan)
        if len(ends) == 0:
            return np.zeros(len(states))
        least = -self._surprise / self._trust if forgiving and self._trust > 0 else -np.inf
        cells = (np.ascontiguousarray(states, float) - [*self.grid.origin_m, 0.0]) / [self._cell_m, self._cell_m, 1.0]
        start = np.asarray(scan.origin_xy_m, float) / self._cell_m
        tables = (self._log_end, self._solid, self._open)
        return self._trust * _score(cells, start, ends / self._cell_m, tables, self._log_stray, least)

    def _ends(self, scan: Scan) -> np.ndarray:
        """(B, 2) ends of some evenly spaced beams in the body frame, metres."""
        reach, bearing = np.asarray(scan.ranges_m, float), np.asarray(scan.bearings_rad, float)
        return _ends_of(reach, bearing, self.settings.range_max_m, self.settings.beams) + scan.origin_xy_m


@compiled
def _ends_of(reach: np.ndarray, bearing: np.ndarray, most_m: float, beams: int) -> np.ndarray:
    """(B, 2) ends of up to `beams` beams no longer than most_m, evenly spaced among these, from the scanner."""
    known, count = np.empty(len(reach), np.int64), 0
    for k in range(len(reach)):
        if np.isfinite(reach[k]) and reach[k] <= most_m:
            known[count] = k
            count += 1
    used = min(count, beams)
    ends = np.empty((used, 2))
    step = (count - 1) / max(beams - 1, 1) if count > beams else 1.0
    for n in range(used):
        k = known[int(n * step)] if n < used - 1 or used < 2 else known[count - 1]
        ends[n, 0], ends[n, 1] = np.cos(bearing[k]) * reach[k], np.sin(bearing[k]) * reach[k]
    return ends


@compiled
def _score(states: np.ndarray, start: np.ndarray, ends: np.ndarray, tables: tuple[np.ndarray, np.ndarray, np.ndarray],
           log_stray: np.float32, least_open: float) -> np.ndarray:
    """Log-likelihood at each state (N, 3), all lengths in cells from the corner of the map. A beam between two points of
    the map does not leave it, so only its ends are looked at for that."""
    log_end, solid, open_room = tables
    rows, columns = log_end.shape
    out = np.empty(len(states))
    for k in range(len(states)):
        c, s = np.cos(states[k, 2]), np.sin(states[k, 2])
        x0, y0 = states[k, 0], states[k, 1]
        sx, sy = x0 + c * start[0] - s * start[1], y0 + s * start[0] + c * start[1]
        if x0 < 0 or y0 < 0 or x0 >= columns or y0 >= rows or sx < 0 or sy < 0 or sx >= columns or sy >= rows:
            out[k] = 2 * len(ends) * log_stray
            continue
        total = len(ends) * log_stray if solid[int(y0), int(x0)] else 0.0
        in_the_open = 0.0
        for b in range(len(ends)):
            ex, ey = x0 + c * ends[b, 0] - s * ends[b, 1], y0 + s * ends[b, 0] + c * ends[b, 1]
            if not (ex >= 0 and ey >= 0 and ex < columns and ey < rows):
                total += log_stray
                continue
            dx, dy = ex - sx, ey - sy
            early = np.uint32(sy + 0.35 * dy), np.uint32(sx + 0.35 * dx)  # unsigned: an index from the end is not looked for
            late = np.uint32(sy + 0.7 * dy), np.uint32(sx + 0.7 * dx)
            end = np.uint32(ey), np.uint32(ex)
            if solid[early] or solid[late]:
                total += log_stray
            elif open_room[end]:
                in_the_open += log_end[end]
            else:
                total += log_end[end]
        out[k] = total + max(in_the_open, least_open)
    return out
