"""What numba compiles is no time of planning."""

import json
import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs_tasks.planning.asking import ask_twice


def test_a_planner_that_compiles_at_its_first_question_is_asked_anew():
    @numba.njit
    def walk(blocked):
        total = 0
        for j in range(blocked.shape[0]):
            for i in range(blocked.shape[1]):
                total += blocked[j, i]
        return total

    built = []

    class Planner:
        def plan(self, problem):
            walk(problem.blocked)
            return Path(PlanReason.OK, np.array([problem.start_m, problem.goal_m]))

    def build(rng):
        built.append(rng)
        return Planner()

    problem = PlanningProblem(np.zeros((50, 50), bool), 0.1, (0.0, 0.0), np.array([1.0, 1.0]), np.array([4.0, 4.0]))
    first, again = ask_twice(build, problem, lambda: np.random.default_rng(3))
    assert len(built) == 2  # compiling alone takes a tenth of a second and more
    assert max(first.cpu_ms, first.wall_ms, again.cpu_ms) < 50.0
    assert ask_twice(build, problem, lambda: np.random.default_rng(3)) and len(built) == 3


@pytest.mark.slow
def test_no_time_of_a_run_on_an_empty_cache_is_compiling(tmp_path):
    words = [sys.executable, "-m", "rhs", "task=planning", "world=map2", f"output={tmp_path / 'run'}", "overwrite=true"]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for name in ("prm", "fast_marching", "prm"):  # from nothing, then from what was compiled
        subprocess.run([*words, f"planner={name}"], check=True, env=environment, capture_output=True, timeout=600)
        row = json.loads((tmp_path / "run" / "row.json").read_text())
        for column in ("plan_ms", "plan_wall_ms", "plan_again_ms", "plan_learn_ms"):
            assert row[column] < 100.0, (column, row[column])
