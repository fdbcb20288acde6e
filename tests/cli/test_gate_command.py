"""`python -m rhs gate` from end to end, and what it refuses."""

import json

import pytest

from rhs.cli.main import main


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
