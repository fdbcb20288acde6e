"""What closing loops cures, and whether a false one is ever taken: on recorded laps, with three odometries.

    python tests/benchmarks/loops.py --keep results/laps --seeds 10

Every lap is led in the simulator once and kept (tests/benchmarks/laps.py); each odometry on it is a run of its own, since
the loop closer sees other poses, but the pictures are the same: `laps` counts what was led. ATE and end error are taken
from the known start, without alignment; cuts compare their sums over the laps of a row. A closure is false when it puts
the later view more than 0.3 m or 5 degrees from where it truly stood (in the directions that its covariance claims to
know). rebuild: drawing the grid anew from the closed poses. --kept: only laps that are there already. --add: only laps
that loops_runs.csv does not hold yet, which are added to it.
Writes results/tables/loops.csv and loops_runs.csv.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from laps import ODOMETRIES, SETTINGS, Lap, Taken, taken

from rhs.api.contracts import Context
from rhs.api.geometry import inverse, planar
from rhs.api.randomness import generator
from rhs.config.compose import compose_config
from rhs.estimation.survey import draw
from rhs.estimation.views.loops import poses_of
from rhs.worlds.world import load_world

TABLES = Path(__file__).resolve().parents[2] / "results" / "tables"
CLOSERS = ("error_distribution", "pose_graph")
FALSE_M, FALSE_RAD, CLAIMED_M = 0.3, np.radians(5.0), 1.0
RUNS = ("world,lap,odometry,closer,views,ate_before_m,ate_after_m,end_before_m,end_after_m,closures,by_scan,refused,"
        "false_closures,closing_cpu_ms,rebuild_cpu_ms")
GROUPS = ("world,odometry,closer,laps,ate_before_m,ate_after_m,ate_cut_percent,end_before_m,end_after_m,end_cut_percent,"
          "closures,false_closures,closing_cpu_ms,rebuild_cpu_ms")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, default=TABLES.parent / "laps")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--kept", action="store_true", help="only laps that are there already")
    parser.add_argument("--add", action="store_true", help="only laps that are not in the table yet")
    parser.add_argument("--out", type=Path, default=TABLES)
    options = parser.parse_args()
    rows = written(options.out / "loops_runs.csv") if options.add else []
    there = {row[1] for row in rows}
    for world, lap in wanted(options.seeds):
        if lap.name in there:
            continue
        if options.kept and not (options.keep / f"{lap.name}.npz").exists():
            continue
        led = taken(lap, options.keep)
        for odometry in ODOMETRIES:
            rows += [[world, lap.name, odometry, closer, *measured(lap.world, led, odometry, closer)] for closer in CLOSERS]
        sys.stdout.write(f"{lap.name}: {len(led)} views\n")
        sys.stdout.flush()
    with (options.out / "loops_runs.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([RUNS.split(","), *rows])
    table = "\n".join([GROUPS, *grouped(rows)]) + "\n"
    (options.out / "loops.csv").write_text(table)
    sys.stdout.write(table)
    return 0


def written(path: Path) -> list[list[str]]:
    """The rows of a table of runs without its head."""
    with path.open(newline="") as file:
        return list(csv.reader(file))[1:]


def wanted(seeds: int) -> Iterator[tuple[str, Lap]]:
    """Name of the group, and lap: buildings of different paintings, and buildings that look alike."""
    for world in ("square", "figure_eight", "there_and_back"):
        yield from ((world, Lap(world, seed, "ccw", (f"source.texture_seed={seed}",))) for seed in range(seeds))
    few = ("source.paintings_unique=4", "source.wall_roughness=3")
    for seed in range(6 * seeds):
        yield "square_small, 4 paintings", Lap("square_small", seed, "ccw", (*few, f"source.texture_seed={seed}"))
    for world in ("square_twin", "square_alike"):
        yield from ((world, Lap(world, seed, "ccw", (f"source.texture_seed={seed}",))) for seed in range(2 * seeds))
        yield from ((world, Lap(world, seed)) for seed in range(4))
        yield from ((world, Lap(world, 1000 + seed, "ccw", (), 0.3, 8.0)) for seed in range(4))
        yield world, Lap(world, 1, "ccw", (), 0.2, 5.0)
        yield world, Lap(world, 2, "cw", (), 0.1, 3.0)


def measured(world: str, led: Taken, odometry: str, closer: str) -> list[str]:
    """The figures of one run, as text."""
    context = Context(generator(0, closer), led.camera, load_world(world).facts(), Path(), SETTINGS)
    views, truth = led.views(odometry), led.truth
    before = poses_of(views)
    part = compose_config([f"loop_closer={closer}"]).loop_closer.settings.build(context)
    begin = time.process_time()
    closure = part.close(views)
    closed = time.process_time()
    corrected = tuple(replace(view, map_from_body=pose) for view, pose in zip(views, closure.poses, strict=True))
    draw(corrected, compose_config(["mapper=occupancy"]).mapper.settings.build(context))
    drawn = time.process_time()
    taken_edges = [edge for edge in closure.edges if edge.accepted]
    false = sum(is_false(truth, edge) for edge in taken_edges)
    errors = [_ate(before, truth), _ate(closure.poses, truth), _end(before, truth), _end(closure.poses, truth)]
    counts = [closure.details["closures"], closure.details.get("closures_by_scan", 0.0),
              len(closure.edges) - len(taken_edges), false, 1e3 * (closed - begin), 1e3 * (drawn - closed)]
    return [str(len(led)), *(f"{x:.4f}" for x in errors), *(f"{x:.0f}" for x in counts)]


def is_false(truth: np.ndarray, edge) -> bool:
    """Whether an edge is wrong in a direction that it claims to know."""
    wrong = np.abs(planar(inverse(inverse(truth[edge.earlier]) @ truth[edge.later]) @ edge.earlier_from_later))
    claimed = np.sqrt(np.diag(edge.covariance)[[0, 1, 5]]) < CLAIMED_M
    return bool(np.any(claimed & (wrong > [FALSE_M, FALSE_M, FALSE_RAD])))


def grouped(rows: list[list[str]]) -> Iterator[str]:
    """A line per world, odometry and closer."""
    keys = dict.fromkeys((row[0], row[2], row[3]) for row in rows)
    for world, odometry, closer in keys:
        mine = np.array([row[5:] for row in rows if (row[0], row[2], row[3]) == (world, odometry, closer)], float)
        before, after, end_before, end_after = mine[:, :4].mean(axis=0)
        yield (f'"{world}",{odometry},{closer},{len(mine)},{before:.3f},{after:.3f},{100 * (1 - after / before):.0f},'
               f"{end_before:.3f},{end_after:.3f},{100 * (1 - end_after / end_before):.0f},{mine[:, 4].sum():.0f},"
               f"{mine[:, 7].sum():.0f},{np.median(mine[:, 8]):.0f},{np.median(mine[:, 9]):.0f}")


def _ate(poses: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(((poses[:, :2, 3] - truth[:, :2, 3]) ** 2).sum(axis=1).mean()))


def _end(poses: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm((poses[-1] - truth[-1])[:2, 3]))


if __name__ == "__main__":
    sys.exit(main())
