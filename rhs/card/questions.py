"""Planning questions made by chance, small, with every trap that planners fall into; the same for everybody.

Cells are 5 to 20 cm, the corner of the map is not the origin, start and goal are not in the middle of a cell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rhs.api.records import PlanningProblem
from rhs.metrics.path_judge import Optimum

OF_EACH = 10
SEED = 0


@dataclass(frozen=True, eq=False)
class Question:
    """A problem and the length of its exact shortest path, NaN where there is no way."""

    name: str
    problem: PlanningProblem
    optimal_m: float


def questions(of_each: int = OF_EACH, seed: int = SEED) -> Iterator[Question]:
    """`of_each` questions of every kind."""
    for number, (kind, draw) in enumerate(KINDS.items()):
        for k in range(of_each):
            rng = np.random.default_rng([seed, number, k])
            yield question(f"{kind} {k}", draw(rng), rng, across=ACROSS.get(kind))


def question(name: str, blocked: np.ndarray, rng: np.random.Generator, *, across: int | None = None) -> Question:
    """A question in this map: of eight pairs of free places the farthest; across: from the first cells along this axis to
    the last ones."""
    cells = np.argwhere(~blocked)
    starts = goals = cells
    if across is not None:
        starts, goals = (cells[near] for near in (cells[:, across] < 4, cells[:, across] > blocked.shape[across] - 5))
    pairs = np.stack([some[rng.integers(len(some), size=8)] for some in (starts, goals)], axis=1)
    start, goal = pairs[np.argmax(np.linalg.norm(pairs[:, 0] - pairs[:, 1], axis=1))]
    resolution_m = float(rng.choice([0.05, 0.1, 0.2]))
    origin_m = tuple(float(value) for value in rng.uniform(-5.0, 5.0, 2).round(2))
    ends = [(cell[::-1] + rng.uniform(0.15, 0.85, 2)) * resolution_m + origin_m for cell in (start, goal)]
    problem = PlanningProblem(blocked, resolution_m, (origin_m[0], origin_m[1]), ends[0], ends[1])
    return Question(name, problem, Optimum(blocked, resolution_m, origin_m).length_m(ends))


def _size(rng: np.random.Generator) -> tuple[int, int]:
    return int(rng.integers(24, 41)), int(rng.integers(28, 49))


def scattered(rng: np.random.Generator) -> np.ndarray:
    """Single cells, many of which meet corner to corner."""
    return rng.random(_size(rng)) < rng.uniform(0.15, 0.3)


def boxes(rng: np.random.Generator) -> np.ndarray:
    """Boxes that may overlap."""
    blocked = np.zeros(_size(rng), bool)
    for _ in range(int(rng.integers(6, 14))):
        row, column = rng.integers(0, blocked.shape)
        height, width = rng.integers(2, 9, 2)
        blocked[row: row + height, column: column + width] = True
    return blocked


def rooms(rng: np.random.Generator) -> np.ndarray:
    """Walls one cell thick, each with a door of two or three cells."""
    rows, columns = _size(rng)
    blocked = np.zeros((rows, columns), bool)
    for column in range(9, columns - 5, 10):
        door = int(rng.integers(1, rows - 4))
        blocked[:, column] = True
        blocked[door: door + int(rng.integers(2, 4)), column] = False
    for row in range(8, rows - 5, 11):
        for left in range(0, columns, 10):
            door = left + int(rng.integers(0, 7))
            wall = blocked[row, left: left + 10].copy()
            blocked[row, left: left + 10] = True
            blocked[row, door: door + 2] = False
            blocked[row, left: left + 10] |= wall & (np.arange(left, left + len(wall)) % 10 == 9)
    return blocked


def maze(rng: np.random.Generator) -> np.ndarray:
    """Lanes three cells wide between walls of one, without a loop."""
    n, m = int(rng.integers(5, 8)), int(rng.integers(6, 10))
    blocked = np.ones((4 * n + 1, 4 * m + 1), bool)
    seen, way = {(0, 0)}, [(0, 0)]
    while way:
        i, j = way[-1]
        blocked[4 * i + 1: 4 * i + 4, 4 * j + 1: 4 * j + 4] = False
        near = [(a, b) for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
                if 0 <= a < n and 0 <= b < m and (a, b) not in seen]
        if not near:
            way.pop()
            continue
        a, b = near[int(rng.integers(len(near)))]
        seen.add((a, b))
        row, column = 4 * min(i, a) + 1, 4 * min(j, b) + 1
        blocked[row: row + (7 if a != i else 3), column: column + (7 if b != j else 3)] = False
        way.append((a, b))
    return blocked


def border(rng: np.random.Generator) -> np.ndarray:
    """Free to the last row and column, where the way is; full in the middle. Some of the border is blocked."""
    blocked = np.zeros(_size(rng), bool)
    depth = int(rng.integers(1, 3))
    blocked[depth:-depth, depth:-depth] = True
    side = int(rng.integers(4))
    turned = np.rot90(blocked, side)
    turned[:depth, turned.shape[1] // 2] = True
    return blocked


def diagonals(rng: np.random.Generator) -> np.ndarray:
    """A wall of cells that meet at their corners only, from side to side; often with one gap."""
    rows, columns = _size(rng)
    blocked = np.zeros((rows, columns), bool)
    row = int(rng.integers(6, rows - 6))
    for column in range(columns):
        blocked[row, column] = True
        row += 1 if row < 4 else -1 if row > rows - 5 else int(rng.choice([-1, 1]))
    if rng.random() < 0.5:
        gap = int(rng.integers(2, columns - 4))
        blocked[:, gap: gap + 2] = False
    return blocked


def closed(rng: np.random.Generator) -> np.ndarray:
    """A wall right across; in every second one a door."""
    blocked = boxes(rng)
    rows, columns = blocked.shape
    at = int(rng.integers(8, columns - 8))
    blocked[:, at] = True
    blocked[:, [at - 1, at + 1]] = False
    if rng.random() < 0.5:
        door = int(rng.integers(0, rows - 1))
        blocked[door: door + 2, at] = False
    return blocked


KINDS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "scattered": scattered, "boxes": boxes, "rooms": rooms, "maze": maze, "border": border, "diagonals": diagonals,
    "closed": closed}
ACROSS = {"diagonals": 0, "border": 1, "closed": 1}
