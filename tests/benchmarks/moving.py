"""What to do when somebody stands in the way: policies side by side in random buildings with people.

    python tests/benchmarks/moving.py --seeds 0-5 --out runs/moving
    python tests/benchmarks/moving.py --families home office --replan go_round wait --seeds 3-4 planner=theta_star

A sweep of `world=random:FAMILY+people` over seeds, each its own building, and over `replan`; further words are those of a
run. Killed, it goes on where it stopped when the same command is given again. `touches`: collisions, every one the robot's
doing: nobody walks into it. `idle worst`, `bound`: means of idleness_worst_s and idleness_bound_s, seconds. Compared are
only buildings in which every policy ended. Writes moving.csv beside the runs. Seeds from 10000 on are for judging only.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from shared import write

from rhs.base.provenance import commit
from rhs.runfolder.row import read_row
from rhs.worlds.random.names import FAMILIES, building_of

FIGURES = ("places_visited", "places_total", "collisions", "clearance_min_m", "idleness_worst_s", "idleness_mean_s",
           "idleness_bound_s", "replans", "views_waited", "extra_way_m", "places_skipped", "places_visited_later",
           "patrol_steps", "belief_wrong_sure_share")
POLICIES = ("new_mission", "go_round", "wait", "skip_and_return")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES))
    parser.add_argument("--replan", nargs="+", default=list(POLICIES))
    parser.add_argument("--seeds", default="0-1", help="first-last, both included")
    parser.add_argument("--out", type=Path, default=Path("runs/moving"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=1800.0, help="seconds for one run")
    parser.add_argument("words", nargs="*", help="key=value words of a run")
    options = parser.parse_intermixed_args()
    first, _, last = options.seeds.partition("-")
    words = [f"world={','.join(f'random:{family}+people' for family in options.families)}",
             f"seed=range({int(first)},{int(last or first) + 1})", f"replan={','.join(options.replan)}", *options.words]
    command = [sys.executable, "-m", "rhs", "-m", *words, f"output={options.out}", "recording=off", "pictures=off"]
    resume = ["--resume"] if (options.out / "sweep.json").exists() else []
    subprocess.run([*command, f"--jobs={options.jobs}", f"--timeout={options.timeout:g}", *resume], check=False)
    found = rows(options.out)
    if not found:
        sys.stderr.write(f"no rows in {options.out}\n")
        return 1
    write(options.out / "moving.csv", found)
    sys.stdout.write("\n".join([*table(found), f"command: {' '.join(command[1:])}", f"commit: {commit()}", ""]))
    return 0


def rows(folder: Path) -> list[dict[str, Any]]:
    """One per run of the sweep."""
    out = []
    for path in sorted(folder.glob("*/row.json")):
        row = read_row(path)
        figures = {name: np.nan if row.get(name) is None else float(row[name]) for name in FIGURES}
        out.append({"building": building_of(str(row["world"]), row["seed"]), "replan": row["replan"],
                    "status": row["status"], **figures, "cause": str(row.get("cause") or row.get("reason") or "")})
    return out


def table(found: list[dict[str, Any]]) -> list[str]:
    """A line a policy over the buildings in which all of them ended, and every touch by name."""
    policies = sorted({row["replan"] for row in found})
    done = {(row["building"], row["replan"]): row for row in found if row["status"] == "ok"}
    buildings = sorted({b for b, _ in done if all((b, policy) in done for policy in policies)})
    lines = [f"{len(buildings)} buildings, {len(found) - len(done)} runs without a row",
             f"{'replan':<17}{'places':>9}{'touches':>8}{'idle worst':>11}{'mean':>7}{'bound':>7}{'replans':>8}{'waited':>8}"
             f"{'extra m':>9}{'skipped':>8}{'later':>6}{'views':>7}"]
    for policy in policies:
        some = [done[b, policy] for b in buildings]
        total = {key: np.nansum([row[key] for row in some]) for key in FIGURES}
        mean = {key: np.nanmean([row[key] for row in some]) if some else np.nan for key in FIGURES}
        places = f"{total['places_visited']:.0f}/{total['places_total']:.0f}"
        lines.append(f"{policy:<17}{places:>9}{total['collisions']:>8.0f}{mean['idleness_worst_s']:>11.1f}"
                     f"{mean['idleness_mean_s']:>7.1f}{mean['idleness_bound_s']:>7.1f}{total['replans']:>8.0f}"
                     f"{total['views_waited']:>8.0f}{mean['extra_way_m']:>9.1f}{total['places_skipped']:>8.0f}"
                     f"{total['places_visited_later']:>6.0f}{mean['patrol_steps']:>7.0f}")
    touched = [f"  {row['building']} {row['replan']}: {row['collisions']:.0f} touches" for row in found
               if row["collisions"] > 0]
    left = [f"  {row['building']} {row['replan']}: {row['cause'][:120]}" for row in found if row["cause"]]
    return [*lines, *touched, *left]


if __name__ == "__main__":
    sys.exit(main())
