"""A planning sweep of 100 jobs in which one goes out of its way to harm the others: the other 99 end well.

python tests/benchmarks/hundred_jobs.py [JOBS]        one sweep per way of harming; prints a line each
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from installing import FAKES, environment

from rhs.runfolder.row import read_row

HOSTILE = Path(__file__).resolve().parents[1] / "faults" / "hostile.py"
# how one planner behaves in the run with seed 7 -> what becomes of that job
HARMS = {
    "remove_folder": "failed",
    "os_exit": "failed",
    "thread": "ok",
    "child": "ok",
    "memory": "killed",
    "forever": "timeout",
}


def sweep(folder: Path, how: str, jobs: int) -> tuple[int, dict[str, str], float]:
    """Exit code, job -> status, and seconds of a sweep of so many jobs, one of which is hostile."""
    words = [
        "-m",
        "--plugin",
        str(HOSTILE),
        "task=planning",
        "world=map1",
        "planner=hostile",
        f"planner.how={how}",
        "planner.only_seed=7",
        f"seed=range({jobs})",
        f"output={how}",
        "recording=off",
        "--jobs",
        "2",
        "--timeout",
        "20",
        "--memory-mb",
        "1000",
    ]
    began_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES), capture_output=True, text=True
    )
    rows = {path.parent.name: read_row(path) for path in (folder / how).glob("*/row.json")}
    told = json.loads((folder / how / "jobs.json").read_text())
    assert told == {name: row["status"] for name, row in rows.items()}, done.stderr
    return done.returncode, told, time.monotonic() - began_s


def others(told: dict[str, str]) -> list[str]:
    """Statuses of the jobs that are not hostile."""
    return [status for name, status in told.items() if not name.startswith("seed=7_")]


@pytest.mark.benchmark
@pytest.mark.parametrize("how", HARMS)
def test_one_of_a_hundred_never_stops_the_other_99(tmp_path, how):
    _, told, _ = sweep(tmp_path, how, 100)
    assert others(told) == ["ok"] * 99
    assert [status for name, status in told.items() if name.startswith("seed=7_")] == [HARMS[how]]


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    count = int((sys.argv[1:2] or ["100"])[0])
    with tempfile.TemporaryDirectory() as place:
        for harm in HARMS:
            code, told, seconds = sweep(Path(place), harm, count)
            mine = next(status for name, status in told.items() if name.startswith("seed=7_"))
            print(
                f"{harm:<14} {others(told).count('ok'):>4} of {count - 1} others ok, the hostile one {mine}, exit {code}, "
                f"{seconds:.0f} s",
                flush=True,
            )
