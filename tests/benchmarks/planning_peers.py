"""Our planners beside those of other Python packages, on the same maps, in one process, judged by rhs.judge.

    pip install -e '.[benchmark]'
    python tests/benchmarks/planning_peers.py [--seeds 10] [--out results/tables]

Times are CPU milliseconds from the question to the path, without the set-up of the map for anybody (distance fields,
spaces), with the learning of a roadmap for everybody. `raw` is ours without shortening the path afterwards, which theirs
do not do: that is the same work, and the comparison to look at. A path is valid if rhs.judge finds it free and its ends
are within half a cell. planning_peers_ratios.txt says how many times faster ours are, per map and as geometric mean.
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

from rhs.api.records import PlanningProblem
from rhs.config import registry
from rhs.estimation.paths.shorten import shortened
from rhs.metrics.path_judge import Optimum, path_valid, polyline_length
from rhs.worlds.plan_files import question_of
from rhs.worlds.planning_question import load_arena

Plan = Callable[[int], np.ndarray | None]  # seed -> path (N, 2) in metres, or None
MAPS = ("map1", "map2", "map3", "map4")
OURS = {"rhs rrt_connect": ("rrt_connect", {}), "rhs rrt_connect raw": ("rrt_connect", {}),
        "rhs rrt_connect raw step 200": ("rrt_connect", {"range_m": 20.0}),
        "rhs rrt_connect OMPL": ("rrt_connect", {"backend": "ompl"}),
        "rhs rrt_connect OMPL raw": ("rrt_connect", {"backend": "ompl"}),
        "rhs rrt": ("rrt", {}), "rhs prm": ("prm", {}), "rhs prm raw": ("prm", {}),
        "rhs prm OMPL raw": ("prm", {"backend": "ompl"}), "rhs astar": ("astar", {}),
        "rhs theta_star": ("theta_star", {}), "rhs fast_marching": ("fast_marching", {}),
        "rhs potential_field": ("potential_field", {})}
STEPS = (10, 28, 60, 200)  # of python-motion-planning's RRT-Connect, in cells, beside its own default; ours takes 28
CONNECT = ("pmp RRT-Connect", *(f"pmp RRT-Connect step {step}" for step in STEPS))
ROADMAPS = ("rtb PRM 100 points", "rtb PRM 300 points")
SLOW = {"rtb PRM 300 points": 5, "pmp A*": 3, "pmp Theta*": 3}  # fewer seeds for seconds per path, and without chance


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
    (chosen.out / "planning_peers_ratios.txt").write_text("\n".join(ratios(rows)) + "\n")
    print("\n".join(ratios(rows)))


def one_map(name: str, seeds: int) -> list[dict]:
    """One row per planner on one map."""
    problem = question_of(load_arena(name)).problem()
    optimum = Optimum(problem.blocked, problem.resolution_m, problem.origin_m).length_m([problem.start_m, problem.goal_m])
    planners = {**{word: ours(problem, *what, pulled=" raw" not in word) for word, what in OURS.items()},
                **motion_planning(problem), **robotics_toolbox(problem), **scikit_image(problem)}
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


def ours(problem: PlanningProblem, name: str, values: dict, *, pulled: bool) -> Plan:
    settings = registry.load("planner", name)(**values)

    def plan(seed: int) -> np.ndarray | None:
        path = planners[seed].plan(problem)
        path = shortened(path, problem) if pulled else path
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
            np.random.seed(seed)  # noqa: NPY002
            path, told = planner.plan()
            return np.array(path, float) * problem.resolution_m + centre if told["success"] else None

        return plan

    return {"pmp RRT-Connect": of(pmp.RRTConnect),
            **{f"pmp RRT-Connect step {step}": of(pmp.RRTConnect, max_dist=float(step)) for step in STEPS},
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
    """How many times faster, per map and as geometric mean over the maps, with what is compared in front."""
    cell = {(row["map"], row["planner"]): row for row in rows}
    lines = ["each as it comes, raw paths"]
    lines += [ratio(cell, "rhs rrt_connect raw", CONNECT[:1]), ratio(cell, "rhs prm raw", ROADMAPS[:1])]
    lines += ["edges of the same length, 28 cells (ours as it comes) and any (their fastest), raw paths",
              ratio(cell, "rhs rrt_connect raw", ("pmp RRT-Connect step 28",)),
              ratio(cell, "rhs rrt_connect raw step 200", ("pmp RRT-Connect step 200",))]
    lines += ["the one setting of theirs that is fastest over the four maps, among those with as many valid paths as ours "
              "(where there is one); ours raw, shortened, and by OMPL"]
    for kind, words in (("rrt_connect", CONNECT), ("prm", ROADMAPS)):
        lines += [ratio(cell, f"rhs {kind}{how}", fastest(cell, words)) for how in (" raw", "", " OMPL raw")]
    lines += ["the same, valid or not", ratio(cell, "rhs rrt_connect raw", fastest(cell, CONNECT, valid=False))]
    lines += ["their fastest setting chosen anew for each map, by hindsight, among those with as many valid paths as ours "
              "(where there is one)"]
    lines += [ratio(cell, "rhs rrt_connect raw", CONNECT), ratio(cell, "rhs prm raw", ROADMAPS)]
    lines += ["the same, valid or not", ratio(cell, "rhs rrt_connect raw", CONNECT, valid=False)]
    return lines


def ratio(cell: dict[tuple[str, str], dict], mine: str, theirs: tuple[str, ...], *, valid: bool = True) -> str:
    each, taken = [], []
    for name in MAPS:
        good = [word for word in theirs if not valid or share(cell[name, word]) >= share(cell[name, mine])]
        best = min((cell[name, word] for word in good or theirs), key=lambda row: float(row["median_ms"]))
        each.append(float(best["median_ms"]) / float(cell[name, mine]["median_ms"]))
        which = best["planner"].partition("Connect ")[2] or best["planner"] if len(theirs) > 1 else ""
        taken.append(f"{name} {each[-1]:.1f} ({which}{', ' if which else ''}valid {best['valid']}/{best['n']})")
    label = theirs[0] if len(theirs) == 1 else f"the best of {len(theirs)} settings"
    ours = "/".join(str(sum(int(cell[name, mine][key]) for name in MAPS)) for key in ("valid", "n"))
    return f"- {mine} (valid {ours}): {np.exp(np.mean(np.log(each))):.1f} times faster than {label}: {', '.join(taken)}"


def fastest(cell: dict[tuple[str, str], dict], words: tuple[str, ...], *, valid: bool = True) -> tuple[str]:
    """The setting with the least geometric mean over the maps; of those whose every path is valid, if there are any."""
    good = [word for word in words if not valid or all(share(cell[name, word]) == 1.0 for name in MAPS)]
    return (min(good or words, key=lambda word: np.prod([float(cell[name, word]["median_ms"]) for name in MAPS])),)


def share(row: dict) -> float:
    """Valid paths per question."""
    return int(row["valid"]) / int(row["n"])


if __name__ == "__main__":
    main()
