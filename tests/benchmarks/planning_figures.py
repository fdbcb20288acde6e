"""The planning table with many seeds, in one process and without pictures: maps 1 to 4, every planner.

    python tests/benchmarks/planning_figures.py [--seeds 30] [--out FOLDER] [--pictures FOLDER]

planning_goals.txt says which of the goals are reached. The same columns as `python -m rhs -m experiment=table_3_1`, which
keeps a folder per run; the planners and seeds give the same paths there. Times are CPU milliseconds.
"""

from __future__ import annotations

import argparse
import os
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

os.environ.setdefault("OMP_NUM_THREADS", "1")

from rhs.api.randomness import generator
from rhs.config import registry
from rhs.estimation.paths.shorten import shortened
from rhs.metrics.path_judge import Optimum
from rhs.metrics.planning import path_values
from rhs.reports.export import as_markdown
from rhs.reports.planning_table import draw_bars, order, planning_table
from rhs.reports.table import frame
from rhs.worlds.plan_files import question_of
from rhs.worlds.planning_question import load_arena
from rhs_tasks.planning.asking import ask_twice, times
from rhs_tasks.planning.task import context_of, warm_up

if TYPE_CHECKING:
    import pandas

MAPS = ("map1", "map2", "map3", "map4")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    parser.add_argument("--pictures", type=Path, default=Path("results/pictures"))
    chosen = parser.parse_args()
    names = [name for name in registry.names("planner")
             if registry.origins("planner", name)[0].distribution.startswith("rhs ")]
    rows = {}
    for world in MAPS:
        for name in order(names):
            for seed in range(chosen.seeds):
                rows[f"{world} {name} {seed}"] = one(world, name, seed)
            print(world, name, flush=True)
    runs = frame(rows)
    table = planning_table(runs)
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "planning_figures.md").write_text(as_markdown(table))
    table.to_csv(chosen.out / "planning_figures.csv", index=False)
    (chosen.out / "planning_goals.txt").write_text("\n".join(goals(runs)) + "\n")
    chosen.pictures.mkdir(parents=True, exist_ok=True)
    for picture in draw_bars(runs, chosen.pictures):
        picture.rename(picture.with_name(f"planning_{picture.name}"))
    print(as_markdown(table), *goals(runs), sep="\n")


def one(world: str, name: str, seed: int) -> dict:
    """The row of one run, as the planning task makes it."""
    arena = load_arena(world)
    problem, settings = question_of(arena).problem(), registry.load("planner", name)()
    if seed == 0:
        warm_up(settings.build(context_of(arena, Path(), generator(0, "warm-up"))))
    first, again = ask_twice(lambda rng: settings.build(context_of(arena, Path(), rng)), problem,
                             partial(generator, seed, "planner"))
    values = path_values(shortened(first.path, problem), problem, optimum=optimum_of(world), classes=arena.classes)
    return {"status": "ok", "task": "planning", "world": world, "planner": name, "seed": seed, **values,
            "map_resolution_m": problem.resolution_m, **times(first, again)}


@cache
def optimum_of(world: str) -> Optimum:
    problem = question_of(load_arena(world)).problem()
    return Optimum(problem.blocked, problem.resolution_m, problem.origin_m)


def goals(table: pandas.DataFrame) -> list[str]:
    """What was to be reached, and what was: one line each, from the rows of all runs."""
    found = table[table["plan_success"] == 1]
    by = found.groupby(["world", "planner"])
    median, above = by["plan_ms"].median(), by["plan_above_optimum_pct"].max()
    quick = [(world, name) for (world, name), value in above.items() if value <= 1.0 and median[world, name] <= 20.0]
    good = {world: [f"{name} {median[world, name]:.2g} ms" for at, name in quick if at == world] for world in MAPS}
    query = found[found["planner"] == "prm"].groupby("world")["plan_again_ms"]
    walk = found[found["planner"] == "potential_field"].groupby("world")["plan_walk_steps"].max()
    connect = {world: f"{median[world, 'rrt_connect']:.2g}" for world in MAPS}
    return [f"runs: {len(table)}, failed: {int((table['plan_success'] != 1).sum())}, "
            f"found but not valid: {int((found['plan_valid'] != 1.0).sum())}",
            f"rrt_connect, median CPU ms per map (at most 2.5, 0.8, 0.8, 0.8): {connect}",
            f"prm, question after learning, median and worst CPU ms (at most 2): {query.median().max():.2g}, "
            f"{query.max().max():.2g}",
            f"planners whose every path is within 1 % of the optimum, median at most 20 ms: {good}",
            f"potential_field, steps (at most 2000): {walk.astype(int).to_dict()}"]


if __name__ == "__main__":
    main()
