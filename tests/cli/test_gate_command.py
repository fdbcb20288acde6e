"""`python -m rhs gate` from end to end, and what it refuses."""

import json
import math
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from rhs.cli.arguments import going_on
from rhs.cli.gate import _compared, _pairs, in_words, measured, rank
from rhs.cli.main import main
from rhs.reports.gate import judge
from rhs.runfolder.row import read_row, write_row


@pytest.fixture(scope="module")
def baseline(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gate") / "old"
    assert main(["-m", "task=planning", "world=map1", "planner=rrt_connect", "seed=range(6)", f"output={folder}"]) == 0
    return folder


def test_a_shorter_planner_is_better_and_a_longer_one_worse(baseline, tmp_path, capsys):
    assert main(["gate", str(baseline), "planner=theta_star", "--measure", "plan_length_raw_m",
                 f"output={tmp_path / 'new'}"]) == 0
    told = capsys.readouterr().out
    assert told.startswith("better: plan_length_raw_m -") and "successes lost 0, won 0" in told
    kept = json.loads((tmp_path / "new" / "gate.json").read_text())
    assert kept["word"] == "better" and kept["pairs"] <= 6
    assert main(["gate", str(tmp_path / "new"), "planner=rrt_connect", "--measure", "plan_length_raw_m",
                 f"output={tmp_path / 'back'}"]) == 1
    assert capsys.readouterr().out.startswith("worse: plan_length_raw_m +")


@pytest.mark.parametrize(("words", "says"), [
    ([], "expected one folder"), (["planner=prm"], "expected one folder"), (["FOLDER"], "expected one folder"),
    (["FOLDER", "planner=rrt_connect"], "changes nothing"), (["FOLDER", "planner=no_such"], "no such planner"),
    (["FOLDER", "planner=prm", "--pairs", "1"], "--pairs"),
    (["FOLDER", "planner=prm", "--measure", "plan_lenght_m"], "no run of .* has such a figure; did you mean plan_length_m"),
    (["FOLDER", "planner=prm", "seed=3"], "seed=3 is another question"), (["FOLDER", "world=map2"], "is another question")])
def test_what_cannot_be_gated_is_one_line(baseline, words, says, capsys):
    assert main(["gate", *(word.replace("FOLDER", str(baseline)) for word in words)]) == 2
    told = capsys.readouterr().err
    assert re.search(says, told) and told.count("\n") == 1


@pytest.mark.parametrize(("status", "success", "code", "says"), [
    ("failed", 0.0, 1, "worse: ate_rmse_m is known in 0 pairs; successes lost 9, won 0"),
    ("ok", 0.0, 0, "better: ate_rmse_m -90 %"), ("ok", 1.0, 0, "better: ate_rmse_m -90 %")])
def test_a_run_that_broke_off_is_no_better_for_the_short_way_it_went(tmp_path, monkeypatch, status, success, code, says):
    """Of old runs that did not achieve their mission either, so that no success is lost."""
    row = {"status": status, "reason": "of mine", "success": success, "ate_rmse_m": 0.1}
    monkeypatch.setattr("rhs.cli.gate.kept_rows", lambda jobs, folder, limits, tell: [row] * len(jobs))
    pairs = [({"status": "ok", "success": 0.0, "ate_rmse_m": 1.0}, SimpleNamespace(name=f"job{k}")) for k in range(9)]
    found, broken = _compared(pairs, tmp_path, None, "ate_rmse_m", 0.02, 0.2)
    assert found.exit_code == code and in_words(found, "ate_rmse_m", 0.02).startswith(says)
    assert broken == (["new runs: 9 of 9 broke off, most by: of mine"] if status == "failed" else [])


def test_a_gate_that_was_stopped_goes_on_in_its_folder(baseline, tmp_path, capsys):
    words = ["gate", str(baseline), "planner=theta_star", f"output={tmp_path / 'new'}"]
    code, told = main(words), capsys.readouterr().out
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "new").glob("*/row.json")}
    first = min(kept)
    shutil.rmtree(first.parent)
    assert main(words) == code and capsys.readouterr().out == told
    assert [path for path, when in kept.items() if path.stat().st_mtime_ns != when] == [first]


