"""One camera without depth in drawn buildings: places, touches, and whether it says so where it is wrong.

    python tests/benchmarks/one_eye.py --seeds 0-9 --out runs/one_eye
    python tests/benchmarks/one_eye.py --families loop office --seeds 3-4 --out runs/corridor odometry=corridor_ekf

Patrols with `sensor=mono` as tests/benchmarks/buildings.py runs them: killed, it goes on where it stopped when the same
command is given again. A view is `wrong` when its belief is off by more than three stated sigmas in x, y or heading, and
by more than 5 cm or 2 degrees; `doubted` when it says so: motion not `ok` or belief not `tracking`. `honest`: it arrived
wherever it said so, and all reachable places were visited, or some view of the patrol was called lost, or a place was given
up with a reason. Writes one_eye.csv. Seeds below 10000 are for tuning, those from 10000 on for judging only.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from buildings import rows
from shared import write

from rhs.base.provenance import commit
from rhs.worlds.random.names import FAMILIES

LEAST = np.array([0.05, 0.05, np.radians(2.0)])  # a belief this near is right, however sure it is

PHASES = ("survey", "patrol")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES))
    parser.add_argument("--seeds", default="0-9", help="first-last, both included")
    parser.add_argument("--out", type=Path, default=Path("runs/one_eye"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=1800.0, help="seconds for one run")
    parser.add_argument("words", nargs="*", help="key=value words of a run")
    options = parser.parse_intermixed_args()
    first, _, last = options.seeds.partition("-")
    words = ["sensor=mono", f"world={','.join(f'random:{family}' for family in options.families)}",
             f"seed=range({int(first)},{int(last or first) + 1})", *options.words]
    command = [sys.executable, "-m", "rhs", "-m", *words, f"output={options.out}", "recording=off", "pictures=off",
               f"--jobs={options.jobs}", f"--timeout={options.timeout:g}"]
    resume = ["--resume"] if (options.out / "sweep.json").exists() else []
    subprocess.run([*command, *resume], check=False)
    folders = [path.parent for path in sorted(options.out.glob("*/row.json"))]
    if not folders:
        sys.stderr.write(f"no rows in {options.out}\n")
        return 1
    found = [judged(row | said(folder / "steps.csv") | {"arrived": arrivals(folder)})
             for row, folder in zip(rows(options.out), folders, strict=True)]
    write(options.out / "one_eye.csv", found)
    sys.stdout.write("\n".join([*table(found), f"command: {' '.join(command[1:])}", f"commit: {commit()}", ""]))
    return 0


def said(path: Path) -> dict[str, Any]:
    """Views, those wrong by more than three sigmas, those of them doubted, of survey and patrol; views of the patrol called
    lost."""
    values: dict[str, Any] = {f"{phase}_{name}": 0 for phase in PHASES for name in ("views", "wrong", "doubted")}
    values["lost"] = 0
    if not path.exists():
        return values
    with path.open(newline="") as file:
        for view in csv.DictReader(file):
            phase, axes = view["phase"], ("x_m", "y_m", "yaw_rad")
            off = np.array([float(view[axis]) - float(view[f"true_{axis}"]) for axis in axes])
            off[2] = (off[2] + np.pi) % (2.0 * np.pi) - np.pi
            sigma = np.array([float(view[f"sigma_{axis}"]) for axis in axes])
            wrong = bool((np.abs(off) > np.maximum(3.0 * sigma, LEAST)).any())
            doubted = view["motion_status"] != "ok" or view["belief_status"] != "tracking"
            values[f"{phase}_views"] += 1
            values[f"{phase}_wrong"] += wrong
            values[f"{phase}_doubted"] += wrong and doubted
            values["lost"] += phase == "patrol" and view["belief_status"] == "lost"
    return values


def judged(row: dict[str, Any]) -> dict[str, Any]:
    """The row with what the goals ask: all that can be reached visited, or the truth told about what was not."""
    every, told = row["visited"] >= row["reachable"], row["lost"] > 0 or bool(row["cause"])
    return row | {"every": float(every), "honest": float(row["arrived"] <= row["visited"] and (every or told))}


def arrivals(folder: Path) -> int:
    """Places at which the robot said that it had arrived."""
    path = folder / "missions.json"
    return sum(mission["status"] == "arrived" for mission in json.loads(path.read_text())) if path.exists() else 0


def table(found: list[dict[str, Any]]) -> list[str]:
    """Lines by building and of all."""
    lines = [f"{'building':<28}{'visited':>8}{'of':>4}{'touches':>8}{'ATE m':>8}{'wrong and sure':>15}"
             f"{'wrong, survey':>14}{'doubted':>8}{'wrong, patrol':>14}{'doubted':>8}  cause"]
    for row in found:
        lines.append(f"{row['building']:<28}{row['visited']:>8.0f}{row['reachable']:>4}{row['collisions']:>8.0f}{row['ate_m']:>8.3f}"
                     f"{row['wrong_sure']:>15.3f}{_share(row, 'survey')}{_share(row, 'patrol')}  {row['cause'][:60]}")
    done = [row for row in found if row["status"] == "ok"]
    every, honest = (sum(row[name] for row in done) for name in ("every", "honest"))
    free = sum(row["collisions"] == 0 for row in done)
    wrong, doubted = (sum(row[f"{phase}_{name}"] for row in done for phase in PHASES) for name in ("wrong", "doubted"))
    views = sum(row[f"{phase}_views"] for row in done for phase in PHASES)
    return [*lines, f"{len(found)} buildings, {len(done)} with a row: all places in {_of(every, len(done))}, honest in "
                    f"{_of(honest, len(done))}, no touch in {_of(free, len(done))}; of {views} views {wrong} wrong by more "
                    f"than three sigmas, doubted {_of(doubted, wrong)}"]


def _of(some: float, many: float) -> str:
    return f"{some:.0f} of {many:.0f} ({some / max(many, 1):.0%})"


def _share(row: dict[str, Any], phase: str) -> str:
    views = max(row[f"{phase}_views"], 1)
    return f"{row[f'{phase}_wrong'] / views:>14.3f}{row[f'{phase}_doubted']:>8}"


if __name__ == "__main__":
    sys.exit(main())
