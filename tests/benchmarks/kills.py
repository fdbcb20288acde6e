"""SIGKILL at random moments: to single runs, to runs that overwrite another, and to sweeps (all of it, its driver, its
server, a job). Is a row lost, a row changed, a killed run not to be seen?

    python tests/benchmarks/kills.py [COUNT] [SEED]        COUNT kills, 200 unless said; prints one line per kind
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from installing import CHOICE, FAKES, environment

from rhs.base.processes import children, descendants
from rhs.cli.evaluate import differences
from rhs.reports.table import find_rows, rows, to_csv
from rhs.runfolder.row import read_row

RUN = [*CHOICE, "source.views=15", "source.delay_s=0.03", "pictures=off"]
SWEEP = ["-m", *CHOICE, "source.views=10", "source.delay_s=0.01", "seed=range(6)", "--jobs", "2", "--retries", "0"]


def start(folder: Path, *words: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES),
                            start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def once_claimed(process: subprocess.Popen, folder: Path) -> float:
    """Wait until the folder is claimed; when that was."""
    while process.poll() is None and not list(folder.glob(".lock")):
        time.sleep(0.005)
    return time.monotonic()


def kill_run(rng: random.Random, folder: Path, lasts_s: float) -> Counter:
    """One run, killed somewhere between its first and its last moment."""
    process = start(folder, *RUN, "output=run")
    once_claimed(process, folder / "run")
    time.sleep(rng.uniform(0.0, lasts_s))
    process.kill()
    process.wait()
    home, found = folder / "run", Counter(kills=1)
    statuses = [read_row(path)["status"] for path in find_rows([home])]
    began = [path.name for path in home.iterdir() if path.name != ".lock" and ".tmp-" not in path.name]
    found["seen"] = len(statuses) == 1 and statuses[0] in ("killed", "ok") or not began
    found["lost"] = 0 if found["seen"] else 1
    return found


def kill_overwriting(rng: random.Random, folder: Path, lasts_s: float) -> Counter:
    """A finished run, overwritten by one that is killed: the folder holds the one or the other, whole."""
    start(folder, *RUN, "seed=1", "output=run").wait()
    before = read_row(folder / "run" / "row.json")
    process = start(folder, *RUN, "seed=2", "output=run", "overwrite=true")
    while process.poll() is None and not list((folder / "run").glob(".attempt-*")):
        time.sleep(0.005)
    time.sleep(rng.uniform(0.0, lasts_s))
    process.kill()
    process.wait()
    all_rows = {path.parent: read_row(path) for path in find_rows([folder / "run"])}
    whole = [row for where, row in all_rows.items() if row["status"] == "ok" and not differences(where)]
    kept = any(row == before for row in whole) or any(row["seed"] == 2 for row in whole)
    return Counter(kills=1, seen=1, lost=not kept)


def kill_sweep(rng: random.Random, folder: Path, lasts_s: float, expected: str) -> Counter:
    """A sweep of which something is killed, and resumed: nothing that was finished changes, the table is the same."""
    process = start(folder, *SWEEP, "output=s")
    once_claimed(process, folder / "s")
    time.sleep(rng.uniform(0.0, lasts_s))
    what = kill_something(rng, process)
    if process.poll() is None and not descendants(process.pid):
        process.kill()
    process.wait()
    time.sleep(0.3)
    done = {path: path.read_text() for path in find_rows([folder / "s"]) if read_row(path)["status"] == "ok"}
    if (folder / "s" / "sweep.json").exists():
        code = start(folder, "--resume", "s", "--jobs", "2").wait()
    else:  # killed before it had said what it is
        code = start(folder, *SWEEP, "output=s").wait()
    changed = [path.parent.name for path, text in done.items() if not path.exists() or path.read_text() != text]
    same = code == 0 and table_of(folder / "s") == expected
    if changed or not same:
        print(f"{what} killed: rows changed {changed}, resumed with exit code {code}, "
              f"statuses {[read_row(path)['status'] for path in find_rows([folder / 's'])]}", flush=True)
    return Counter(kills=1, seen=1, lost=len(changed) + (not same))


def kill_something(rng: random.Random, process: subprocess.Popen) -> str:
    """The whole group, the driver, a child of it (the server that starts the jobs), or a job; which it was."""
    what = rng.choice(["group", "driver", "server", "job"])
    if what == "group":
        os.killpg(process.pid, signal.SIGKILL)
    elif what == "driver":
        process.kill()
    else:
        found = children(process.pid) if what == "server" else descendants(process.pid)[2:]
        if found:
            try:
                os.kill(rng.choice(found), signal.SIGKILL)
            except OSError:
                process.kill()
        else:
            process.kill()
    return what


def table_of(sweep: Path) -> str:
    return to_csv(rows([sweep]), canonical=True).replace(str(sweep), "")


def measure(count: int, seed: int) -> dict[str, Counter]:
    """Two in five single runs, one in five overwriting, two in five sweeps."""
    rng = random.Random(seed)
    total = {"run": Counter(), "overwriting": Counter(), "sweep": Counter()}
    with tempfile.TemporaryDirectory() as place:
        begin = time.monotonic()
        folder = Path(place, "model")
        folder.mkdir()
        process = start(folder, *RUN, "output=run")
        begin = once_claimed(process, folder / "run")
        process.wait()
        run_s = time.monotonic() - begin
        process = start(folder, *SWEEP, "output=s")
        begin = once_claimed(process, folder / "s")
        process.wait()
        sweep_s = time.monotonic() - begin
        expected = table_of(folder / "s")
        for number in range(count):
            folder = Path(place, str(number))
            folder.mkdir()
            kind = ("run", "sweep", "overwriting", "sweep", "run")[number % 5]
            if kind == "run":
                total[kind] += kill_run(rng, folder, run_s)
            elif kind == "overwriting":
                total[kind] += kill_overwriting(rng, folder, run_s)
            else:
                total[kind] += kill_sweep(rng, folder, sweep_s, expected)
    return total


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    for kind, found in measure(int((sys.argv[1:2] or ["200"])[0]), int((sys.argv[2:3] or ["0"])[0])).items():
        print(f"{kind:<12} {found['kills']:>4} kills {found['seen']:>4} to be seen {found['lost']:>4} rows lost or changed")
