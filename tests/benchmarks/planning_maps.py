"""Maps made by chance, and who solves them: rooms with doors, mazes, offices, warehouses, caves; beside maps on disk.

    python tests/benchmarks/planning_maps.py [--seeds 4] [--planners rrt,fmt] [--maps FOLDER] [--out FILE]

Every map is 30 m x 30 m in cells of 5 cm, every question goes between two places far apart in the free space of a robot of
0.2 m. Seeds are below 10,000. --maps: also the map_server files of a folder. One line per planner: found, time, length.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from scipy.ndimage import binary_dilation, label, uniform_filter

from rhs.api.grid import configuration_space
from rhs.api.records import PlanningProblem
from rhs.config import registry
from rhs.estimation.paths.shorten import shortened
from rhs.metrics.path_judge import Optimum
from rhs.metrics.planning import path_values
from rhs.worlds.maps import load_map
from rhs_tasks.planning.asking import ask

SIDE = 600  # cells
STEP_M = 0.05
RADIUS_M = 0.2
PLANNERS = ("rrt_connect", "rrt", "rrt_star", "informed_rrt_star", "bit_star", "fmt", "prm", "prm_star", "potential_field",
            "astar", "theta_star", "fast_marching")


def frame() -> np.ndarray:
    """(H, W) bool, walls all round."""
    wall = np.ones((SIDE, SIDE), bool)
    wall[4:-4, 4:-4] = False
    return wall


def rooms(rng: np.random.Generator) -> np.ndarray:
    """A rectangle is cut in two, again and again, by walls with one door of 0.8 to 1.2 m each."""
    wall, parts = frame(), [(4, 4, SIDE - 4, SIDE - 4)]
    while parts:
        x0, y0, x1, y1 = parts.pop()
        long = max(x1 - x0, y1 - y0)
        if long < 120 or (long < 220 and rng.random() < 0.4):
            continue
        door = int(rng.integers(16, 25))
        if x1 - x0 >= y1 - y0:
            at, gap = int(rng.integers(x0 + 50, x1 - 50)), int(rng.integers(y0 + 3, max(y1 - door - 3, y0 + 4)))
            wall[y0:y1, at: at + 3] = True
            wall[gap: gap + door, at: at + 3] = False
            parts += [(x0, y0, at, y1), (at + 3, y0, x1, y1)]
        else:
            at, gap = int(rng.integers(y0 + 50, y1 - 50)), int(rng.integers(x0 + 3, max(x1 - door - 3, x0 + 4)))
            wall[at: at + 3, x0:x1] = True
            wall[at: at + 3, gap: gap + door] = False
            parts += [(x0, y0, x1, at), (x0, at + 3, x1, y1)]
    return wall


def maze(rng: np.random.Generator) -> np.ndarray:
    """Corridors of 1.0 to 1.5 m without a loop, by a walk that turns back where it is stuck."""
    lane = int(rng.integers(23, 34))
    n = (SIDE - 8) // lane
    wall = np.ones((SIDE, SIDE), bool)
    seen, way = np.zeros((n, n), bool), [(0, 0)]
    seen[0, 0] = True
    while way:
        i, j = way[-1]
        wall[4 + j * lane: 4 + (j + 1) * lane - 3, 4 + i * lane: 4 + (i + 1) * lane - 3] = False
        open_ = [(a, b) for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
                 if 0 <= a < n and 0 <= b < n and not seen[b, a]]
        if not open_:
            way.pop()
            continue
        a, b = open_[int(rng.integers(len(open_)))]
        seen[b, a] = True
        low_x, low_y = 4 + min(i, a) * lane, 4 + min(j, b) * lane
        wall[low_y: low_y + (abs(b - j) + 1) * lane - 3, low_x: low_x + (abs(a - i) + 1) * lane - 3] = False
        way.append((a, b))
    return wall


def office(rng: np.random.Generator) -> np.ndarray:
    """Rooms, furniture, and pieces of wall that stand anywhere."""
    wall = rooms(rng)
    for _ in range(40):
        x, y = rng.integers(20, SIDE - 60, 2)
        long, wide = int(rng.integers(15, 40)), int(rng.integers(3, 14))
        w, h = (long, wide) if rng.random() < 0.5 else (wide, long)
        wall[y: y + h, x: x + w] = True
    return wall


def warehouse(rng: np.random.Generator) -> np.ndarray:
    """Rows of shelves with aisles of 1.0 to 1.6 m and a few cross aisles."""
    wall = frame()
    aisle, depth = int(rng.integers(20, 33)), int(rng.integers(16, 30))
    for y in range(30, SIDE - 60, aisle + depth):
        wall[y: y + depth, 40: SIDE - 40] = True
        for _ in range(int(rng.integers(1, 4))):
            x = int(rng.integers(60, SIDE - 90))
            wall[y: y + depth, x: x + int(rng.integers(16, 30))] = False
    return wall


def cave(rng: np.random.Generator) -> np.ndarray:
    """Galleries with ragged walls: noise, smoothed and cut (as mines look in a laser map)."""
    field = rng.normal(size=(SIDE, SIDE))
    for wide in (61, 41, 9):
        field = uniform_filter(field, wide, mode="wrap")
    free = np.abs(field) < 0.45 * field.std()  # round the lines where the noise is 0
    return frame() | ~free | (binary_dilation(~free, iterations=2) & (rng.random(free.shape) < 0.35))


def scanned(rng: np.random.Generator) -> np.ndarray:
    """An office as a laser sees it: walls ragged by single cells, most rooms never entered."""
    wall = office(rng)
    beside = binary_dilation(wall, iterations=2) & ~wall
    wall |= beside & (rng.random(wall.shape) < 0.35)
    return wall | (rng.random(wall.shape) < 2e-5)


KINDS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "rooms": rooms, "maze": maze, "office": office, "warehouse": warehouse, "cave": cave, "scanned": scanned}


def question(obstacle: np.ndarray, step_m: float, rng: np.random.Generator, radius_m: float = RADIUS_M,
             origin_m: tuple[float, float] = (0.0, 0.0)) -> PlanningProblem:
    """Two free cells of the largest piece of free space, the farthest pair of twenty that were drawn."""
    blocked = configuration_space(obstacle, radius_m / step_m)
    pieces, _ = label(~blocked)
    cells = np.argwhere(pieces == np.bincount(pieces[pieces > 0]).argmax())
    some = cells[rng.integers(len(cells), size=20)]
    apart = np.linalg.norm(some[:, None] - some[None], axis=2)
    a, b = np.unravel_index(apart.argmax(), apart.shape)
    ends = [(some[k][::-1] + 0.5) * step_m + np.asarray(origin_m) for k in (a, b)]
    for array in (blocked, *ends):
        array.setflags(write=False)
    return PlanningProblem(blocked, step_m, origin_m, ends[0], ends[1])


def problems(seeds: range, folder: Path | None = None) -> Iterator[tuple[str, PlanningProblem]]:
    """Every kind of map with every seed, then the maps of a folder."""
    for kind, draw in KINDS.items():
        for seed in seeds:
            rng = np.random.default_rng([seed, len(kind)])
            yield f"{kind} {seed}", question(draw(rng), STEP_M, rng)
    for path in sorted(folder.glob("*.yaml")) if folder else ():
        grid = load_map(path)
        yield path.stem, question(~grid.free(), grid.resolution_m, np.random.default_rng(1), origin_m=grid.origin_m)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--planners", default=",".join(PLANNERS))
    parser.add_argument("--maps", type=Path)
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=NUMBER", help="settings of every planner named")
    chosen = parser.parse_args()
    values = {key: float(text) if "." in text else int(text) for key, text in (word.split("=") for word in chosen.set)}
    told: dict[str, list] = {}
    for name, problem in problems(range(chosen.first, chosen.first + chosen.seeds), chosen.maps):
        optimum = Optimum(problem.blocked, problem.resolution_m, problem.origin_m)
        for word in chosen.planners.split(","):
            planner = registry.load("planner", word)(**values).build(SimpleNamespace(rng=np.random.default_rng(1)))
            answer = ask(planner, problem, word)
            row = path_values(shortened(answer.path, problem), problem, optimum=optimum)
            told.setdefault(word, []).append((name, row, answer.cpu_ms))
    for word, rows in told.items():
        solved = [(ms, row["plan_length_m"] / row["plan_optimal_m"]) for _, row, ms in rows if row["plan_success"]]
        ms, ratio = np.array(solved).T if solved else (np.array([np.nan]),) * 2
        print(f"{word:18} {len(solved):3} of {len(rows)}  ms median {np.median(ms):8.1f} worst {ms.max():9.1f}  "
              f"length/optimum median {np.median(ratio):.3f} worst {ratio.max():.2f}  "
              f"not: {', '.join(f'{name} ({t:.0f} ms)' for name, row, t in rows if not row['plan_success'])}", flush=True)


if __name__ == "__main__":
    main()
