"""What blame costs: CPU time of `task=blame` with four links over that of the patrol alone.

    python tests/benchmarks/blame_cost.py
    python tests/benchmarks/blame_cost.py --worlds square_small --words source.image_width=160 exact=true

Each in a process of its own with all that it starts, user and system time, as by default (recording, pictures, report), one
after the other. Two chains: ours, which loses little, and one that goes by its wheels alone. The first run loads what is
compiled and does not count.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from rhs.base.provenance import commit
from rhs.runfolder.row import read_row

WORLDS = ("square_small", "random:office/18", "random:loop/32")
CHAINS = {"ours": (), "wheels": ("odometry=wheel", "loop_closer=none", "localiser=odometry_only")}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS))
    parser.add_argument("--chains", nargs="+", default=list(CHAINS), choices=CHAINS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--words", nargs="*", default=["source.image_width=160"])
    options = parser.parse_args()
    ratios: list[float] = []
    own = [word for word in options.words if word.startswith(("exact=", "links="))]
    both = [word for word in options.words if word not in own] + [f"seed={options.seed}"]
    with tempfile.TemporaryDirectory() as folder:
        spent([*both, f"world={options.worlds[0]}"], Path(folder) / "warm")
        sys.stdout.write("| world | chain | run, CPU s | blame, CPU s | ratio | patrols | blame |\n" + 7 * "|---" + "|\n")
        for world in options.worlds:
            for chain in options.chains:
                words = [*both, f"world={world}", *CHAINS[chain]]
                one, _ = spent(words, Path(folder) / "run")
                all_s, row = spent(["task=blame", *own, *words], Path(folder) / "blame")
                ratios.append(all_s / one)
                sys.stdout.write(f"| {world} | {chain} | {one:.1f} | {all_s:.1f} | {ratios[-1]:.2f} | {row['blame_runs']} | "
                                 f"{row['blame']} |\n")
                sys.stdout.flush()
    sys.stdout.write(f"\nratio: median {statistics.median(ratios):.2f}, mean {statistics.fmean(ratios):.2f}, largest "
                     f"{max(ratios):.2f} of {len(ratios)}\ncommit: {commit()}\n")
    return 0


def spent(words: list[str], folder: Path) -> tuple[float, dict]:
    """CPU seconds of a run with all its processes, and its row."""
    with subprocess.Popen([sys.executable, "-m", "rhs", *words, f"output={folder}", "overwrite=true"],
                          stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    row = read_row(folder / "row.json")
    if row["status"] != "ok":
        raise SystemExit(f"{' '.join(words)}: {row['status']}: {row['reason']}")
    return used.ru_utime + used.ru_stime, row


if __name__ == "__main__":
    sys.exit(main())
