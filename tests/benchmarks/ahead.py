"""What looking ahead saves: `python tests/benchmarks/ahead.py [--runs 3] [WORD ...]`.

The default run, in line (ahead=off) and ahead (ahead=on) by turns, each in a process of its own; words are of the runs, as
on the command line. Prints seconds of the wall clock, which want an idle machine; of processor time, which do not; and of
the main thread's processor time, below which no wall clock gets. Ends with exit code 1 where rows or recordings differ.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from rhs.base.processes import THREADS

MODES = ("off", "on")
FIGURES = ("wall_s", "cpu_s", "main_thread_s")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--child", default="")
    parser.add_argument("words", nargs="*")
    chosen = parser.parse_args()
    if chosen.child:
        print(json.dumps(one(chosen.words, Path(chosen.child))))
        return 0
    found: dict[str, list[dict[str, object]]] = {mode: [] for mode in MODES}
    for _ in range(chosen.runs):
        for mode in MODES:
            found[mode].append(in_a_process([*chosen.words, f"ahead={mode}"]))
    print(f"{'':16s}{'in line':>10s}{'ahead':>10s}{'ratio':>8s}   medians of {chosen.runs} by turns")
    for name in FIGURES:
        line, ahead = (median(float(str(run[name])) for run in found[mode]) for mode in MODES)
        print(f"{name:16s}{line:10.2f}{ahead:10.2f}{line / ahead:8.2f}")
    same = len({run["digest"] for runs in found.values() for run in runs}) == 1
    print("rows and recordings are the same" if same else "rows or recordings DIFFER")
    return 0 if same else 1


def in_a_process(words: list[str]) -> dict[str, object]:
    """One run, timed as its process sees it."""
    with tempfile.TemporaryDirectory() as home:
        out = subprocess.run([sys.executable, __file__, "--child", f"{home}/run", *words], check=True, text=True,
                             stdout=subprocess.PIPE, env=os.environ | dict.fromkeys(THREADS, "1")).stdout
    found: dict[str, object] = json.loads(out)
    return found


def one(words: list[str], folder: Path) -> dict[str, object]:
    """The run itself."""
    began_s = time.perf_counter()
    import rhs
    from rhs.recording.reader import Reading
    from rhs.runfolder.row import machine_dependent

    row = rhs.run([*words, f"output={folder}"], quiet=True)
    figures: dict[str, object] = {"wall_s": time.perf_counter() - began_s, "cpu_s": time.process_time(),
                                  "main_thread_s": time.thread_time()}
    digest = hashlib.sha256(repr([item for item in row.items() if not machine_dependent(item[0]) and item[0] != "folder"])
                            .encode())
    if (folder / "run.mcap").exists():
        for message in Reading(folder / "run.mcap"):
            digest.update(message.channel.topic.encode() + bytes(message.data))
    return figures | {"digest": digest.hexdigest(), "status": row["status"]}


if __name__ == "__main__":
    sys.exit(main())
