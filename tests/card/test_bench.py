"""The frozen benchmark: its questions stay, its rows hold no time, its scores are those that can be computed by hand."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from rhs.api.errors import ConfigError
from rhs.card import bench
from rhs.card.forked import ForkResult
from rhs.cli.bench import main
from rhs.config import registry


def row(solved: int, above: str, *, solvable: int = 1, fault: str = "", ms: float = 1.0) -> bench.Row:
    return bench.Row(("mine", "q", "0", str(solvable), str(solved), "ok", fault, "1", "", "", above, above), ms)


def test_the_questions_are_those_of_version_one():
    """Whoever changes them makes another version."""
    asked = bench.frozen_questions()
    assert len(asked) == 60 and bench.digest(asked) == bench.FROZEN
    large = next(one for one in asked if one.name.startswith("large closed") and one.optimal_m == one.optimal_m)
    assert bench.exact_m(large.problem) == pytest.approx(large.optimal_m)  # in finer cells the way is as long


def test_scores_by_hand():
    result = ForkResult([row(1, "0"), row(1, "50"), row(1, "150"), row(0, "", fault="cuts_corners"), row(0, "", solvable=0)])
    found = bench.scores(result, 5)
    assert found["solved_share"] == 0.75 and found["wrong_share"] == 0.2
    assert found["above_par2_pct"] == (0 + 50 + 200 + 200) / 4
    assert found["above_pct"] == pytest.approx(200 / 3)


def test_a_title_with_a_comma_is_one_cell():
    """Of a part whose setting is a list: `--mine planner=mine planner.weights=[1,2]`."""
    cells = ("mine planner.weights=[1,2]", *["1"] * (len(bench.ROW) - 1))
    text = bench.csv_of([bench.Row(cells, 1.0)])
    assert text.splitlines()[0] == ",".join(bench.ROW) and next(csv.reader(text.splitlines()[1:])) == list(cells)


def test_the_rows_of_a_planner_are_the_same_again_whatever_it_took(monkeypatch, tmp_path):
    few = bench.frozen_questions()[:6]
    settings = registry.load("planner", "prm")()
    first, again = (list(bench.work("prm", settings, few)) for _ in range(2))
    assert len(first) == 6 * len(bench.SEEDS) and bench.csv_of(first) == bench.csv_of(again)
    assert "_ms" not in bench.csv_of(first)
    page = bench.page({"prm": ForkResult(first)}, len(first), command="bench", made_at="abc")
    assert f"| prm | 1 | 0 | {bench.scores(ForkResult(first), len(first))['above_par2_pct']:.4g} |" in page
    assert bench.hash_of(first) in page and "commit abc" in page


PUBLISHED = (Path(__file__).parents[2] / "results" / "bench" / "planning-v1.csv").read_text().splitlines()[1:]
SLOW = {"bit_star": 12, "fmt": 3, "informed_rrt_star": 30, "rrt_star": 30}  # of these each so many-th question


@pytest.mark.parametrize("name", sorted({line.split(",")[0] for line in PUBLISHED}))
def test_the_published_table_is_what_the_planners_answer_now(name, tmp_path):
    """Whoever changes a planner makes its rows again: python -m rhs bench planning-v1 --mine planner=NAME --only."""
    settings, seed = registry.load("planner", name)(), bench.SEEDS[0]
    asked = bench.frozen_questions()[:: SLOW.get(name, 1)]
    found = [bench.row_of(name, one, seed, bench.ask(settings, one, tmp_path, seed=seed)).cells for one in asked]
    told = {tuple(line.split(",")[:3]): line for line in PUBLISHED}
    assert [",".join(row) for row in found] == [told[row[:3]] for row in found]


def test_the_command_makes_a_table_of_mine_alone(monkeypatch, tmp_path, capsys):
    few = bench.frozen_questions()[:2]
    monkeypatch.setattr(bench, "frozen_questions", lambda: few)
    monkeypatch.setattr(bench, "FROZEN", bench.digest(few))
    assert main(["planning-v1", "--mine", "planner=astar", "--only", f"output={tmp_path}"]) == 0
    rows = (tmp_path / "planning-v1.csv").read_text().splitlines()
    assert len(rows) == 1 + 2 * len(bench.SEEDS) and rows[0] == ",".join(bench.ROW)
    said = capsys.readouterr().out
    assert "| astar | 1 | 0 |" in said and (tmp_path / "planning-v1.md").read_text() in said


@pytest.mark.parametrize(("words", "says"), [
    (["planning-v2"], "there is planning-v1"), (["planning-v1", "planner=prm"], "say whose: --mine"),
    (["planning-v1", "--only"], "say whose"), (["planning-v1", "--mine", "planner=prn"], "there is no such planner"),
    (["planning-v1", "--mine", "odometry=wheel"], "expected planner=NAME")])
def test_what_is_no_benchmark_is_refused_in_one_line(words, says):
    with pytest.raises(ConfigError, match=says):
        main(words)
