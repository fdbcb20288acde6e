"""A sweep of planners x localisers with one survey for all, with that of an earlier sweep, and with a survey each: CPU
seconds, rows column by column.

    python tests/benchmarks/sharing.py [PLANNERS] [LOCALISERS] [WORD ...]

For example `12 3`; words are of the runs, `world=square_small source.image_width=160 seed=0` unless said. One process at a
time. Three sweeps in a temporary folder; prints their CPU seconds and wall seconds, the ratio, and every column that is not
the same.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rhs.base.processes import adopt_orphans
from rhs.runfolder.row import machine_dependent, read_row

PLANNERS = ["astar", "prm", "rrt", "rrt_connect", "theta_star", "rrt_star", "bit_star", "fmt", "informed_rrt_star",
            "prm_star", "fast_marching", "potential_field"]
LOCALISERS = ["sift_db", "particle_filter", "particle_filter_scan"]
WORDS = ["world=square_small", "source.image_width=160", "seed=0"]


def sweep(folder: Path, *words: str) -> tuple[float, float]:
    """CPU and wall seconds of a sweep and all that it starts."""
    began, before = time.monotonic(), os.times()
    subprocess.run([sys.executable, "-m", "rhs", "-m", *words, f"output={folder}", "--jobs", "1"], check=False,
                   stdout=subprocess.DEVNULL)
    try:
        while True:
            os.wait()  # the server of the jobs outlives the sweep a little
    except ChildProcessError:
        pass
    now = os.times()
    return now[2] + now[3] - before[2] - before[3], time.monotonic() - began


def rows(folder: Path) -> dict[str, dict[str, object]]:
    """The repeatable columns of each row, by run."""
    return {path.parent.name: {name: value for name, value in read_row(path).items() if not machine_dependent(name)}
            for path in folder.glob("*/row.json")}


def main(planners: int, localisers: int, more: list[str]) -> None:
    """Print the comparison."""
    adopt_orphans()
    words = [*(more or WORDS), f"planner={','.join(PLANNERS[:planners])}", f"localiser={','.join(LOCALISERS[:localisers])}"]
    with tempfile.TemporaryDirectory() as home:
        os.environ["RHS_CACHE"] = str(Path(home, "cache"))
        shared_s, shared_wall_s = sweep(Path(home, "shared"), *words)
        later_s, later_wall_s = sweep(Path(home, "later"), *words)
        alone_s, alone_wall_s = sweep(Path(home, "alone"), *words, "share=false", "cache=false")
        alone = rows(Path(home, "alone"))
        print(f"{len(alone)} jobs: {alone_s:.1f} s of CPU alone ({alone_wall_s:.1f} s), {shared_s:.1f} s shared "
              f"({shared_wall_s:.1f} s): {alone_s / shared_s:.2f} times, {later_s:.1f} s with that of the sweep before "
              f"({later_wall_s:.1f} s): {alone_s / later_s:.2f} times")
        differing = [f"{other.name}/{run}: {name}" for other in (Path(home, "shared"), Path(home, "later"))
                     for there in [rows(other)] for run in sorted({**alone, **there})
                     for name in {**alone.get(run, {}), **there.get(run, {})}
                     if repr(alone.get(run, {}).get(name)) != repr(there.get(run, {}).get(name))]
        columns = sum(len(row) for row in alone.values())
        ended = sorted({str(row["status"]) for row in alone.values()})
        print(f"{columns} values of {len(alone)} rows ({', '.join(ended)}): {len(differing)} differ", *differing, sep="\n  ")


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    counts = [int(word) for word in sys.argv[1:] if word.isdigit()]
    main(*(counts + [12, 3][len(counts):]), more=[word for word in sys.argv[1:] if "=" in word])
