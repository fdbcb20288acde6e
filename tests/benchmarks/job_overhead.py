"""CPU of one planning job of a sweep beside the planning itself: `python tests/benchmarks/job_overhead.py [N]`.

As in a sweep: a process that has loaded what jobs need forks one for each job. Printed: median and 90th percentile over N
jobs (30) of the CPU seconds from the fork to the row, less what the planner was timed at."""

from __future__ import annotations

import importlib
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rhs.config.compose import compose_config, from_plain, to_plain
from rhs.patrol.run import run_config
from rhs.sweeps.jobs import PRELOAD, SWEEP_PATH, Job, asked_for


def overhead_s(values: dict, reading: int, writing: int) -> float:
    """CPU of one job in a forked process, seconds."""
    pid = os.fork()
    if pid == 0:
        with tempfile.TemporaryDirectory() as folder:
            begun = time.process_time()
            row = run_config(replace(from_plain(values), recording="light", pictures="off"), Path(folder))
            spent = time.process_time() - begun - 1e-3 * (row["plan_ms"] + row["plan_again_ms"])
        os.write(writing, f"{spent:.6f}\n".encode())
        os._exit(0)
    os.waitpid(pid, 0)
    return float(os.read(reading, 64))


def main() -> None:
    """Measure and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    os.environ[SWEEP_PATH] = os.pathsep.join(sys.path)
    values = to_plain(compose_config(["task=planning", "world=map1", "planner=astar"]))
    for name in [*PRELOAD, *asked_for([Job("job_0", from_plain(values), ())])]:
        importlib.import_module(name)
    ends = os.pipe()
    spent = [overhead_s(values, *ends) for _ in range(count)]
    print(f"CPU of a planning job beside planning: median {np.median(spent):.3f} s, 90 % below "
          f"{np.quantile(spent, 0.9):.3f} s (n = {count}, world=map1 planner=astar)")


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    main()
