"""A large planning sweep as a user starts it: time to the first row, rows a second, CPU a job, memory of the driver, files,
and what is lost or doubled when a worker and the driver are killed.

    python tests/benchmarks/big_sweep.py [N] [WORD ...] [--for SECONDS] [--kill]         100000 jobs

WORD: of the sweep, in place of `planner=astar`; `engine=dask` for instance. --for: stop (Ctrl-C) after so long, and say how
far it came. --kill: after a third a process that runs jobs is killed, after two thirds the driver, each with SIGKILL; then
`--resume`. A line every ten seconds: seconds since Enter, rows, memory of the driver, files.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from engines import account, reaped_cpu_s, rss_mb, victim

from rhs.base.processes import adopt_orphans, descendants
from rhs.runfolder.shards import shards

EVERY_S = 10.0


def cpu_s(pids: list[int]) -> float:
    """CPU seconds that processes and those that they have waited for took so far."""
    ticks = 0
    for pid in pids:
        with contextlib.suppress(OSError):
            ticks += sum(map(int, Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:15]))
    return ticks / os.sysconf("SC_CLK_TCK")


class Watched:
    """A sweep under way in `home`/s; rows are counted by the newlines that its shards grew by."""

    def __init__(self, home: Path, *words: str) -> None:
        self.sweep, self.begin = home / "s", time.monotonic()
        self.read = {path: path.stat().st_size for path in shards(self.sweep)}
        self.rows, self.first_s, self.said, self.most_mb = 0, 0.0, 0.0, 0.0
        self.process = subprocess.Popen([sys.executable, "-m", "rhs", *words], cwd=home, start_new_session=True,
                                        stdout=(home / "out.txt").open("a"), stderr=subprocess.STDOUT)

    def look(self) -> None:
        """Take in what the shards grew by."""
        for path in shards(self.sweep):
            with path.open("rb") as file:
                file.seek(self.read.get(path, 0))
                text = file.read()
            self.read[path] = self.read.get(path, 0) + len(text)
            self.rows += text.count(b"\n")
        self.most_mb = max(self.most_mb, rss_mb(self.process.pid))
        now = time.monotonic() - self.begin
        if self.rows and not self.first_s:
            self.first_s = now
            spent = cpu_s([self.process.pid]), cpu_s(descendants(self.process.pid))
            print(f"first row after {now:.1f} s; CPU until then: driver {spent[0]:.1f} s, what it started {spent[1]:.1f} s; "
                  f"driver {rss_mb(self.process.pid):.0f} MB", flush=True)
        if now - self.said > EVERY_S:
            self.said = now
            files = sum(len(names) for _, _, names in os.walk(self.sweep))
            print(f"{now:.0f} s: {self.rows} rows, driver {rss_mb(self.process.pid):.0f} MB, {files} files", flush=True)

    def until(self, rows: int, seconds: float) -> bool:
        """Watch until there are so many rows, the sweep is over, or so long has passed; whether it runs on."""
        while self.process.poll() is None and self.rows < rows and time.monotonic() - self.begin < seconds:
            self.look()
            time.sleep(0.02 if not self.first_s else 0.5)
        self.look()
        return self.process.poll() is None


def main(jobs: int, words: list[str], seconds: float, kill: bool) -> None:
    """Run it and print what became of it."""
    adopt_orphans()
    engine = next((word.partition("=")[2] for word in words if word.startswith("engine=")), "process")
    words = ["task=planning", "world=map1", *(words or ["planner=astar"]), "keep=none", f"seed=range({jobs})"]
    with tempfile.TemporaryDirectory() as place:
        home, before = Path(place), reaped_cpu_s()
        one = Watched(home, "-m", *words, "output=s", "--jobs", "2")
        if kill:
            if one.until(jobs // 3, seconds):
                for pid in victim(engine, one.process.pid):
                    os.kill(pid, signal.SIGKILL)
                    print(f"killed a process that runs jobs at {one.rows} rows", flush=True)
            if one.until(2 * jobs // 3, seconds):
                one.process.kill()
                print(f"killed the driver at {one.rows} rows", flush=True)
                one.process.wait()
                time.sleep(2.0)
                one = Watched(home, "--resume", "s", "--jobs", "2")
        if one.until(2 * jobs, seconds):
            one.process.send_signal(signal.SIGINT)
        one.process.wait()
        one.look()
        rate = one.rows / (time.monotonic() - one.begin)
        print(f"{engine}: exit {one.process.returncode}, {one.rows} rows since the last start, {rate:.1f} a second, first "
              f"after {one.first_s:.1f} s, driver at most {one.most_mb:.0f} MB; {account(home / 's', jobs)}")
        if not kill:
            print(f"{1e3 * (reaped_cpu_s() - before) / max(1, one.rows):.0f} ms CPU a job in all, start and end included")
        print((home / "out.txt").read_text()[-1500:])


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    typed = sys.argv[1:]
    long_s = float(typed.pop(typed.index("--for") + 1)) if "--for" in typed else 1e9
    numbers = [int(word) for word in typed if word.isdigit()]
    main(*(numbers or [100_000]), words=[word for word in typed if "=" in word], seconds=long_s, kill="--kill" in typed)
