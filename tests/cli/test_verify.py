"""`python -m rhs verify`: the same run again gives the same row, and what does not is named."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, installed

from rhs.cli.main import main as rhs
from rhs.cli.verify import differences, main

GOLDEN = Path(__file__).resolve().parents[1] / "golden"


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


def change(row: Path, **values: object) -> None:
    row.write_text(json.dumps(json.loads(row.read_text()) | values))


@pytest.fixture(scope="module")
def sweep(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sweep") / "s"
    assert rhs(["-m", *CHOICE, "source.views=4", "seed=range(3)", f"output={folder}", "--jobs", "1"]) == 0
    return folder


def test_differences_are_classed_by_their_share():
    before = {"a": 1.0, "b": 2.0, "c": "x", "d": None, "e": 3, "f": 0.0, "odometry_ms": 1.0, "commit": "1", "g": True}
    now = {"a": 1.0, "b": 2.0 + 1e-9, "c": "y", "d": float("nan"), "e": 4, "f": 1e-30, "odometry_ms": 9.0, "g": 1}
    assert [(one.column, one.kind) for one in differences(before, now)] == [
        ("b", "within 1e-6"), ("c", "other"), ("e", "other"), ("f", "other"), ("g", "other")]


def test_the_same_again_is_equal_and_what_was_changed_is_named(sweep, capfd):
    kept = {path: path.read_text() for path in sweep.glob("*/row.json")}
    assert main([str(sweep), "--jobs", "1"]) == 0
    assert "3 runs: 3 equal" in capfd.readouterr().out
    one = next(sweep.glob("seed=1_*/row.json"))
    ate = json.loads(one.read_text())["ate_rmse_m"]
    change(one, ate_rmse_m=ate * (1 + 1e-9))
    assert main([str(sweep), "--jobs", "1"]) == 3
    out = capfd.readouterr().out
    assert "3 runs: 2 equal, 1 within 1e-6" in out and "ate_rmse_m: " in out and "1e-09 of it" in out
    assert main([str(sweep), "--jobs", "1", "--tolerance", "1e-6"]) == 0
    change(one, missions=7, versions="python=2.7 numpy=1.0 vectors=mmx")
    assert main([str(one.parent), "--jobs", "1", "--tolerance", "1e-6"]) == 3
    out = capfd.readouterr().out
    assert "missions: 7 -> 2" in out and "made with python=2.7 numpy=1.0 vectors=mmx; here python=3" in out
    for path, text in kept.items():
        path.write_text(text)


def test_a_sample_is_drawn_and_nothing_of_the_runs_changes(sweep, capfd):
    before = {path: path.read_bytes() for path in sweep.rglob("*") if path.is_file()}
    assert main([str(sweep), "--jobs", "1", "--sample", "1", "--seed", "4"]) == 0
    first = capfd.readouterr().out
    assert "1 runs: 1 equal" in first
    assert main([str(sweep), "--jobs", "1", "--sample", "1", "--seed", "4"]) == 0
    assert capfd.readouterr().out == first
    assert {path: path.read_bytes() for path in sweep.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("words", [[], ["."], ["nowhere"], ["--golden", "."], [".", "--sample", "-1"]])
def test_what_cannot_be_verified_is_refused_in_one_line(tmp_path, monkeypatch, capfd, words):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


@pytest.mark.slow
def test_the_golden_rows_are_the_rows_of_now(tmp_path):
    words = [sys.executable, "-m", "rhs", "verify", "--golden", str(GOLDEN), "--tolerance", "1e-6"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_golden_set_knows_every_sensor_odometry_and_localiser():
    from rhs.config import registry

    rows = [json.loads(path.read_text()) for path in GOLDEN.glob("*/row.json")]
    assert len(rows) == 16
    for kind in ("sensor", "odometry", "localiser"):
        ours = {name for name in registry.names(kind) if registry.origins(kind, name)[0].distribution.startswith("rhs ")}
        assert ours <= {row.get(kind) for row in rows}, kind


def test_a_golden_folder_lacks_its_jobs_or_a_row_before_anything_runs(tmp_path, capsys):
    assert main(["--golden", str(tmp_path)]) == 2
    assert "holds no jobs.yaml" in capsys.readouterr().err
    (tmp_path / "jobs.yaml").write_text("one: [world=square_small]\n")
    assert main(["--golden", str(tmp_path)]) == 2
    assert f"{tmp_path.name}/one/row.json cannot be read as a row: No such file" in capsys.readouterr().err
