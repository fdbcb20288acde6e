"""The default command as a user meets it: `python tests/benchmarks/default_command.py [--runs 3] [--out results/tables]`.

Times `python -m rhs` and `python -m rhs --help` as whole processes and splits the run by stage. Wants an idle machine.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

STAGES = ("capture_ms", "sense_ms", "odometry_ms", "localise_ms", "map_ms", "plan_ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    rows = [("--help, whole process", median(wall_s("--help") for _ in range(2 * chosen.runs + 1)), "s")]
    walls, kept = [], []
    for _ in range(chosen.runs):
        with tempfile.TemporaryDirectory() as name:
            walls.append(wall_s(f"output={name}/run"))
            kept.append(json.loads((Path(name) / "run" / "row.json").read_text()))
    rows += [("default command, whole process", median(walls), "s"), ("slowest of them", max(walls), "s")]
    rows += [(name, median(row[name] for row in kept), unit) for name, unit in
             (("peak_memory_mb", "MB"), ("real_time_factor", "1"), ("views", "1"))]
    rows += [(f"{stage}, median per view", median(row[stage] for row in kept), "ms") for stage in STAGES]
    chosen.out.mkdir(parents=True, exist_ok=True)
    with (chosen.out / "default_command.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["what", "value", "unit", "runs"])
        table.writerows([what, f"{value:.4g}", unit, chosen.runs] for what, value, unit in rows)
    print((chosen.out / "default_command.csv").read_text())


def wall_s(word: str) -> float:
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-m", "rhs", word], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begin


if __name__ == "__main__":
    main()
