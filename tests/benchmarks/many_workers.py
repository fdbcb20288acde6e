"""Throughput of a sweep against its workers, 1 to 320: the real driver and the real files of rows, workers that only wait.

    python tests/benchmarks/many_workers.py [SECONDS OF A JOB]       0.026: a planning job, measured by big_sweep.py

A worker answers a chunk when as many seconds have passed as its jobs take (`START_S` before the first: a job server
starts), with rows of 80 columns. Printed, for each number of workers: jobs a second, the share of what so many workers
could do without a driver, the driver's processor time a job (planning left out), and how busy it is. Answers are made in a
thread of the same process, which takes its turn with the driver: the shares are lower limits.
"""

from __future__ import annotations

import heapq
import json
import sys
import tempfile
import threading
import time
from concurrent.futures import Executor, Future
from pathlib import Path

from rhs.api.engine import Engine
from rhs.runfolder.shards import Line, words_key
from rhs.sweeps.chunks import Chunk
from rhs.sweeps.drive import Driver
from rhs.sweeps.jobs import Outcome
from rhs.sweeps.keep import Keeper

WORKERS = (1, 2, 8, 32, 100, 320)
START_S = 1.0  # once for each worker: its job server is started
LASTS_S = 15.0  # of one measurement, about
MOST_JOBS = 100_000
COLUMNS = {f"mine_{place}": 0.1234567890123 * (place + 1) for place in range(76)}
ROW = Line("RUN", "KEY", {}, {"status": "ok", "config_hash": "RUN", **COLUMNS}).text()


class Waiting(Executor):
    """So many workers, each busy with one chunk at a time; chunks wait for the first that is free."""

    def __init__(self, width: int, job_s: float) -> None:
        self.free = [time.monotonic() + START_S] * width
        self.job_s, self.due, self.number, self.wakes, self.ended = job_s, [], 0, threading.Condition(), False
        self.thread = threading.Thread(target=self._answer, daemon=True)
        self.thread.start()

    def submit(self, fn, /, *args, **kwargs):
        words, future = json.loads(args[0])["words"], Future()
        with self.wakes:
            ends = max(heapq.heappop(self.free), time.monotonic()) + self.job_s * len(words)
            heapq.heappush(self.free, ends)
            self.number += 1
            heapq.heappush(self.due, (ends, self.number, words, future))
            self.wakes.notify()
        return future

    def _answer(self) -> None:
        while not self.ended:
            with self.wakes:
                left = self.due[0][0] - time.monotonic() if self.due else 1.0
                if left > 0.0:
                    self.wakes.wait(left)
                    continue
                _, _, words, future = heapq.heappop(self.due)
            future.set_running_or_notify_cancel()
            lines = [ROW.replace("RUN", one[0]).replace("KEY", words_key(one)) for one in words]
            future.set_result("\n".join([*lines, json.dumps({"end": self.job_s * len(words)})]))


class Workers(Engine):
    """As the engines that come with the program: chunks of half a minute."""

    def __init__(self, width: int, job_s: float) -> None:
        self.width, self.job_s, self.processes, self.chunk_s = width, job_s, 1, 30.0

    def open(self) -> Executor:
        self.executor = Waiting(self.width, self.job_s)
        return self.executor

    def close(self, now: bool) -> None:
        self.executor.ended = True


def measured(workers: int, job_s: float) -> tuple[int, float, float]:
    """Jobs, seconds from the first to the last, the driver's processor seconds."""
    count = max(20, min(MOST_JOBS, int(workers * LASTS_S / job_s)))
    with tempfile.TemporaryDirectory() as folder:
        chunk = Chunk([], [], {"timeout_s": 3600.0}, "none", folder, "", folder)
        driver = Driver(Workers(workers, job_s), chunk, Keeper(Path(folder), "none"), Outcome(), told=lambda status: None,
                        total=count)
        began, cpu_s = time.monotonic(), time.thread_time()
        driver.run(iter([[f"seed={number}"] for number in range(count)]))
        driver.keeper.close()
        assert driver.outcome.counts == {"ok": count}
        return count, time.monotonic() - began, time.thread_time() - cpu_s


def main(job_s: float) -> None:
    """The table."""
    print(f"jobs of {job_s:g} s")
    print("workers      jobs   seconds  jobs a second  of the ideal  driver, ms CPU a job  driver busy")
    for workers in WORKERS:
        count, took_s, cpu_s = measured(workers, job_s)
        print(f"{workers:7d}{count:10d}{took_s:10.1f}{count / took_s:15.1f}{count * job_s / workers / took_s:14.2f}"
              f"{1e3 * cpu_s / count:21.3f}{cpu_s / took_s:13.2f}", flush=True)


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 0.026)
