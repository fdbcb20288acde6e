"""Where to lead a camera through free space that nobody has written a survey for: start, places, and a round tour.

The tour sees every part of the free space that the robot can get to from `SIGHT_M` at most, keeps to the middle of what
it passes, and ends a little way past where it began, so that the survey's loop can be closed. Steps: viewpoints by greedy
cover (the art gallery as set cover: Gonzalez-Banos and Latombe 2001), their order as a travelling salesman (farthest
insertion, then 2-opt: Croes 1958, and Or-opt: Or 1976) over shortest ways on the clearance map, bends pulled straight
(Douglas and Peucker 1973) where that costs no clearance. No chance: equal grids give equal tours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

SIGHT_M = 2.5  # the survey sees every free spot from so near at least; grows with the building, see `_sight_m`
SPARE_M = 0.02  # more clearance than asked for: what lies between the middles of two cells may be this much nearer
PAST_M = 1.0  # the tour goes on so far past its start, that the last views are like the first
BEND_M = 0.3  # a bend flatter than this is pulled straight
ROOMY_M = 0.5  # clearance beyond what is needed that a detour is worth
MOST_CELLS = 250_000  # of the grid that is searched; finer grids are searched with larger cells
RAYS = 72


@dataclass(frozen=True, eq=False)
class Tour:
    """start: x, y in metres and yaw in radians along the first leg. places: (name, x, y) along the way, the last one is
    `home`, the start. route_m (N, 2): the survey, its first point is the start. All in the frame of the grid."""

    start: tuple[float, float, float]
    places: tuple[tuple[str, float, float], ...]
    route_m: np.ndarray


def propose(grid: OccupancyGrid, radius_m: float, *, start: tuple[float, ...] | None = None, margin_m: float = 0.1,
            places: int = 4) -> Tour:
    """A survey of the free space of a grid (unknown is not free) for a robot of that radius.

    start: (x, y) or (x, y, yaw) metres; without one, the roomiest spot of the largest space the robot fits into. The route
    keeps radius_m + margin_m from what is not free. places: how many, `home` included. Raises ConfigError where the robot
    does not fit."""
    coarse = coarser(grid, MOST_CELLS)
    return tour_on(coarse, clearance_of(coarse), radius_m + margin_m, start=start, places=places)


def tour_on(grid: OccupancyGrid, clearance_m: np.ndarray, need_m: float, *, start: tuple[float, ...] | None = None,
            places: int = 4) -> Tour:
    """The same over a clearance map (H, W): metres from the middle of each cell to the nearest thing that is not free."""
    ground = Ground(grid, clearance_m, need_m, start)
    views = ground.viewpoints()
    stops = np.array([ground.home, *([node for node in views if node != ground.home] or [ground.farthest()])])
    order = round_trip(ground.ways_m(stops))
    nodes = ground.walk(thinned(ground, stops[order]))
    route = ground.straightened(nodes)
    yaw = _heading(route) if start is None or len(start) < 3 else float(start[2])
    if start is not None:
        route[0] = start[:2]
    route = past_start(route)
    x, y = float(route[0, 0]), float(route[0, 1])
    return Tour((x, y, yaw), (*ground.places(nodes, places - 1), ("home", x, y)), route)


def clearance_of(grid: OccupancyGrid) -> np.ndarray:
    """(H, W) metres from the middle of each cell to the nearest edge of a cell that is not free; the outside is not."""
    from scipy.ndimage import distance_transform_edt

    free = np.pad(grid.free(), 1)
    nearest = distance_transform_edt(free, return_distances=False, return_indices=True)
    gaps = np.maximum(np.abs(nearest - np.indices(free.shape)) - 0.5, 0.0)
    clearance: np.ndarray = np.sqrt(gaps[0] ** 2 + gaps[1] ** 2)[1:-1, 1:-1] * grid.resolution_m
    return clearance


def coarser(grid: OccupancyGrid, most_cells: int) -> OccupancyGrid:
    """The grid with cells so large that there are at most that many; a cell is free where all it covers is."""
    factor = int(np.ceil(np.sqrt(grid.probability.size / most_cells)))
    if factor <= 1:
        return grid
    rows, columns = (-(-size // factor) for size in grid.shape)
    free = np.zeros((rows * factor, columns * factor), bool)
    free[: grid.shape[0], : grid.shape[1]] = grid.free()
    whole = free.reshape(rows, factor, columns, factor).all(axis=(1, 3))
    probability = np.where(whole, 0.0, 1.0).astype(np.float32)
    return OccupancyGrid(probability, grid.resolution_m * factor, grid.origin_m)


def _heading(route_m: np.ndarray) -> float:
    if len(route_m) < 2:
        return 0.0
    dx, dy = route_m[1] - route_m[0]
    return round(float(np.arctan2(dy, dx)), 6)


class Ground:
    """Where the robot's middle may be: cells with clearance enough that it can reach, and the ways between them."""

    def __init__(self, grid: OccupancyGrid, clearance_m: np.ndarray, need_m: float,
                 start: tuple[float, ...] | None) -> None:
        from scipy.ndimage import label

        self.grid, self.clearance_m, self.need_m = grid, clearance_m, need_m + SPARE_M
        wide = clearance_m >= self.need_m
        if not wide.any():
            raise ConfigError(f"a robot that needs {need_m:.2f} m to each side fits nowhere in this free space; "
                              f"the widest spot has {float(np.max(clearance_m, initial=0.0)):.2f} m")
        regions, _ = label(wide, structure=np.ones((3, 3)))
        cell = self._first(regions, start)
        self.reached = regions == regions[cell]
        self.cells = np.argwhere(self.reached)
        self.number = np.full(grid.shape, -1)
        self.number[self.reached] = np.arange(len(self.cells))
        self.home = int(self.number[cell])
        self.points_m = grid.centres(self.cells)
        self.graph = self._graph()

    def _first(self, regions: np.ndarray, start: tuple[float, ...] | None) -> tuple[int, int]:
        """The cell to begin in: that of the start or the nearest that is wide enough, or the roomiest of the largest
        region."""
        if start is None:
            sizes = np.bincount(regions.ravel())
            sizes[0] = 0
            room = np.where(regions == int(np.argmax(sizes)), self.clearance_m, -1.0)
            row, column = np.unravel_index(int(np.argmax(room)), room.shape)
            return int(row), int(column)
        cells = np.argwhere(regions > 0)
        gaps = np.linalg.norm(self.grid.centres(cells) - np.array(start[:2], float), axis=1)
        best = int(np.argmin(gaps))
        if gaps[best] > 2.0 * self.need_m:
            raise ConfigError(f"start ({start[0]:g}, {start[1]:g}): a robot that needs {self.need_m - SPARE_M:.2f} m to "
                              f"each side does not fit there; the nearest spot is {gaps[best]:.1f} m away")
        return int(cells[best, 0]), int(cells[best, 1])

    def _graph(self) -> Any:
        """Eight neighbours; a metre costs 1 in the open and up to 2.5 along a wall."""
        from scipy.sparse import coo_array

        self.price = 1.0 + 1.5 * np.clip(1.0 - (self.clearance_m - self.need_m) / ROOMY_M, 0.0, 1.0)
        rows, columns, costs = [], [], []
        height, width = self.grid.shape
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here = (slice(0, height - dr), slice(max(0, -dc), width - max(0, dc)))
            there = (slice(dr, height), slice(max(0, dc), width + min(0, dc)))
            both = self.reached[here] & self.reached[there]
            length = self.grid.resolution_m * float(np.hypot(dr, dc))
            rows.append(self.number[here][both])
            columns.append(self.number[there][both])
            costs.append(0.5 * length * (self.price[here] + self.price[there])[both])
        one, other, cost = (np.concatenate(part) for part in (rows, columns, costs))
        count = len(self.cells)
        return coo_array((np.r_[cost, cost], (np.r_[one, other], np.r_[other, one])), shape=(count, count)).tocsr()

    # --- what is seen -----------------------------------------------------------------------------------------------

    def viewpoints(self) -> list[int]:
        """Nodes from which all that can be seen is seen, each taking in as much as possible of what no other sees."""
        self.spots = self._roomiest(max(0.4, 2.0 * self.grid.resolution_m))
        self.sees = self._seen_from(self.spots)
        self.needed = self.sees.any(axis=0)
        missing = self.needed.copy()
        chosen: list[int] = []
        while True:
            gain = (self.sees & missing).sum(axis=1)
            best = int(np.argmax(np.where(gain > 1, gain / self.price[self.reached][self.spots], 0.0)))
            if gain[best] < 2:
                return chosen
            chosen.append(int(self.spots[best]))
            missing &= ~self.sees[best]

    def _roomiest(self, spacing_m: float) -> np.ndarray:
        """(K,) nodes: the one with most clearance in each square of that size. Sets `self.spot_of` (nodes,)."""
        size = max(1, round(spacing_m / self.grid.resolution_m))
        square = (self.cells[:, 0] // size) * (self.grid.shape[1] // size + 1) + self.cells[:, 1] // size
        room = self.clearance_m[self.reached]
        order = np.lexsort((np.arange(len(square)), -room, square))
        _, first = np.unique(square[order], return_index=True)
        _, self.spot_of = np.unique(square, return_inverse=True)
        spots: np.ndarray = order[first]
        return spots

    def _sight_m(self) -> float:
        """Large buildings are looked at in larger pieces: some hundred viewpoints at most."""
        area_m2 = float(self.grid.free().sum()) * self.grid.resolution_m**2
        return max(SIGHT_M, float(np.sqrt(area_m2)) / 8.0)

    def _seen_from(self, nodes: np.ndarray) -> np.ndarray:
        """(K, squares) bool: some ray from the node meets the square of about 0.3 m before anything that is not free."""
        step, sight = self.grid.resolution_m, self._sight_m()
        turn = 2.0 * np.pi * (np.arange(RAYS) + 0.37) / RAYS
        along = np.arange(0.0, sight, step) / step
        offsets = (np.stack([np.sin(turn), np.cos(turn)])[:, :, None] * along).round().astype(int)  # (2, rays, steps)
        size = max(1, round(0.3 / step))
        columns = -(-self.grid.shape[1] // size)
        seen = np.zeros((len(nodes), columns * -(-self.grid.shape[0] // size)), bool)
        free, limit = self.grid.free(), np.array(self.grid.shape) - 1
        for index, (row, column) in enumerate(self.cells[nodes]):
            r, c = np.clip(row + offsets[0], 0, limit[0]), np.clip(column + offsets[1], 0, limit[1])
            open_ = np.logical_and.accumulate(free[r, c], axis=1)
            seen[index, (r[open_] // size) * columns + c[open_] // size] = True
        return seen

    def seen_by(self, nodes: np.ndarray) -> np.ndarray:
        """(squares,) bool: seen from a way through these nodes."""
        seen: np.ndarray = self.sees[np.unique(self.spot_of[nodes])].any(axis=0)
        return seen

    # --- ways -------------------------------------------------------------------------------------------------------

    def ways_m(self, stops: np.ndarray) -> np.ndarray:
        """(S, S) cost of the best way between stops; remembers the ways."""
        from scipy.sparse.csgraph import dijkstra

        costs, self.before = dijkstra(self.graph, indices=stops, return_predecessors=True)
        self.row_of = {int(stop): row for row, stop in enumerate(stops)}
        matrix: np.ndarray = costs[:, stops]
        return matrix

    def way(self, a: int, b: int) -> list[int]:
        """Nodes from stop a to stop b, without a."""
        before, nodes = self.before[self.row_of[a]], []
        while b != a:
            nodes.append(b)
            b = int(before[b])
        return nodes[::-1]

    def walk(self, stops: np.ndarray) -> np.ndarray:
        """(N,) nodes of the round trip through the stops, from the first one and back to it."""
        nodes = [int(stops[0])]
        for a, b in zip(stops, [*stops[1:], stops[0]], strict=True):
            nodes += self.way(int(a), int(b))
        return np.array(nodes)

    def straightened(self, nodes: np.ndarray) -> np.ndarray:
        """(M, 2) metres: the way with its bends pulled straight where the robot fits and it is no dearer."""
        points = self.points_m[nodes]
        price = self.price[self.reached][nodes]
        lengths = np.hypot(*np.diff(points, axis=0).T)
        spent = np.r_[0.0, np.cumsum(0.5 * (price[1:] + price[:-1]) * lengths)]
        keep, waiting = {0, len(points) - 1}, [(0, len(points) - 1)]
        while waiting:
            i, j = waiting.pop()
            if j - i < 2:
                continue
            aside = _aside(points[i : j + 1])
            if aside.max() <= BEND_M and self._fits(points[i], points[j], 1.03 * (spent[j] - spent[i]) + 0.02):
                continue
            middle = i + int(np.argmax(aside)) if aside.max() > 1e-9 else (i + j) // 2
            middle = min(max(middle, i + 1), j - 1)
            keep.add(middle)
            waiting += [(i, middle), (middle, j)]
        route: np.ndarray = points[sorted(keep)].round(4)
        return route

    def _fits(self, a: np.ndarray, b: np.ndarray, most: float) -> bool:
        """The straight way from a to b keeps its distance and costs at most so much."""
        from scipy.ndimage import map_coordinates

        length, step = float(np.hypot(*(b - a))), self.grid.resolution_m
        along = np.linspace(0.0, 1.0, 2 + int(2.0 * length / step))[:, None]
        where = ((a + along * (b - a) - np.array(self.grid.origin_m)) / step - 0.5).T[::-1]
        clear = map_coordinates(self.clearance_m, where, order=1, mode="nearest")
        if clear.min() < self.need_m - 1e-9:
            return False
        price = 1.0 + 1.5 * np.clip(1.0 - (clear - self.need_m) / ROOMY_M, 0.0, 1.0)
        return float(price.mean()) * length <= most

    def farthest(self) -> int:
        """The node farthest from the start. Raises ConfigError where there is no other."""
        from scipy.sparse.csgraph import dijkstra

        node = int(np.argmax(dijkstra(self.graph, indices=self.home)))
        if node == self.home:
            raise ConfigError("the free space leaves the robot no room to move; a survey needs some way to go")
        return node

    def places(self, walked: np.ndarray, count: int) -> tuple[tuple[str, float, float], ...]:
        """Places far from one another and from the start by the way between them, in the order in which the tour passes."""
        from scipy.sparse.csgraph import dijkstra

        gaps = dijkstra(self.graph, indices=self.home)[self.spots]
        price = self.price[self.reached][self.spots]
        chosen: list[int] = []
        while len(chosen) < count and gaps.max() > 2.0 * self.need_m:
            chosen.append(int(self.spots[int(np.argmax(gaps / price))]))
            gaps = np.minimum(gaps, dijkstra(self.graph, indices=chosen[-1])[self.spots])
        passed = [int(np.argmin(np.abs(self.points_m[walked] - self.points_m[node]).sum(axis=1))) for node in chosen]
        ordered = [chosen[index] for index in np.argsort(passed, kind="stable")]
        return tuple((f"place_{number}", round(float(x), 4), round(float(y), 4))
                     for number, (x, y) in enumerate(self.points_m[ordered], 1))


def thinned(ground: Ground, stops: np.ndarray) -> np.ndarray:
    """The stops without those that the way between the others sees enough for; the first one stays."""
    kept = [int(stop) for stop in stops]
    legs = {(a, b): ground.way(a, b) for a in kept for b in kept if a != b}

    def seen(some: list[int]) -> int:
        nodes = [some[0]] + [node for a, b in zip(some, [*some[1:], some[0]], strict=True) if a != b for node in legs[a, b]]
        return int((ground.seen_by(np.array(nodes)) & ground.needed).sum())

    enough = seen(kept)
    for stop in reversed(kept[1:]):
        fewer = [other for other in kept if other != stop]
        if seen(fewer) >= enough - 1:
            kept = fewer
    return np.array(kept)


def round_trip(costs: np.ndarray) -> np.ndarray:
    """(S,) order of a cheap round trip that begins with 0: farthest insertion, then 2-opt and moves of up to three stops
    until nothing gains."""
    order, left = [0], list(range(1, len(costs)))
    while left:
        stop = left.pop(int(np.argmax(costs[np.ix_(order, left)].min(axis=0))))
        order = _inserted(order, [stop], costs)
    while True:
        cost = _length(order, costs)
        order = _moved(_uncrossed(order, costs), costs)
        if _length(order, costs) >= cost - 1e-6:
            return np.array(order)


def _length(order: list[int], costs: np.ndarray) -> float:
    return float(costs[order, [*order[1:], order[0]]].sum())


def _inserted(order: list[int], piece: list[int], costs: np.ndarray) -> list[int]:
    """The trip with the piece put in where it costs least, either way round, never before the first stop."""
    ends = [*order[1:], order[0]]
    ways = [(costs[order, way[0]] + costs[ends, way[-1]] - costs[order, ends], way) for way in (piece, piece[::-1])]
    extra, way = ways[0] if ways[0][0].min() <= ways[1][0].min() else ways[1]
    at = int(np.argmin(extra)) + 1
    return order[:at] + way + order[at:]


def _uncrossed(order: list[int], costs: np.ndarray) -> list[int]:
    """2-opt: pieces turned round as long as that gains."""
    better = True
    while better:
        better = False
        for i in range(1, len(order) - 1):
            for j in range(i + 1, len(order)):
                a, b, c, d = order[i - 1], order[i], order[j], order[(j + 1) % len(order)]
                if costs[a, c] + costs[b, d] < costs[a, b] + costs[c, d] - 1e-6:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    better = True
    return order


def _moved(order: list[int], costs: np.ndarray) -> list[int]:
    """Or-opt: pieces of up to three stops taken out and put in elsewhere where that gains (Or 1976)."""
    for size in (3, 2, 1):
        for i in range(1, len(order) - size + 1):
            rest = order[:i] + order[i + size :]
            other = _inserted(rest, order[i : i + size], costs)
            if _length(other, costs) < _length(order, costs) - 1e-6:
                order = other
    return order


def past_start(route_m: np.ndarray) -> np.ndarray:
    """The closed route, and once more along its beginning for PAST_M."""
    left, points = PAST_M, list(route_m)
    for a, b in zip(route_m[:-1], route_m[1:], strict=True):
        length = float(np.hypot(*(b - a)))
        if length >= left:
            points.append((a + (b - a) * (left / length)).round(4))
            break
        points.append(b)
        left -= length
    out: np.ndarray = np.array(points)
    return out


def _aside(points: np.ndarray) -> np.ndarray:
    """(N,) distance of points from the straight line between the first and the last."""
    a, b = points[0], points[-1]
    along = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0.0, 1.0)
    aside: np.ndarray = np.hypot(*(points - a - along[:, None] * (b - a)).T)
    return aside
