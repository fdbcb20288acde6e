"""The planning commands of the README, run as they are written; only the sweeps are given fewer jobs."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from rhs.api.grid import OccupancyGrid
from rhs.api.randomness import generator
from rhs.cli.main import main
from rhs.config import registry
from rhs.estimation.paths.shorten import shortened
from rhs.reports import arena_log as planner_arena
from rhs.reports.planning_table import planning_table
from rhs.reports.table import main as table_main
from rhs.reports.table import rows
from rhs.runfolder.row import read_row
from rhs.worlds.maps import save_map
from rhs.worlds.plan_files import read_plan
from rhs.worlds.planning_question import load_arena
from rhs_tasks.planning.task import context_of

README = Path(__file__).resolve().parents[2] / "plugins" / "rhs_planners" / "README.md"
FEWER = {"experiment=table_3_1": ["world=map2", "seed=3"]}  # added to a command: every planner, once
NAMES = registry.names("planner")
SMALLER = {"seed=range(10)": "seed=0", "planner=glob(*)": "planner=glob(prm*)"}  # in place of a word


def commands() -> list[list[str]]:
    """The lines of the first block under "Planners alone", as words after `python -m`."""
    text = README.read_text("utf-8").partition("## Planners alone")[2]
    block = re.findall(r"^```\n(.*?)^```", text, re.M | re.S)[0]
    return [shlex.split(line, comments=True)[2:] for line in block.splitlines() if line.startswith("python -m ")]


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with the files that the page supposes: a map of a hall with a pillar, and a MovingAI map with problems."""
    folder = tmp_path_factory.mktemp("desk")
    hall = np.zeros((60, 100), np.float32)
    hall[20:40, 40:50] = 1.0
    save_map(folder / "hall", OccupancyGrid(hall, 0.1, (0.0, 0.0)))
    (folder / "arena.map").write_text("type octile\nheight 4\nwidth 5\nmap\n..@..\n..@..\n..@..\n.....\n")
    problem = "0\tarena.map\t5\t4\t0\t0\t4\t0\t8.82842712\n"
    (folder / "arena.map.scen").write_text("version 1\n" + 8 * problem)
    return folder


@pytest.mark.slow
def test_the_planning_block_of_the_readme_runs(desk, monkeypatch, capfd):
    monkeypatch.chdir(desk)
    assert len(commands()) >= 5
    for module, *words in commands():
        words = [SMALLER.get(word, word) for word in words]
        for word in [word for word in words if word in FEWER]:
            words += FEWER[word]
        told = (planner_arena.main if module == "rhs.planner_arena" else main)(words)
        assert told == 0, f"{module} {' '.join(words)}: {capfd.readouterr().err[-2000:]}"
    found = [read_row(path) for path in desk.glob("results/**/row.json")]
    assert len(found) == len(NAMES) + 4 + 2
    assert {row["planner"] for row in found} == set(NAMES)
    assert all(row["plan_success"] == 1 and row["plan_valid"] == 1.0 for row in found)
    (claimed,) = [row for row in found if row["octile_claimed_m"] is not None]
    assert claimed["octile_claimed_m"] == 8.82842712 and claimed["plan_length_m"] <= 8.82842712
    _same_alone(desk)
    for sweep in (desk / "results/sweeps").iterdir():
        names = {path.name for path in sweep.iterdir()}
        assert {"planning_table.md", "planning_table.csv", "panel.png", "bars_plan_ms.png"} <= names
    assert {path.stem for path in (desk / "logs").iterdir()} == {"map1", "map2", "map4"}


def _same_alone(desk: Path) -> None:
    """Every path of the sweeps again, bit for bit, by a planner in this process that plans nothing else."""
    for folder in sorted(path.parent for path in desk.glob("results/sweeps/*/*/plan.json")):
        stored, problem, _ = read_plan(folder)
        row = read_row(folder / "row.json")
        arena, rng = load_arena(row["world"]), generator(int(row["seed"]), "planner")
        path = registry.load("planner", row["planner"])().build(context_of(arena, folder, rng)).plan(problem)
        path = shortened(path, problem)
        assert np.array_equal(path.points_m, stored.points_m) and np.array_equal(path.raw_m, stored.raw_m), folder.name


@pytest.mark.slow
def test_a_sweep_over_a_scenario_file_is_as_many_pairs_as_problems(tmp_path, capsys):
    """Real runs: three problems, two planners that both solve them; three pairs, a line per bucket, no significance."""
    (tmp_path / "hall.map").write_text("type octile\nheight 3\nwidth 40\nmap\n" + 3 * (40 * "." + "\n"))
    (tmp_path / "hall.map.scen").write_text("version 1\n" + "".join(
        f"{length // 4}\thall.map\t40\t3\t0\t1\t{length}\t1\t{length}\n" for length in (2, 9, 30)))
    for planner in ("astar", "rrt_connect"):
        for number in range(3):
            assert main(["task=planning", f"world={tmp_path / 'hall.map.scen'}", f"planner={planner}",
                         f"planning.scenario={number}", f"output={tmp_path / 'runs' / f'{planner}{number}'}"]) == 0
    capsys.readouterr()
    assert table_main([str(tmp_path / "runs"), "--compare", "planner", "--columns", "plan_ms"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^plan_ms +astar - rrt_connect +3 +3 +3 ", said, re.M) and "too few to reach" in said
    view = planning_table(rows([tmp_path / "runs"]))
    assert list(view["problem"]) == ["bucket 0", "bucket 0", "bucket 2", "bucket 2", "bucket 7", "bucket 7"]
