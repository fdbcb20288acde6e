"""The planning table and OMPL's log: averages beside n and failures, nothing dropped; OMPL reads what we wrote."""

import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.reports.arena_log import write_logs
from rhs.reports.export import as_markdown
from rhs.reports.planning_table import planning_rows, planning_table
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


def scenario(number, octile, planner, length_m, **more):
    return row(planner, 0, length_m, world="arena2.map.scen", octile_claimed_m=octile, plan_optimal_m=octile,
               **{"planning.scenario": number, "config_hash": f"{planner}{number}", **more})


@pytest.fixture
def scen():
    """Two problems in bucket 2, one in bucket 10; rrt fails one of bucket 2, the longer."""
    rows = [scenario(1, 8.5, "astar", 8.5), scenario(2, 11.9, "astar", 11.9), scenario(3, 40.0, "astar", 40.0),
            scenario(1, 8.5, "rrt", 9.0), scenario(2, 11.9, "rrt", np.nan), scenario(3, 40.0, "rrt", 44.0)]
    for one in rows:
        one["plan_above_optimum_pct"] = 100.0 * (one["plan_length_m"] / one["plan_optimal_m"] - 1.0)
    return frame({str(k): one for k, one in enumerate(rows)})


def test_problems_of_a_scenario_file_stand_by_bucket(scen):
    summary = planning_table(scen)
    assert list(summary["problem"]) == ["bucket 2", "bucket 2", "bucket 10", "bucket 10"]
    lines = summary.set_index(["problem", "planner"])
    assert lines.loc[("bucket 2", "astar"), "optimum, cells"] == "85.00 to 119.00"
    assert lines.loc[("bucket 10", "rrt"), "length, cells"] == "440" and lines.loc[("bucket 10", "rrt"), "failed"] == 0


def test_scores_do_not_favour_who_fails(scen):
    """rrt's mean length in bucket 2 is shorter for having failed the longer problem; what both solved says otherwise."""
    lines = planning_table(scen).set_index(["problem", "planner"]).loc["bucket 2"]
    assert float(lines.loc["rrt", "length, cells"].split()[0]) < float(lines.loc["astar", "length, cells"].split()[0])
    assert (lines["solved by all"] == 1).all()
    assert (lines.loc["astar", "above optimum %, those"], lines.loc["rrt", "above optimum %, those"]) == ("0", "5.882")
    assert lines.loc["astar", "SPL"] == "1" and lines.loc["rrt", "SPL"] == "0.4722 (0 to 0.9444)"
    assert lines.loc["rrt", "PAR-2 ms"] == "3 (2 to 4)" and lines.loc["astar", "PAR-2 ms"] == "2"


def test_problems_and_settings_are_not_pooled():
    rows = [row("rrt", seed, 20.0 + seed + shift, start=start, **{"planner.step_m": step})
            for seed in range(3) for shift, start in ((0, "[1, 1]"), (9, "[2, 2]")) for step in (0.1, 0.5)]
    summary = planning_table(frame({str(k): one for k, one in enumerate(rows)}))
    assert list(zip(summary["problem"], summary["settings"], strict=True)) == [
        ("start=[1, 1]", "step_m=0.1"), ("start=[1, 1]", "step_m=0.5"), ("start=[2, 2]", "step_m=0.1"),
        ("start=[2, 2]", "step_m=0.5")]
    assert (summary["n"] == 3).all()


def test_an_invalid_path_is_a_failure_in_the_table():
    rows = [row("rrt", 0, 20.0), row("rrt", 1, 1.0, plan_valid=0.0), row("rrt", 2, 22.0)]
    line = planning_table(frame({str(k): one for k, one in enumerate(rows)})).iloc[0]
    assert (line["failed"], line["invalid"], line["reasons"]) == (1, 1, "invalid path 1")
    assert line["success %"].startswith("67 ") and line["length, cells"] == "210 (200 to 220)"


def test_a_planner_without_randomness_has_one_run(table):
    line = planning_table(table).set_index("planner").loc["astar"]
    assert (line["n"], line["independent"], line["success %"], line["length, cells"]) == (2, 1, "100", "200")


def test_one_log_per_problem(scen, tmp_path):
    assert [path.stem for path in write_logs(scen, tmp_path)] == [f"arena2.map_scenario_{k}" for k in (1, 2, 3)]
    two = (tmp_path / "arena2.map_scenario_2.log").read_text()
    assert two.count(" runs\n") == 2 and "0; 0.002; 4; " in two  # the failure: not solved, its time, a timeout


def test_bars_go_by_problem_and_stop_where_there_are_too_many(scen, tmp_path):
    from rhs.reports.planning_table import draw_bars

    assert len(draw_bars(scen, tmp_path)) == 4
    many = frame({str(k): scenario(k, 4.0 * k + 1, "astar", 10.0) for k in range(14)})
    assert draw_bars(many, tmp_path) == []
