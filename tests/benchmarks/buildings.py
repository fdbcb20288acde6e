"""Patrols in random buildings: places reached of those that can be reached, collisions, wrong and sure, by family.

    python tests/benchmarks/buildings.py --seeds 0-99 --out runs/buildings
    python tests/benchmarks/buildings.py --families office home --seeds 10000-10019 planner=theta_star

A sweep of `world=random:FAMILY` over seeds, each its own building, driven once; with `--runs 2` twice, by the run's seeds 0
and 1. Further words are those of a run. Killed, it goes on where it stopped when the same command is given again.
`reachable`: places that a disc of the robot's radius gets to from the end of the survey with the obstacles in place, on the
true plan (places_reachable). `barred`: those of them to which nobody could have got for people, had he known where they
would walk (walkers.py). `named`: of the places that nobody could get to, for things or people, those given up in such words;
for things also within 0.5 m of one of them.
`clean`: every reachable one visited, nothing touched. The mean of wrong_sure (belief_wrong_sure_share) is over runs,
collisions are summed; `no row`: failed or killed.
Writes buildings.csv beside the runs. Seeds below 10000 are for building and tuning, those from 10000 on for judging only.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from shared import write
from walkers import got_to

from rhs.api.floorplan import World, distance_m
from rhs.base.provenance import commit
from rhs.runfolder.row import read_row
from rhs.worlds.random.names import FAMILIES, building_of
from rhs.worlds.world import load_world

FIGURES = ("places_reachable", "places_undecided", "places_visited", "collisions", "belief_wrong_sure_share", "success",
           "ate_rmse_m", "wall_ms")
NAMED_M = 0.5  # from the outline of what closes a way


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), help="such as office, or office+plain")
    parser.add_argument("--seeds", default="0-9", help="first-last, both included")
    parser.add_argument("--runs", type=int, default=0, help="of each building, by seeds 0 to RUNS - 1; 0: one, by its own")
    parser.add_argument("--out", type=Path, default=Path("runs/buildings"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=1800.0, help="seconds for one run")
    parser.add_argument("words", nargs="*", help="key=value words of a run")
    options = parser.parse_intermixed_args()
    first, _, last = options.seeds.partition("-")
    numbers = range(int(first), int(last or first) + 1)
    worlds = [f"random:{family}/{number}" for family in options.families for number in numbers] if options.runs else [
        f"random:{family}" for family in options.families]
    seeds = f"range({options.runs})" if options.runs else f"range({numbers.start},{numbers.stop})"
    words = [f"world={','.join(worlds)}", f"seed={seeds}", *options.words]
    command = [sys.executable, "-m", "rhs", "-m", *words, f"output={options.out}", "recording=off", "pictures=off"]
    limits = [f"--jobs={options.jobs}", f"--timeout={options.timeout:g}"]
    resume = ["--resume"] if (options.out / "sweep.json").exists() else []
    subprocess.run([*command, *limits, *resume], check=False)
    found = rows(options.out)
    if not found:
        sys.stderr.write(f"no rows in {options.out}\n")
        return 1
    write(options.out / "buildings.csv", found)
    sys.stdout.write("\n".join([*table(found), f"command: {' '.join(command[1:])}", f"commit: {commit()}", ""]))
    return 0


def rows(folder: Path) -> list[dict[str, Any]]:
    """One per run of the sweep: what became of it, and what could have."""
    out = []
    for path in sorted(folder.glob("*/row.json")):
        row = read_row(path)
        world = load_world(str(row["world"]), seed=int(row["seed"]))
        known = [np.nan if row.get(name) is None else float(row[name]) for name in FIGURES]
        can, undecided, visited, touched, sure, success, ate, wall = known
        out.append({
            **not_got_to(world, path.parent),
            "family": str(row["world"]).removeprefix("random:").partition("/")[0],
            "building": building_of(str(row["world"]), row["seed"]), "status": row["status"],
            "places": len(world.places), "reachable": can, "open": undecided, "visited": visited, "collisions": touched,
            "wrong_sure": sure, "success": success,
            "clean": float(visited >= can and touched == 0), "obstacles": len(world.obstacles),
            "ate_m": ate, "wall_ms": wall,
            "cause": str(row.get("cause") or row.get("reason") or "")})
    return out


def not_got_to(world: World, folder: Path) -> dict[str, int]:
    """Places that nobody could have got to, for people and in all, and how many of these were given up in such words."""
    missions, reach = (json.loads(path.read_text()) if path.exists() else {} for path in
                       (folder / "missions.json", folder / "reach.json"))
    missed = {one["place"]: one["reason"] for one in missions if one["status"] == "gave_up"}
    spare_m = {one["name"]: one["room_m"] - world.robot_radius_m for one in reach.get("places", ())}
    unsure_m = reach.get("unsure_m", 0.0)
    barred = {place for place in missed if spare_m.get(place, np.nan) >= unsure_m}
    barred -= got_to(world, folder) if barred else set()
    shut = {place for place in missed if spare_m.get(place, np.nan) < -unsure_m}
    rightly = [place for place in barred | shut
               if missed[place].startswith("no path") and ("somebody" in missed[place]) == (place in barred)
               and (place in barred or near_thing(world, missed[place]))]
    return {"barred": len(barred), "closed": len(barred | shut), "named": len(rightly)}


def near_thing(world: World, reason: str) -> bool:
    """Whether the words name a spot beside one of the world's obstacles; a building without any is closed by its walls."""
    if not world.obstacles:
        return True
    things = replace(world, walls=(), boxes=world.obstacles, obstacles=(), mesh=None)
    spots = re.findall(r"\((-?[0-9.]+), (-?[0-9.]+)\) m", reason)
    return any(distance_m(things, np.array(spot, float))[0] <= NAMED_M for spot in spots)


def table(found: list[dict[str, Any]]) -> list[str]:
    """Lines by family and of all."""
    lines = [f"{'family':<22}{'runs':>5}{'no row':>7}{'visited':>9}{'reachable':>10}{'open':>5}{'barred':>7}{'named':>7}"
             f"{'collisions':>11}{'in runs':>8}{'wrong_sure':>11}{'success':>8}{'clean':>7}"]
    families = sorted({row["family"] for row in found})
    for family in [*families, "all"]:
        some = [row for row in found if family in (row["family"], "all")]
        done = [row for row in some if row["status"] == "ok"]
        summed = "visited", "reachable", "open", "barred", "named", "closed", "collisions"
        total = {key: np.nansum([row[key] for row in done]) for key in summed}
        mean = {key: np.mean([row[key] for row in done if np.isfinite(row[key])]) if done else np.nan
                for key in ("wrong_sure", "success", "clean")}
        touched = sum(row["collisions"] > 0 for row in done)
        named = f"{total['named']:.0f}/{total['closed']:.0f}"
        lines.append(f"{family:<22}{len(some):>5}{len(some) - len(done):>7}{total['visited']:>9.0f}"
                     f"{total['reachable']:>10.0f}{total['open']:>5.0f}{total['barred']:>7.0f}{named:>7}"
                     f"{total['collisions']:>11.0f}{touched:>8}{mean['wrong_sure']:>11.4f}{mean['success']:>8.2f}"
                     f"{mean['clean']:>7.2f}")
    causes = {row["building"]: row["cause"] for row in found if row["cause"]}
    return [*lines, *(f"  {building}: {json.dumps(cause)[1:-1][:150]}" for building, cause in causes.items())]


if __name__ == "__main__":
    sys.exit(main())
