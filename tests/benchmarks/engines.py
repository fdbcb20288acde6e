"""A sweep on each engine: first row after Enter, CPU beside the jobs, files, memory of the driver, and what is lost or
doubled when something is killed.

    python tests/benchmarks/engines.py [N] [ENGINE ...]         N planning jobs (1000); process and dask unless said
    python tests/benchmarks/engines.py [N] ENGINE --kill        the same with a worker killed, then the driver, then resumed

ENGINE may hold settings: `dask,address=tcp://head:8786`. For slurm, sbatch must be on the path. Printed: one line each; the
CPU of a sweep is that of all its processes (not of Slurm's), of a job what its own process needs (job_overhead.py).
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from rhs.base.processes import adopt_orphans, descendants
from rhs.runfolder.shards import lines_of, read_lines, shards

WORDS = ["task=planning", "world=map1", "planner=astar,fast_marching", "keep=none", "--jobs", "2"]


def engine_words(engine: str) -> list[str]:
    name, *more = engine.split(",")
    return [f"engine={name}", *(f"engine.{word}" for word in more)]


def start(folder: Path, *words: str) -> subprocess.Popen:
    out = (folder / "out.txt").open("a")
    return subprocess.Popen([sys.executable, "-m", "rhs", *words], cwd=folder, stdout=out, stderr=out,
                            start_new_session=True)


def count(folder: Path) -> int:
    return sum(1 for path in shards(folder) for _ in lines_of(path, []))


def rss_mb(pid: int) -> float:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize() / 2**20
    except (OSError, IndexError):
        return 0.0


def reaped_cpu_s() -> float:
    """CPU of all processes of a sweep that is over, those included that its own end left to us."""
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        try:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                time.sleep(0.1)
        except ChildProcessError:
            break
    now = os.times()
    return now.children_user + now.children_system


def watch(process: subprocess.Popen, sweep: Path, jobs: int, until: int | None = None) -> dict[str, float]:
    """Until the sweep ends, or has so many rows: when the first row came, the driver's memory then and at most."""
    begin, found = time.monotonic(), {"first_s": float("nan"), "rss_then_mb": 0.0, "rss_most_mb": 0.0}
    while process.poll() is None:
        rows = count(sweep)
        if rows and found["first_s"] != found["first_s"]:
            found |= {"first_s": time.monotonic() - begin, "rss_then_mb": rss_mb(process.pid)}
        if until is not None and rows >= until:
            break
        if rows < jobs:  # the table at the end is another matter
            found["rss_most_mb"] = max(found["rss_most_mb"], rss_mb(process.pid))
        time.sleep(0.1 if found["first_s"] != found["first_s"] else 0.5)
    return found


def account(sweep: Path, jobs: int) -> str:
    """Rows lost and doubled, files left."""
    torn: list[str] = []
    times = Counter(text[text.find('"words"'):][:24] for path in shards(sweep) for text in lines_of(path, torn))
    good = sum(line.row["status"] == "ok" for line in read_lines(shards(sweep), []).values())
    files = sum(len(names) for _, _, names in os.walk(sweep))
    return (f"{good} rows ok, {jobs - len(times)} lost, {sum(times.values()) - len(times)} doubled, {files} files, "
            f"torn {torn}")


def measure(engine: str, jobs: int) -> None:
    with tempfile.TemporaryDirectory() as place:
        adopt_orphans()
        before = reaped_cpu_s()
        begin = time.monotonic()
        process = start(Path(place), "-m", *WORDS, f"seed=range({jobs // 2})", "output=s", *engine_words(engine))
        found = watch(process, Path(place, "s"), jobs)
        took_s = time.monotonic() - begin
        cpu_s = reaped_cpu_s() - before
        print(f"{engine}: exit {process.returncode}, {jobs} jobs in {took_s:.0f} s, first row after "
              f"{found['first_s']:.1f} s, {1e3 * cpu_s / jobs:.0f} ms CPU a job in all, driver "
              f"{found['rss_then_mb']:.0f} MB at the first row, {found['rss_most_mb']:.0f} at most until the last; "
              f"{account(Path(place, 's'), jobs)}", flush=True)
        if process.returncode:
            print(Path(place, "out.txt").read_text()[-2000:])


def victim(engine: str, driver: int) -> list[int]:
    """Processes of a worker: with Dask a worker's, else a job server, or what stands for one."""
    def command(pid: int) -> str:
        try:
            return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
        except OSError:
            return ""

    every = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()] if "slurm" in engine else (
        descendants(driver))
    for word in ("submitit", "spawn_main", "jobserver", "forkserver"):
        if found := [pid for pid in every if word in command(pid) and pid != os.getpid()]:
            return found[:1]
    return []


def kills(engine: str, jobs: int) -> None:
    """A third through a worker is killed, at two thirds the driver; then it is resumed, by this engine."""
    with tempfile.TemporaryDirectory() as place:
        sweep, words = Path(place, "s"), engine_words(engine)
        process = start(Path(place), "-m", *WORDS, f"seed=range({jobs // 2})", "output=s", *words)
        watch(process, sweep, jobs, until=jobs // 3)
        struck = victim(engine, process.pid)
        for pid in struck:
            os.kill(pid, signal.SIGKILL)
        watch(process, sweep, jobs, until=2 * jobs // 3)
        at = count(sweep)
        process.kill()
        process.wait()
        time.sleep(2.0)
        code = start(Path(place), "--resume", "s", "--jobs", "2").wait()
        print(f"{engine}: killed {len(struck)} worker, the driver at {at} rows, resumed with exit {code}: "
              f"{account(sweep, jobs)}", flush=True)
        if code:
            print(Path(place, "out.txt").read_text()[-2000:])


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    chosen = [word for word in sys.argv[1:] if not word.startswith("--")]
    number = int(chosen.pop(0)) if chosen and chosen[0].isdigit() else 1000
    for one in chosen or ["process", "dask"]:
        (kills if "--kill" in sys.argv else measure)(one, number)
