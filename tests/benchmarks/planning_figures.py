"""The planning table with many seeds, in one process and without pictures: maps 1 to 4, every planner.

    python tests/benchmarks/planning_figures.py [--seeds 30] [--out results/tables]

The same columns as `python -m rhs -m experiment=table_3_1`, which keeps a folder per run; the planners and seeds give the
same paths there. Times are CPU milliseconds.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from rhs import registry
from rhs.arena import load_arena
from rhs.judge import Optimum
from rhs.parts import generator
from rhs.planning_metrics import path_values
from rhs.planning_table import as_markdown, order, planning_table
from rhs.planning_task import context_of, problem_of, warm_up
from rhs.table import frame

MAPS = ("map1", "map2", "map3", "map4")
CERTAIN = ("astar", "theta_star", "fast_marching", "potential_field")  # the same path every time: three runs, for the times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    names = [name for name in registry.names("planner")
             if registry.origins("planner", name)[0].distribution.startswith("rhs ")]
    rows = {}
    for world in MAPS:
        for name in order(names):
            for seed in range(min(chosen.seeds, 3) if name in CERTAIN else chosen.seeds):
                rows[f"{world} {name} {seed}"] = one(world, name, seed)
            print(world, name, flush=True)
    table = planning_table(frame(rows))
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "planning_figures.md").write_text(as_markdown(table))
    table.to_csv(chosen.out / "planning_figures.csv", index=False)
    print(as_markdown(table))


def one(world: str, name: str, seed: int) -> dict:
    """The row of one run, as the planning task makes it."""
    arena = load_arena(world)
    problem, settings = problem_of(arena), registry.load("planner", name)()
    if seed == 0:
        warm_up(settings, arena, Path())
    planner = settings.build(context_of(arena, Path(), generator(seed, "planner")))
    path, again = planner.plan(problem), planner.plan(problem)
    optimum = Optimum(problem.blocked, problem.resolution_m, problem.origin_m)
    values = path_values(path, problem, optimum=optimum, classes=arena.classes)
    return {"status": "ok", "task": "planning", "world": world, "planner": name, "seed": seed, **values,
            "map_resolution_m": problem.resolution_m, "plan_learn_ms": path.learn_ms, "plan_ms": path.plan_ms,
            "plan_again_ms": again.plan_ms}


if __name__ == "__main__":
    main()
