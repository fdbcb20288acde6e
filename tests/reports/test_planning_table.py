"""The planning table and OMPL's log: averages beside n and failures, nothing dropped; OMPL reads what we wrote."""

import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.reports.arena_log import write_logs
from rhs.reports.planning_table import as_markdown, planning_rows, planning_table
from rhs.reports.table import frame


def row(planner: str, seed: int, length_m: float = np.nan, world: str = "map1", **more) -> dict:
    found = int(np.isfinite(length_m))
    return {"status": "ok", "task": "planning", "world": world, "planner": planner, "seed": seed, "plan_success": found,
            "plan_valid": 1.0 if found else None, "plan_reason": "ok" if found else "budget_spent", "homotopy": "left",
            "plan_length_m": length_m, "plan_length_raw_m": 1.5 * length_m, "plan_optimal_m": 20.0, "map_resolution_m": 0.1,
            "plan_above_optimum_pct": 5.0 * (length_m - 20.0), "plan_ms": 2.0, "plan_learn_ms": 0.5, "plan_again_ms": 1.0,
            "plan_steps_raw": 100.0, "wall_ms": 1000.0, **more}


@pytest.fixture
def table():
    rows = [row("rrt", 0, 20.0), row("rrt", 1), row("rrt", 2, 22.0), row("astar", 0, 20.0), row("astar", 1, 20.0),
            {"status": "ok", "world": "square", "planner": "prm", "seed": 0}]
    return frame({str(k): one for k, one in enumerate(rows)})


def test_a_failure_lowers_one_planners_share_and_nobody_elses(table):
    summary = planning_table(table).set_index("planner")
    assert list(summary.index) == ["rrt", "astar"]  # the thesis's planners first
    assert (summary.loc["rrt", "n"], summary.loc["rrt", "failed"]) == (3, 1)
    assert summary.loc["rrt", "success %"] == "67 [9, 99]"  # Clopper and Pearson, 2 of 3
    assert summary.loc["rrt", "length, cells"] == "210 (200 to 220)"  # the mean of two, 0.1 m a cell, and their range
    assert summary.loc["rrt", "reasons"] == "budget_spent 1"
    assert (summary.loc["astar", "n"], summary.loc["astar", "failed"]) == (2, 0)


def test_the_thesis_stands_beside_what_it_measured(table):
    summary = planning_table(table).set_index("planner")
    assert tuple(summary.loc["rrt", ["thesis cells", "thesis s", "thesis success %"]]) == ("328.3", "4.8", "100")
    assert summary.loc["astar", "thesis cells"] == ""
    assert "| map1 | rrt | 3 | 1 |" in as_markdown(planning_table(table))


def test_patrols_are_no_planning_rows(table):
    assert len(planning_rows(table)) == 5
    with pytest.raises(ConfigError, match="no planning runs"):
        write_logs(table[table["world"] == "square"], None)


def test_ompl_reads_the_log_and_finds_the_same_numbers(table, tmp_path):
    (log,) = write_logs(table, tmp_path)
    database = tmp_path / "b.db"
    code = f"from ompl import tools; tools.readBenchmarkLog({str(database)!r}, [{str(log)!r}], False)"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, timeout=60)
    runs = sqlite3.connect(database).execute(
        "select p.name, r.solved, r.time, r.simplified_solution_length from runs r join plannerConfigs p "
        "on p.id = r.plannerid order by r.id").fetchall()
    assert runs == [("rrt", 1, 0.002, 20.0), ("rrt", 0, 0.002, None), ("rrt", 1, 0.002, 22.0), ("astar", 1, 0.002, 20.0),
                    ("astar", 1, 0.002, 20.0)]
