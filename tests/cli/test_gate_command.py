"""`python -m rhs gate` from end to end, and what it refuses."""

import json
from types import SimpleNamespace

import pytest

from rhs.cli.gate import _compared, in_words
from rhs.cli.main import main
from rhs.runfolder.row import write_row


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
    (["FOLDER", "planner=prm", "--pairs", "1"], "--pairs")])
def test_what_cannot_be_gated_is_one_line(baseline, words, says, capsys):
    assert main(["gate", *(word.replace("FOLDER", str(baseline)) for word in words)]) == 2
    told = capsys.readouterr().err
    assert says in told and told.count("\n") == 1


@pytest.mark.parametrize(("status", "success", "code", "says"), [
    ("failed", 0.0, 1, "worse: ate_rmse_m is known in 0 pairs; successes lost 9, won 0"),
    ("ok", 0.0, 0, "better: ate_rmse_m -90 %"), ("ok", 1.0, 0, "better: ate_rmse_m -90 %")])
def test_a_run_that_broke_off_is_no_better_for_the_short_way_it_went(tmp_path, monkeypatch, status, success, code, says):
    """Of old runs that did not achieve their mission either, so that no success is lost."""
    def run(jobs, folder, limits, tell):
        for job in jobs:
            row = {"status": status, "reason": "of mine", "success": success, "ate_rmse_m": 0.1}
            (folder / job.name).mkdir()
            write_row(folder / job.name, row)

    monkeypatch.setattr("rhs.sweeps.jobs.run_jobs", run)
    pairs = [({"status": "ok", "success": 0.0, "ate_rmse_m": 1.0}, SimpleNamespace(name=f"job{k}")) for k in range(9)]
    found, broken = _compared(pairs, tmp_path, None, "ate_rmse_m", 0.02)
    assert found.exit_code == code and in_words(found, "ate_rmse_m", 0.02).startswith(says)
    assert broken == ("9 of 9 broke off, most by: of mine" if status == "failed" else "")
