"""Cost against map size: map 1 drawn with 1, 2, 10 and 40 times finer cells, every planner, one picture.

    python tests/benchmarks/planning_scale.py [--sizes 100,200,1000,4000] [--seeds 5] [--out FOLDER] [--picture FILE]

The geometry stays the same, only the cells get finer; settings are the planners' own. Times are CPU milliseconds:
`first` is the first question to a planner (set-up of the map and, for roadmaps, learning included), `plan` the median of
the questions after it. Planners without chance answer once.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from pathlib import Path
from types import SimpleNamespace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from rhs.api.records import PlanningProblem
from rhs.config import registry
from rhs.estimation.paths.shorten import shortened
from rhs.metrics.path_judge import Optimum, path_valid, polyline_length
from rhs.plots.figure import new_figure, save
from rhs.worlds.plan_files import question_of
from rhs.worlds.planning_question import load_arena

LONG_MS = 10_000.0  # a first question that took longer (theta_star, which keeps nothing) stands for the later ones too
CERTAIN = ("astar", "theta_star", "fast_marching", "potential_field")  # the same path every time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default="100,200,1000,4000")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    parser.add_argument("--picture", type=Path, default=Path("results/pictures/planning_scale.png"))
    chosen = parser.parse_args()
    rows = []
    for size in map(int, chosen.sizes.split(",")):
        rows += one_size(size, chosen.seeds)
    chosen.out.mkdir(parents=True, exist_ok=True)
    with (chosen.out / "planning_scale.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    chosen.picture.parent.mkdir(parents=True, exist_ok=True)
    save(picture(rows), chosen.picture)
    print((chosen.out / "planning_scale.csv").read_text())


def scaled(size: int) -> PlanningProblem:
    """Map 1 with `size` cells a side, one decimetre cut into size / 100 cells."""
    coarse = question_of(load_arena("map1")).problem()
    times = size // 100
    blocked = np.repeat(np.repeat(coarse.blocked, times, axis=0), times, axis=1)
    blocked.setflags(write=False)
    return PlanningProblem(blocked, coarse.resolution_m / times, coarse.origin_m, coarse.start_m, coarse.goal_m)


def one_size(size: int, seeds: int) -> list[dict]:
    problem = scaled(size)
    optimum = Optimum(problem.blocked, problem.resolution_m, problem.origin_m).length_m([problem.start_m, problem.goal_m])
    variants = [(name, name, {}) for name in registry.names("planner") if registry.origins("planner", name)[0].distribution
                .startswith("rhs ")]
    variants += [(f"{name}, OMPL", name, {"backend": "ompl"}) for name in ("rrt_connect", "prm", "prm_star")]
    rows = []
    for word, name, values in variants:
        rows.append(measure(word, registry.load("planner", name)(**values), problem, (optimum, seeds)))
        print(size, rows[-1], flush=True)
    return rows


def measure(word: str, settings, problem: PlanningProblem, task: tuple[float, int]) -> dict:
    optimum, seeds = task
    first, later, above, found = [], [], [], 0
    small = question_of(load_arena("map3")).problem()
    for seed in range(1 if word in CERTAIN else seeds):
        planner = settings.build(SimpleNamespace(rng=np.random.default_rng(seed)))
        planner.plan(small)  # libraries are loaded
        begin = time.process_time()
        path = shortened(planner.plan(problem), problem)
        middle = time.process_time()
        first.append(1e3 * (middle - begin))
        again = path if first[-1] > LONG_MS else shortened(planner.plan(problem), problem)
        later.append(first[-1] if again is path else 1e3 * (time.process_time() - middle))
        if path.found and path_valid(again.points_m, problem.blocked, problem.resolution_m, problem.origin_m):
            found += 1
            above.append(100.0 * (polyline_length(path.points_m) / optimum - 1.0))
    return {"cells_a_side": len(problem.blocked), "planner": word, "n": len(first), "found_valid": found,
            "first_ms": f"{np.median(first):.3g}", "plan_ms": f"{np.median(later):.3g}", "max_ms": f"{max(later):.3g}",
            "above_optimum_pct": f"{np.median(above):.3g}" if above else "", "reason": str(path.reason)}


def picture(rows: list[dict]):
    """Time of the first and of a later question against cells a side, one line per planner; hollow where no path was
    found."""
    figure = new_figure(11.0, 5.2)
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, key, title in ((left, "first_ms", "first question: set-up and learning included"),
                             (right, "plan_ms", "later questions")):
        for k, word in enumerate(dict.fromkeys(row["planner"] for row in rows)):
            _line(axes, word, [row for row in rows if row["planner"] == word], (key, k))
        axes.set(xscale="log", yscale="log", xlabel="cells a side")
        axes.set_title(title, fontsize=10)
        sizes = sorted({row["cells_a_side"] for row in rows})
        axes.set_xticks(sizes, labels=list(map(str, sizes)))
        axes.minorticks_off()
        axes.grid(color="#dddddd")
    left.set_ylabel("median CPU time [ms]")
    left.yaxis.set_major_formatter("{x:g}")
    right.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8, frameon=False)
    return figure


def _line(axes, word: str, mine: list[dict], how: tuple[str, int]) -> None:
    key, k = how
    colour, style = f"C{k % 10}", "-" if k < 10 else "--"
    x, y = [row["cells_a_side"] for row in mine], [float(row[key]) for row in mine]
    axes.plot(x, y, style, color=colour, label=word, zorder=2)
    for row, a, b in zip(mine, x, y, strict=True):
        fill = colour if row["found_valid"] == row["n"] else "white"
        axes.plot(a, b, "o", color=colour, markersize=5, markerfacecolor=fill, zorder=3)


if __name__ == "__main__":
    main()
