"""Planning runs as OMPL's benchmark log, which Planner Arena shows: `python -m rhs.planner_arena FOLDER... --log DIR`.

One log per map (an experiment of OMPL's), one planner entry per planner, one line per run. Turn the logs into the
database that planner-arena.org opens by `python -m ompl.ompl_benchmark_statistics DIR/*.log -d benchmark.db`.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from rhs.api.files import replacing
from rhs.base.errors import ConfigError, RhsError

from .planning_table import order, planning_rows
from .table import rows

if TYPE_CHECKING:
    import pandas

# OMPL's name and type -> our column and factor
PROPERTIES = (
    ("correct solution BOOLEAN", "plan_valid", 1.0), ("learning time REAL", "plan_learn_ms", 1e-3),
    ("second query time REAL", "plan_again_ms", 1e-3),
    ("simplified solution clearance REAL", "plan_clearance_min_m", 1.0),
    ("simplified solution length REAL", "plan_length_m", 1.0),
    ("simplified solution smoothness REAL", "plan_smoothness", 1.0),
    ("solution above optimum percent REAL", "plan_above_optimum_pct", 1.0),
    ("solution clearance REAL", "plan_clearance_raw_min_m", 1.0), ("solution length REAL", "plan_length_raw_m", 1.0),
    ("solved BOOLEAN", "plan_success", 1.0), ("time REAL", "plan_ms", 1e-3),
)
# The words OMPL writes, in its order; a plan's reason as one of them.
STATUS = ("Unknown status", "Invalid start", "Invalid goal", "Unrecognized goal type", "Timeout", "Approximate solution",
          "Exact solution", "Crash")
REASONS = {"ok": 6, "start_blocked": 1, "goal_blocked": 2, "outside_map": 1, "disconnected": 4, "budget_spent": 4}


def write_logs(table: pandas.DataFrame, folder: FilePath) -> list[FilePath]:
    """One benchmark log per world of the table, in `folder`; the files written."""
    found = planning_rows(table)
    if not len(found):
        raise ConfigError("no planning runs in these folders; make some by python -m rhs -m task=planning planner=glob(*)")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for world in sorted(found["world"].unique()):
        path = folder / f"{FilePath(world).stem}.log"
        with replacing(path) as file:
            file.write(log_text(world, found[found["world"] == world]))
        written.append(path)
    return written


def log_text(world: str, part: pandas.DataFrame) -> str:
    """The log of one map."""
    from importlib.metadata import version

    planners = order(part["planner"].unique())
    seconds = float(part["wall_ms"].astype("float64").sum()) / 1e3
    runs = max(int((part["planner"] == name).sum()) for name in planners)
    lines = [f"OMPL version {version('ompl')}", f"Experiment {FilePath(world).stem}", "0 experiment properties",
             f"Running on {platform.node() or 'unknown'}", f"Starting at {time.strftime('%Y-%m-%d %H:%M:%S')}",
             "<<<|", f"planned by rhs {version('rhs')} on the map {world}; times are CPU seconds", "|>>>",
             "<<<|", platform.processor() or platform.machine(), "|>>>", "0 is the random seed", "0 seconds per run",
             "0 MB per run", f"{runs} runs per planner", f"{seconds:g} seconds spent to collect the data", "1 enum type",
             "|".join(("status", *STATUS)), f"{len(planners)} planners"]
    for name in planners:
        lines += _planner(name, part[part["planner"] == name].sort_values("seed"))
    return "\n".join(lines) + "\n"


def _planner(name: str, part: pandas.DataFrame) -> list[str]:
    lines = [name, "0 common properties", f"{len(PROPERTIES) + 1} properties for each run"]
    lines += [*(label for label, _, _ in PROPERTIES), "status ENUM", f"{len(part)} runs"]
    for _, row in part.iterrows():
        values = [_value(row.get(column), factor) for _, column, factor in PROPERTIES]
        lines.append("; ".join([*values, str(REASONS.get(str(row.get("plan_reason")), 7))]) + "; ")
    return [*lines, "."]


def _value(value: object, factor: float) -> str:
    """A number; empty for unknown, as OMPL writes it."""
    import pandas as pd

    if value is None or value is pd.NA or value != value:
        return ""
    return f"{float(value) * factor:.9g}"  # type: ignore[arg-type]


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m rhs.planner_arena", description="Planning runs as OMPL benchmark logs.")
    parser.add_argument("folders", nargs="+", type=FilePath, help="run or sweep folders, searched through")
    parser.add_argument("--log", type=FilePath, required=True, help="folder for the logs, one per map")
    chosen = parser.parse_args(words)
    try:
        written = write_logs(rows(chosen.folders), chosen.log)
    except RhsError as error:
        sys.stderr.write(f"rhs: {error}\n")
        return error.exit_code
    sys.stdout.write("\n".join(map(str, written)) + "\n")
    return 0
