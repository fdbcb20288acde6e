"""Where to lead a camera through free space that nobody has written a survey for: start, places, and a round tour.

The tour sees every part of the free space that the robot can get to, with a camera that looks ahead (what little it misses
is less than a square metre in one piece), keeps to the middle of what it passes, and ends a little way past where it began,
so that the survey's loop can be closed. Steps: viewpoints by greedy cover (the art gallery as set cover: Gonzalez-Banos and
Latombe 2001), their order as a travelling salesman over shortest ways on the clearance map, bends pulled straight (Douglas
and Peucker 1973) where that costs no clearance. No chance: equal grids give equal tours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

from .clearance import clearance_of, coarser, neighbours
from .round_trip import aside_m, past_start, round_trip

SIGHT_M = 2.5  # the survey sees every free spot from so near at least; grows with the building, see `_sight_m`
MARGIN_M = 0.1  # that a route keeps from what is not free, beyond the robot's radius
SPARE_M = 0.02  # more clearance than asked for: what lies between the middles of two cells may be this much nearer
BEND_M = 0.3  # a bend flatter than this is pulled straight
ROOMY_M = 0.5  # clearance beyond what is needed that a detour is worth
MOST_CELLS = 250_000  # of the grid that is searched; finer grids are searched with larger cells
MOST_SPOTS = 8_000  # from which is looked, and twice as many squares that are looked at: in halls both are larger
RAYS = 72
TURNS = 2.0 * np.pi * (np.arange(RAYS) + 0.37) / RAYS
UNITS = np.array([(math.sin(turn), math.cos(turn)) for turn in TURNS.tolist()]).T  # by the C library: see random/shapes.py
PLACE_M = 1.3  # a known place may be moved so far
VIEW_RAD = np.radians(50.0)  # what a camera sees at once; a Kinect sees 57 degrees
VIEW_M = 4.0  # and so far
LOOKS = 4  # rounds in which the tour is led to what a camera that looks ahead has missed
AT_ONCE = 32  # stops whose ways are looked for together: a row of costs is a megabyte in a large building
MISSED = 8  # squares of 0.3 m that are worth a detour


Place = tuple[str, float, float]  # name, x, y


@dataclass(frozen=True, eq=False)
class Tour:
    """start: x, y in metres and yaw in radians along the first leg. places: along the way, or in the order given; the last
    one is `home`, the start. route_m (N, 2): the survey, its first point is the start. All in the frame of the grid."""

    start: tuple[float, float, float]
    places: tuple[Place, ...]
    route_m: np.ndarray


def propose(grid: OccupancyGrid, radius_m: float, *, start: tuple[float, ...] | None = None, margin_m: float = MARGIN_M,
            places: int | Sequence[Place] = 4) -> Tour:
    """A survey of the free space of a grid (unknown is not free) for a robot of that radius.

    start: (x, y) or (x, y, yaw) metres; without one, the roomiest spot of the largest space the robot fits into. The route
    keeps radius_m + margin_m from what is not free. places: how many to choose, `home` included; or those that are known,
    (name, x, y): the tour passes them all, moved by up to PLACE_M to where the robot can stand. Raises ConfigError where the
    robot does not fit."""
    coarse = coarser(grid, MOST_CELLS)
    return tour_on(coarse, clearance_of(coarse), radius_m + margin_m, start=start, places=places)


def ground_of(grid: OccupancyGrid, radius_m: float, start: tuple[float, ...], margin_m: float = MARGIN_M) -> Ground:
    """Where the middle of a robot of that radius may be, from a start (x, y, ...) metres. Raises ConfigError where it does
    not fit."""
    coarse = coarser(grid, MOST_CELLS)
    return Ground(coarse, clearance_of(coarse), radius_m + margin_m, start)


def tour_on(grid: OccupancyGrid, clearance_m: np.ndarray, need_m: float, *, start: tuple[float, ...] | None = None,
            places: int | Sequence[Place] = 4) -> Tour:
    """The same over a clearance map (H, W): metres from the middle of each cell to the nearest thing that is not free."""
    ground = Ground(grid, clearance_m, need_m, start)
    views = ground.viewpoints()
    stops = [ground.home, *([node for node in views if node != ground.home] or [ground.farthest()])]
    known = [] if isinstance(places, int) else [ground.standing(place) for place in places]
    more = [*known]
    for _ in range(LOOKS):
        nodes = ground.tour(stops, more)
        route = ground.straightened(nodes)
        missed = ground.missed(route)
        if not missed:
            break
        more += missed
    yaw = _heading(route) if start is None or len(start) < 3 else float(start[2])
    if start is not None:
        route[0] = start[:2]
    route = past_start(route)
    x, y = float(route[0, 0]), float(route[0, 1])
    named = ground.places(nodes, places - 1) if isinstance(places, int) else tuple(
        (place[0], *ground.point(node)) for place, node in zip(places, known, strict=True))
    return Tour((x, y, yaw), (*named, ("home", x, y)), route)


def _heading(route_m: np.ndarray) -> float:
    if len(route_m) < 2:
        return 0.0
    dx, dy = route_m[1] - route_m[0]
    return round(math.atan2(dy, dx), 6)


class Ground:
    """Where the robot's middle may be: cells with clearance enough that it can reach, and the ways between them."""

    def __init__(self, grid: OccupancyGrid, clearance_m: np.ndarray, need_m: float,
                 start: tuple[float, ...] | None) -> None:
        from scipy.ndimage import label

        self.grid, self.clearance_m, self.need_m = grid, clearance_m, need_m + SPARE_M
        self.open_ = grid.free()
        self.free_m2 = float(self.open_.sum()) * grid.resolution_m**2
        wide = clearance_m >= self.need_m
        if not wide.any():
            raise ConfigError(f"a robot that needs {need_m:.2f} m to each side fits nowhere in this free space; "
                              f"the widest spot has {float(np.max(clearance_m, initial=0.0)):.2f} m")
        regions, _ = label(wide, structure=np.ones((3, 3)))
        cell = self._first(regions, start)
        self.reached = regions == regions[cell]
        self.cells = np.argwhere(self.reached)
        self.reached_m2 = len(self.cells) * grid.resolution_m**2
        self.home = int(np.flatnonzero((self.cells == cell).all(axis=1))[0])
        self.points_m = grid.centres(self.cells)
        self.graph = self._graph()
        self.spots = np.zeros(0, int)  # (K,) nodes from which is looked: `viewpoints`
        self.asked: np.ndarray | None = None  # (A,) nodes whose costs are kept
        self.ways: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # from a stop: costs, and of each node the one before

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

        room_m = self.clearance_m[self.reached] - self.need_m
        self.price = 1.0 + 1.5 * np.clip(1.0 - room_m / ROOMY_M, 0.0, 1.0)  # of each node
        one, other, apart = neighbours(self.reached)
        cost = 0.5 * (self.grid.resolution_m * apart) * (self.price[one] + self.price[other])
        count = len(self.cells)
        return coo_array((np.r_[cost, cost], (np.r_[one, other], np.r_[other, one])), shape=(count, count)).tocsr()

    # --- what is seen -----------------------------------------------------------------------------------------------

    def viewpoints(self) -> list[int]:
        """Nodes from which all that can be seen is seen, each taking in as much as possible of what no other sees."""
        self.spots = self._roomiest(max(0.4, 2.0 * self.grid.resolution_m, math.sqrt(self.free_m2 / MOST_SPOTS)))
        self.sees = self._seen_from(self.spots)
        self.needed = np.asarray(self.sees.any(axis=0))
        return self._that_see(self.needed, 2)

    def _that_see(self, missing: np.ndarray, least: int, *, inside: int = 1) -> list[int]:
        """Nodes that see what is missing (squares,), each `least` of the squares or more that no other does, most first by
        the price of their ground; one that lies in what is missing counts so many times."""
        price, own = self.price[self.spots], self._square(self.cells[self.spots].T)
        missing, chosen = missing.copy(), list[int]()
        taken = (self.sees & missing).sum(axis=1)
        while True:
            gain = np.where(missing[own], inside * taken, taken)
            best = int(np.argmax(np.where(gain >= least, gain / price, 0.0)))
            if gain[best] < least:
                return chosen
            chosen.append(int(self.spots[best]))
            new = missing & self.sees[best]
            taken -= self.sees[:, new].sum(axis=1)
            missing &= ~new

    def _roomiest(self, spacing_m: float) -> np.ndarray:
        """(K,) nodes: the one with most clearance in each square of that size. Sets `self.spot_of` (nodes,)."""
        size = max(1, round(spacing_m / self.grid.resolution_m))
        square = (self.cells[:, 0] // size) * (self.grid.shape[1] // size + 1) + self.cells[:, 1] // size
        room = self.clearance_m[self.reached]
        order = np.lexsort((np.arange(len(square)), -room, square))
        _, first = np.unique(square[order], return_index=True)
        _, self.spot_of = np.unique(square, return_inverse=True)
        return order[first]

    def _sight_m(self) -> float:
        """Large buildings are looked at in larger pieces: some hundred viewpoints at most."""
        return max(SIGHT_M, math.sqrt(self.free_m2) / 8.0)

    def _seen_from(self, nodes: np.ndarray) -> np.ndarray:
        """(K, squares) bool: some ray from the node meets the square before anything that is not free."""
        everywhere, sight = np.ones(RAYS, bool), self._sight_m()
        return np.array([self._seen(cell, everywhere, sight) for cell in self.cells[nodes]])

    def _seen(self, cell: np.ndarray, rays: np.ndarray, sight_m: float) -> np.ndarray:
        """(squares,) bool: squares of 0.3 m or more that these of the RAYS meet before anything that is not free."""
        step = self.grid.resolution_m
        along = np.arange(0.0, sight_m, step) / step
        offsets = (UNITS[:, rays, None] * along).round().astype(int)  # (2, rays, steps)
        seen = np.zeros(self._squares(), bool)
        limit = np.array(self.grid.shape) - 1
        r, c = np.clip(cell[0] + offsets[0], 0, limit[0]), np.clip(cell[1] + offsets[1], 0, limit[1])
        open_ = np.logical_and.accumulate(self.open_[r, c], axis=1)
        seen[self._square(np.stack([r[open_], c[open_]]))] = True
        return seen

    def _square(self, cells: np.ndarray) -> np.ndarray:
        """Number of the square of about 0.3 m, more in a hall, in which cells (2, ...) lie."""
        size = max(1, round(0.3 / self.grid.resolution_m), math.ceil(math.sqrt(self.open_.size / (2 * MOST_SPOTS))))
        number: np.ndarray = (cells[0] // size) * (self.grid.shape[1] // size + 1) + cells[1] // size
        return number

    def _squares(self) -> int:
        return int(self._square(np.array(self.grid.shape))) + 1

    def share_seen(self, route_m: np.ndarray) -> float:
        """Share of the squares that the robot's middle can get to that a camera sees from VIEW_M or nearer along a route."""
        there = np.zeros(self._squares(), bool)
        there[self._square(self.cells.T)] = True
        return float(self.seen_ahead(route_m, VIEW_M)[there].mean())

    def seen_ahead(self, route_m: np.ndarray, sight_m: float | None = None) -> np.ndarray:
        """(squares,) bool: seen by a camera that looks ahead along the route and turns on the spot in its corners."""
        sight_m = max(VIEW_M, self._sight_m()) if sight_m is None else sight_m
        legs = np.diff(route_m, axis=0)
        headings = [math.atan2(y, x) for x, y in legs.tolist()]
        seen = np.zeros(self._squares(), bool)
        for number, (a, leg, heading) in enumerate(zip(route_m[:-1], legs, headings, strict=True)):
            before = headings[number - 1] if number else heading
            swept = _rays_between(before, (heading - before + np.pi) % (2.0 * np.pi) - np.pi)
            ahead = _rays_between(heading, 0.0)
            for share in np.arange(0.0, 1.0, 0.4 / max(float(np.hypot(*leg)), 0.01)):
                cell = self.grid.cells(a + share * leg)[0]
                seen |= self._seen(cell, swept if share == 0.0 else ahead, sight_m)
        return seen

    def missed(self, route_m: np.ndarray) -> list[int]:
        """Nodes from which what the camera missed is seen, each MISSED squares or more; none when little was missed. One
        that lies in what was missed counts twice: on the way there the camera looks at it."""
        return self._that_see(self.needed & ~self.seen_ahead(route_m), MISSED, inside=2)

    def seen_by(self, nodes: np.ndarray) -> np.ndarray:
        """(squares,) bool: seen from a way through these nodes."""
        seen: np.ndarray = self.sees[np.unique(self.spot_of[nodes])].any(axis=0)
        return seen

    # --- ways -------------------------------------------------------------------------------------------------------

    def ways_m(self, stops: np.ndarray) -> np.ndarray:
        """(S, S) cost of the best way between stops; remembers the ways."""
        from scipy.sparse.csgraph import dijkstra

        new = [stop for stop in dict.fromkeys(stops.tolist()) if stop not in self.ways]
        if self.asked is None:  # stops that come later are among the spots
            self.asked = np.union1d(self.spots, stops) if len(self.spots) else np.arange(len(self.cells))
        for some in (new[at : at + AT_ONCE] for at in range(0, len(new), AT_ONCE)):
            costs, before = dijkstra(self.graph, indices=some, return_predecessors=True)
            self.ways |= {stop: (costs[row, self.asked], before[row].copy()) for row, stop in enumerate(some)}
        columns = np.searchsorted(self.asked, stops)
        return np.array([self.ways[stop][0][columns] for stop in stops.tolist()])

    def way(self, a: int, b: int) -> list[int]:
        """Nodes from stop a to stop b, without a."""
        before, nodes = self.ways[a][1], []
        while b != a:
            nodes.append(b)
            b = int(before[b])
        return nodes[::-1]

    def tour(self, stops: Sequence[int], more: Sequence[int]) -> np.ndarray:
        """(N,) nodes of a round trip from the first stop by all of `more`, and by as many of the others as it takes to see
        everything."""
        every = np.array([*stops, *(node for node in more if node not in stops)])
        order = round_trip(self.ways_m(every))
        return self.walk(thinned(self, every[order], set(more)))

    def walk(self, stops: np.ndarray) -> np.ndarray:
        """(N,) nodes of the round trip through the stops, from the first one and back to it."""
        nodes = [int(stops[0])]
        for a, b in zip(stops, [*stops[1:], stops[0]], strict=True):
            nodes += self.way(int(a), int(b))
        return np.array(nodes)

    def straightened(self, nodes: np.ndarray) -> np.ndarray:
        """(M, 2) metres: the way with its bends pulled straight where the robot fits and it is no dearer."""
        points = self.points_m[nodes]
        price = self.price[nodes]
        lengths = np.hypot(*np.diff(points, axis=0).T)
        spent = np.r_[0.0, np.cumsum(0.5 * (price[1:] + price[:-1]) * lengths)]
        keep, waiting = {0, len(points) - 1}, [(0, len(points) - 1)]
        while waiting:
            i, j = waiting.pop()
            if j - i < 2:
                continue
            aside = aside_m(points[i : j + 1])
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

    def point(self, node: int) -> tuple[float, float]:
        """x, y of a node in metres."""
        x, y = self.points_m[node].round(4)
        return float(x), float(y)

    def standing(self, place: Place) -> int:
        """The node nearest to a place. Raises ConfigError if that is far."""
        gaps = ((self.points_m - np.array(place[1:])) ** 2).sum(axis=1).round(9)
        node = int(np.argmin(gaps))
        if gaps[node] > PLACE_M**2:
            raise ConfigError(f"place '{place[0]}' ({place[1]:g}, {place[2]:g}): the robot gets no nearer than "
                              f"{float(np.sqrt(gaps[node])):.1f} m to it")
        return node

    def farthest(self) -> int:
        """The node farthest from the start. Raises ConfigError where there is no other."""
        from scipy.sparse.csgraph import dijkstra

        node = int(np.argmax(dijkstra(self.graph, indices=self.home)))
        if node == self.home:
            raise ConfigError("the free space leaves the robot no room to move; a survey needs some way to go")
        return node

    def places(self, walked: np.ndarray, count: int) -> tuple[Place, ...]:
        """Places far from one another and from the start by the way between them, in the order in which the tour passes."""
        from scipy.sparse.csgraph import dijkstra

        gaps = dijkstra(self.graph, indices=self.home)[self.spots]
        price = self.price[self.spots]
        chosen: list[int] = []
        while len(chosen) < count and gaps.max() > 2.0 * self.need_m:
            chosen.append(int(self.spots[int(np.argmax(gaps / price))]))
            gaps = np.minimum(gaps, dijkstra(self.graph, indices=chosen[-1])[self.spots])
        passed = [int(np.argmin(np.abs(self.points_m[walked] - self.points_m[node]).sum(axis=1))) for node in chosen]
        ordered = [chosen[index] for index in np.argsort(passed, kind="stable")]
        return tuple((f"place_{number}", *self.point(node)) for number, node in enumerate(ordered, 1))


def _rays_between(heading: float, turn: float) -> np.ndarray:
    """(RAYS,) bool: within the view of a camera that turns from a heading by so much."""
    low, high = heading + min(turn, 0.0) - 0.5 * VIEW_RAD, heading + max(turn, 0.0) + 0.5 * VIEW_RAD
    between: np.ndarray = (TURNS - low) % (2.0 * np.pi) <= high - low
    return between


def thinned(ground: Ground, stops: np.ndarray, keep: set[int]) -> np.ndarray:
    """The stops without those that the way between the others sees enough for; the first one and `keep` stay."""
    kept, legs = [int(stop) for stop in stops], dict[tuple[int, int], np.ndarray]()

    def leg(a: int, b: int) -> np.ndarray:
        if (a, b) not in legs:
            legs[a, b] = ground.seen_by(np.array([a, *ground.way(a, b)])) & ground.needed
        return legs[a, b]

    times = np.zeros(ground.needed.shape, int)  # that each square is seen
    for a, b in zip(kept, [*kept[1:], kept[0]], strict=True):
        times += leg(a, b)
    enough = int((times > 0).sum())
    for number in range(len(kept) - 1, 0, -1):
        stop = kept[number]
        if stop in keep:
            continue
        a, b = kept[number - 1], kept[(number + 1) % len(kept)]
        fewer = times - leg(a, stop) - leg(stop, b) + leg(a, b)
        if int((fewer > 0).sum()) >= enough - 1:
            times = fewer
            del kept[number]
    return np.array(kept)
