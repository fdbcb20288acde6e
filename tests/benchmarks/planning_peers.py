"""Our planners beside those of other Python packages, on the same maps, in one process, judged by rhs.judge.

    pip install -e '.[benchmark]'
    python tests/benchmarks/planning_peers.py [--seeds 10] [--out results/tables]

Times are CPU milliseconds from the question to the path, without the set-up of the map for anybody (distance fields,
spaces), with the learning of a roadmap for everybody. `raw` is ours without shortening the path afterwards, which theirs
do not do. A path is valid if rhs.judge finds it free and its ends are within half a cell. The ratios at the end are
theirs over ours (raw) per map, then their geometric mean: against their default settings, and against the fastest of
theirs with steps as long as ours.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from rhs import registry
from rhs.arena import load_arena
from rhs.judge import Optimum, path_valid, polyline_length
from rhs.planning_task import problem_of
from rhs.records import PlanningProblem

Plan = Callable[[int], np.ndarray | None]  # seed -> path (N, 2) in metres, or None
MAPS = ("map1", "map2", "map3", "map4")
OURS = {"rhs rrt_connect": ("rrt_connect", {}), "rhs rrt_connect native": ("rrt_connect", {"backend": "native"}),
        "rhs rrt_connect raw": ("rrt_connect", {"shorten_rounds": 0}),
        "rhs rrt_connect native raw": ("rrt_connect", {"backend": "native", "shorten_rounds": 0}),
        "rhs rrt": ("rrt", {}), "rhs prm": ("prm", {}), "rhs astar": ("astar", {}), "rhs theta_star": ("theta_star", {}),
        "rhs fast_marching": ("fast_marching", {}), "rhs potential_field": ("potential_field", {})}
SLOW = {"rtb PRM 300 points": 1, "pmp A*": 2, "pmp Theta*": 2}  # fewer seeds, or the benchmark takes an hour


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = [row for name in MAPS for row in one_map(name, chosen.seeds)]
    chosen.out.mkdir(parents=True, exist_ok=True)
    with (chosen.out / "planning_peers.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    print((chosen.out / "planning_peers.csv").read_text())
    print("\n".join(ratios(rows)))


def one_map(name: str, seeds: int) -> list[dict]:
    """One row per planner on one map."""
    problem = problem_of(load_arena(name))
    optimum = Optimum(problem.blocked, problem.resolution_m, problem.origin_m).length_m([problem.start_m, problem.goal_m])
    planners = {**{word: ours(problem, *what) for word, what in OURS.items()}, **motion_planning(problem),
                **robotics_toolbox(problem), **scikit_image(problem)}
    return [measure(name, word, plan, problem, (optimum, min(seeds, SLOW.get(word, seeds))))
            for word, plan in planners.items()]


def measure(name: str, word: str, plan: Plan, problem: PlanningProblem, task: tuple[float, int]) -> dict:
    optimum, seeds = task
    plan(10_000)  # compile, load
    times, lengths, valid, found = [], [], 0, 0
    for seed in range(seeds):
        begin = time.process_time()
        path = plan(seed)
        times.append(1e3 * (time.process_time() - begin))
        if path is None:
            continue
        found += 1
        near = max(np.abs(path[0] - problem.start_m).max(), np.abs(path[-1] - problem.goal_m).max())
        if near <= 0.5 * problem.resolution_m + 1e-9 and path_valid(path, problem.blocked, problem.resolution_m,
                                                                    problem.origin_m):
            valid += 1
            lengths.append(100.0 * (polyline_length(path) / optimum - 1.0))
    return {"map": name, "planner": word, "n": seeds, "found": found, "valid": valid,
            "median_ms": f"{np.median(times):.3g}", "max_ms": f"{max(times):.3g}",
            "above_optimum_pct": f"{np.median(lengths):.3g}" if lengths else ""}


def ours(problem: PlanningProblem, name: str, values: dict) -> Plan:
    settings = registry.load("planner", name)(**values)

    def plan(seed: int) -> np.ndarray | None:
        path = planners[seed].plan(problem)
        return path.points_m if path.found else None

    planners = {seed: settings.build(SimpleNamespace(rng=np.random.default_rng(seed))) for seed in [*range(100), 10_000]}
    if name != "prm":  # its set-up cannot be told from learning, which counts
        for planner in planners.values():
            planner.plan(aside(problem))
    return plan


def aside(problem: PlanningProblem) -> PlanningProblem:
    """Another question on the same map: from the start to the start."""
    return replace(problem, goal_m=problem.start_m)


def motion_planning(problem: PlanningProblem) -> dict[str, Plan]:
    """python-motion-planning: grid indexed [x, y], map coordinates are cell numbers, strict collision by default."""
    import python_motion_planning as pmp

    rows, columns = problem.blocked.shape
    grid = pmp.Grid(bounds=[[0, columns], [0, rows]], resolution=1.0)
    grid.type_map[problem.blocked.T] = pmp.TYPES.OBSTACLE
    centre = np.asarray(problem.origin_m) + 0.5 * problem.resolution_m
    start, goal = (tuple(int(v) for v in np.rint((p - centre) / problem.resolution_m))
                   for p in (problem.start_m, problem.goal_m))

    def of(cls, **values) -> Plan:
        planner = cls(map_=grid, start=start, goal=goal, **values)

        def plan(seed: int) -> np.ndarray | None:
            random.seed(seed)
            np.random.seed(seed)  # noqa: NPY002 (their generator)
            path, told = planner.plan()
            return np.array(path, float) * problem.resolution_m + centre if told["success"] else None

        return plan

    return {"pmp RRT-Connect": of(pmp.RRTConnect), "pmp RRT-Connect step 28": of(pmp.RRTConnect, max_dist=28.0),
            "pmp RRT": of(pmp.RRT), "pmp A*": of(pmp.AStar), "pmp Theta*": of(pmp.ThetaStar)}


def robotics_toolbox(problem: PlanningProblem) -> dict[str, Plan]:
    """Robotics Toolbox: PRM with its default 100 points and with 300; grid in cells, plan() learns, query() asks."""
    import roboticstoolbox as rtb

    centre = np.asarray(problem.origin_m) + 0.5 * problem.resolution_m
    start, goal = ((p - centre) / problem.resolution_m for p in (problem.start_m, problem.goal_m))

    def of(points: int) -> Plan:
        def plan(seed: int) -> np.ndarray | None:
            planner = rtb.PRMPlanner(problem.blocked.astype(int), npoints=points, seed=seed, verbose=False, progress=False)
            planner.plan()
            try:
                path = planner.query(start, goal)
            except Exception:  # NoPathError, and what its A* raises when the roadmap is in pieces
                return None
            return np.asarray(path) * problem.resolution_m + centre

        return plan

    return {"rtb PRM 100 points": of(100), "rtb PRM 300 points": of(300)}


def scikit_image(problem: PlanningProblem) -> dict[str, Plan]:
    """scikit-image: minimum-cost path through the array, diagonal steps weighted by their length."""
    from skimage.graph import MCP_Geometric

    costs = np.where(problem.blocked, -1.0, 1.0)
    centre = np.asarray(problem.origin_m) + 0.5 * problem.resolution_m
    ends = [tuple(int(v) for v in np.rint((p - centre) / problem.resolution_m)[::-1])
            for p in (problem.start_m, problem.goal_m)]

    def plan(seed: int) -> np.ndarray | None:
        search = MCP_Geometric(costs)
        search.find_costs([ends[0]], [ends[1]])
        return np.array(search.traceback(ends[1]))[:, ::-1] * problem.resolution_m + centre

    return {"skimage MCP_Geometric": plan}


def ratios(rows: list[dict]) -> list[str]:
    """How many times faster, geometric mean over the maps, against the fastest of theirs per map."""
    def median(name: str, word: str) -> float:
        return next(float(r["median_ms"]) for r in rows if r["map"] == name and r["planner"] == word)

    lines = []
    default, tuned = ("pmp RRT-Connect",), ("pmp RRT-Connect", "pmp RRT-Connect step 28")
    for label, mine, theirs in (
        ("rrt_connect (OMPL)", "rhs rrt_connect raw", default), ("rrt_connect (OMPL)", "rhs rrt_connect raw", tuned),
        ("rrt_connect native", "rhs rrt_connect native raw", default),
        ("rrt_connect native", "rhs rrt_connect native raw", tuned),
        ("prm", "rhs prm", ("rtb PRM 100 points",)), ("prm", "rhs prm", ("rtb PRM 300 points",)),
    ):
        each = [min(median(name, t) for t in theirs) / median(name, mine) for name in MAPS]
        told = ", ".join(f"{name} {value:.0f}" for name, value in zip(MAPS, each, strict=True))
        lines.append(f"{label}: {np.exp(np.mean(np.log(each))):.1f} times faster than {' or '.join(theirs)} ({told})")
    return lines


if __name__ == "__main__":
    main()
