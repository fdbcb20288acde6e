"""`python -m rhs table` over a large sweep: seconds of the command, from shards and from Parquet.

    python tests/benchmarks/big_table.py [ROWS] [COLUMNS] [SWEEP]       100000 rows, 80 columns

The input is made, not run: the rows of a real sweep whose rows lie in shards (SWEEP; else 40 planning jobs are run) are
repeated with seeds, hashes and names of their own, each float multiplied by a random factor of about 1 and the columns
filled up with such floats. The command is the user's, in a process of its own. Printed: CPU and wall seconds of it with
the rows in shards, then with the Parquet file that a sweep's end writes, and whether both read back equal.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rhs.reports.table import _row_by_row, rows
from rhs.runfolder.shards import Line, Shard, read_lines, shards

WORDS = ["task=planning", "world=map1", "planner=astar,prm,rrt,theta_star", "seed=range(10)", "keep=none"]


def command(*words: str) -> tuple[float, float, str]:
    """CPU seconds, wall seconds and what is printed of `python -m rhs ...`."""
    before, begin = os.times(), time.monotonic()
    done = subprocess.run([sys.executable, "-m", "rhs", *words], stdout=subprocess.PIPE, text=True, check=True)
    now = os.times()
    return now[2] + now[3] - before[2] - before[3], time.monotonic() - begin, done.stdout


def multiply(found: list[Line], sweep: Path, count: int, columns: int) -> None:
    """Write `count` rows like those found into shards of 20,000."""
    rng, shard = random.Random(0), Shard(sweep)
    (sweep / "sweep.json").write_text("{}")
    for number in range(count):
        if number % 20_000 == 0:
            shard.close()
            time.sleep(0.002)  # its name holds the time
            shard = Shard(sweep)
        like = found[number % len(found)]
        row = {name: value * rng.lognormvariate(0.0, 0.1) if isinstance(value, float) and name != "success" else value
               for name, value in like.row.items()}
        row |= {f"mine_{place}": rng.gauss(0.0, 1.0) for place in range(columns - len(row))}
        row |= {"seed": number, "config_hash": f"{number:010x}"}
        shard.add(Line(f"seed={number}_{number:010x}", f"{number:012x}", like.set, row).text())
    shard.close()


def main(count: int, columns: int, real: Path | None) -> None:
    """Make the input, time the command."""
    with tempfile.TemporaryDirectory() as home:
        if real is None:
            real = Path(home, "real")
            command("-m", *WORDS, f"output={real}", "--jobs", "1")
        sweep = Path(home, "sweep")
        sweep.mkdir()
        multiply(list(read_lines(shards(real), []).values()), sweep, count, columns)
        size = sum(path.stat().st_size for path in shards(sweep)) / 1e6
        for what in ("shards, Parquet written", "Parquet"):
            cpu_s, wall_s, told = command("table", str(sweep))
            table = rows([sweep])
            print(f"rhs table of {len(table)} rows x {len(table.columns)} columns, {what}: {cpu_s:.1f} s CPU, "
                  f"{wall_s:.1f} s wall ({size:.0f} MB of shards)", flush=True)
            if what != "Parquet":
                first, told_first = _row_by_row([sweep], []), told
        print(f"equal: table {first.equals(table)}, types {first.dtypes.equals(table.dtypes)}, text {told == told_first}")
        print(json.dumps(told.splitlines()[-6:], indent=1))


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    named = [Path(word) for word in sys.argv[1:] if not word.isdigit()]
    main(*(numbers + [100_000, 80][len(numbers):]), real=named[0] if named else None)