def test_two_old_runs_that_become_one_and_a_row_that_cannot_be_read_are_refused(baseline, tmp_path, capsys):
    """Exit code 1 would say that the change is worse."""
    folder = tmp_path / "old"
    shutil.copytree(baseline, folder)
    assert main(["-m", "task=planning", "world=map1", "planner=rrt", "seed=0,1", f"output={folder / 'more'}"]) == 0
    assert main(["gate", str(folder), "planner=prm"]) == 2
    assert re.search("makes one run of two, seed=0_.* give a folder with one of them", capsys.readouterr().err)
    next(folder.glob("*/row.json")).write_text("{")
    assert main(["gate", str(folder), "planner=prm"]) == 2 and "cannot be read as a row" in capsys.readouterr().err


def test_who_stops_a_command_hears_where_it_goes_on(tmp_path, capsys):
    with pytest.raises(KeyboardInterrupt), going_on(str(tmp_path)):
        raise KeyboardInterrupt
    assert capsys.readouterr().out == f"files: {tmp_path}; the same command with output={tmp_path} goes on\n"


def test_what_broke_off_before_counts_as_what_breaks_off_now(baseline, tmp_path):
    """A part that breaks off in two of six runs, old and new, had lost two successes: only old ones that ended counted."""
    shutil.copytree(baseline, tmp_path / "old")
    for path in sorted((tmp_path / "old").glob("*/row.json"))[:2]:
        write_row(path.parent, read_row(path) | {"status": "failed", "success": 0.0})
    pairs = _pairs(tmp_path / "old", ["planner=prm"], 20)
    assert sorted(rank(row) for row, _ in pairs) == [0, 0, 2, 2, 2, 2]


def test_four_equal_pairs_are_told_as_what_they_are():
    found = judge([1.0] * 4, [0.97] * 4, [(True, True)] * 4, margin=0.02)
    assert in_words(found, "x_m", 0.02) == ("better: x_m -3 % in each of 4 pairs; successes lost 0, won 0; that up to "
                                            "60 % of runs lose theirs is not ruled out")
    same = judge([1.0] * 4, [1.0] * 4, [(True, True)] * 4, margin=0.02)  # of a measure that the change cannot move
    assert in_words(same, "x_m", 0.02).endswith("name one that the change can move by --measure NAME")


def test_a_way_through_a_wall_has_no_length():
    row = {"status": "ok", "success": 0.0, "plan_length_m": 1.0, "plan_optimal_m": 2.0, "ate_rmse_m": 0.5}
    assert math.isnan(measured(row, "plan_length_m")) and measured(row, "ate_rmse_m") == 0.5
    assert math.isnan(measured(row | {"status": "failed"}, "ate_rmse_m")) and measured(row, "plan_optimal_m") == 2.0


@pytest.mark.parametrize(("change", "code", "says"), [
    (["planner=theta_star"], 0, "better: plan_length_m is known in 0 pairs; successes lost 0, won 9; that up to"),
    (["planner.iterations=2"], 3, "needs more runs: no old and no new run did what it was asked for, nothing can "
                                  "be compared; successes lost 0, won 0\n")])
def test_a_baseline_that_never_succeeds_is_compared_by_successes(tmp_path, capsys, change, code, says):
    old = tmp_path / "old"
    assert main(["-m", "task=planning", "world=map1", "planner=rrt", "planner.iterations=1", "seed=range(9)",
                 f"output={old}"]) == 3
    capsys.readouterr()
    assert main(["gate", str(old), *change, f"output={tmp_path / 'new'}"]) == code
    assert capsys.readouterr().out.startswith(says)


def test_two_that_break_off_alike_are_called_worse_or_better_in_one_of_twenty():
    """One in five runs of either breaks off, by chance."""
    rng, words = np.random.default_rng(3), []
    for _ in range(400):
        ended = rng.random((20, 2)) > 0.2
        old, new = np.where(ended, np.exp(0.1 * rng.standard_normal((20, 2))), math.nan).T
        ranks = [(before > after, after > before) for before, after in 2 * ended.astype(int)]
        words.append(judge(old, new, ranks, margin=0.02).word)
    assert words.count("worse") + words.count("better") <= 0.05 * 400 + 3 * np.sqrt(400 * 0.05 * 0.95)
