"""Planning runs as OMPL's benchmark log, which Planner Arena shows: `python -m rhs.planner_arena FOLDER... --log DIR`.

One log per map and problem (an experiment of OMPL's), one entry per planner and its settings, one line per run.
Turn the logs into the database that planner-arena.org opens by
`python -m ompl.ompl_benchmark_statistics DIR/*.log -d benchmark.db`.
"""

from __future__ import annotations

import platform
import re
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from rhs.base.commands import Arguments, answered
from rhs.base.errors import ConfigError

from .export import write_text
from .planning_table import Group, groups
from .table import some_rows, tell_unreadable

if TYPE_CHECKING:
    import pandas

# OMPL's name and type -> our column and factor
PROPERTIES = (
    ("correct solution BOOLEAN", "success", 1.0), ("learning time REAL", "plan_learn_ms_", 1e-3),
    ("second query time REAL", "plan_again_ms_", 1e-3),
    ("simplified solution clearance REAL", "plan_clearance_min_m", 1.0),
    ("simplified solution length REAL", "plan_length_m", 1.0),
    ("simplified solution smoothness REAL", "plan_smoothness", 1.0),
    ("solution above optimum percent REAL", "plan_above_optimum_pct", 1.0),
    ("solution clearance REAL", "plan_clearance_raw_min_m", 1.0), ("solution length REAL", "plan_length_raw_m", 1.0),
    ("solved BOOLEAN", "success", 1.0), ("time REAL", "plan_ms_", 1e-3),
)
# The words OMPL writes, in its order; a plan's reason as one of them.
STATUS = ("Unknown status", "Invalid start", "Invalid goal", "Unrecognized goal type", "Timeout", "Approximate solution",
          "Exact solution", "Crash")
REASONS = {"ok": 6, "start_blocked": 1, "goal_blocked": 2, "outside_map": 1, "disconnected": 4, "budget_spent": 4}


def write_logs(table: pandas.DataFrame, folder: FilePath) -> list[FilePath]:
    """One benchmark log per world and problem of the table, in `folder`; the files written."""
    experiments: dict[tuple[str, str], list[Group]] = {}
    for group in groups(table):
        for problem in sorted(set(group.rows["problem_"])):
            mine = group._replace(problem=problem, rows=group.rows[group.rows["problem_"] == problem])
            experiments.setdefault((group.place, problem), []).append(mine)
    if not experiments:
        raise ConfigError("no planning runs in these folders; make some by python -m rhs -m task=planning planner=glob(*)")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for (world, problem), found in experiments.items():
        name = f"{FilePath(world).stem} {problem}".strip()
        path = folder / f"{re.sub(r'[^A-Za-z0-9._-]+', '_', name).strip('_')[:120]}.log"
        write_text(path, log_text(name, world, found))
        written.append(path)
    return written


def log_text(name: str, world: str, found: Sequence[Group]) -> str:
    """The log of one problem on one map."""
    seconds = sum(float(group.rows["wall_ms"].astype("float64").sum()) for group in found) / 1e3
    runs = max(len(group.rows) for group in found)
    lines = [f"OMPL version {version('ompl')}", f"Experiment {name}", "0 experiment properties",
             f"Running on {platform.node() or 'unknown'}", f"Starting at {time.strftime('%Y-%m-%d %H:%M:%S')}",
             "<<<|", f"planned by rhs {version('rhs')} on the map {world}; times are CPU seconds", "|>>>",
             "<<<|", platform.processor() or platform.machine(), "|>>>", "0 is the random seed", "0 seconds per run",
             "0 MB per run", f"{runs} runs per planner", f"{seconds:g} seconds spent to collect the data", "1 enum type",
             "|".join(("status", *STATUS)), f"{len(found)} planners"]
    for group in found:
        lines += _planner(group.who, group.rows.sort_values("seed"))
    return "\n".join(lines) + "\n"


def _planner(name: str, part: pandas.DataFrame) -> list[str]:
    lines = [name, "0 common properties", f"{len(PROPERTIES) + 1} properties for each run"]
    lines += [*(label for label, _, _ in PROPERTIES), "status ENUM", f"{len(part)} runs"]
    for _, row in part.iterrows():
        values = [_value(row.get(column), factor) for _, column, factor in PROPERTIES]
        lines.append("; ".join([*values, str(_status(row))]) + "; ")
    return [*lines, "."]


def _status(row: pandas.Series) -> int:
    """The number of OMPL's word; an invalid path is no solution, whatever its planner says."""
    if row["reason_"] == "invalid path":
        return 0
    return REASONS.get(str(row.get("plan_reason")), 7)


def _value(value: object, factor: float) -> str:
    """A number; empty for unknown, as OMPL writes it."""
    import pandas as pd

    if value is None or value is pd.NA or value != value:
        return ""
    return f"{float(value) * factor:.9g}"  # type: ignore[arg-type]


def main(words: Sequence[str] | None = None) -> int:
    """The command. Exit code 0; 2 refused; 3 when a row could not be read."""
    parser = Arguments(prog="python -m rhs.planner_arena", description="Planning runs as OMPL benchmark logs.")
    parser.add_argument("folders", nargs="+", type=FilePath, help="run or sweep folders, searched through")
    parser.add_argument("--log", type=FilePath, required=True, help="folder for the logs, one per map and problem")

    def work() -> int:
        chosen, unreadable = parser.parse_args(words), []  # type: ignore[var-annotated]
        table = some_rows(chosen.folders, unreadable)
        written = write_logs(table, chosen.log)
        sys.stdout.write("\n".join(map(str, written)) + "\n")
        return tell_unreadable(unreadable)

    return answered(work)
