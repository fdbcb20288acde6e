"""One row that is none never takes the others with it: it is named, counted, and the exit code says so."""

import json
import os
import subprocess
import sys

import pytest
import yaml

from rhs.api.errors import RhsError
from rhs.reports import arena_log, report
from rhs.reports.table import main, rows
from rhs.reports.varied_settings import settings_of
from rhs.runfolder.row import read_row, write_row

BAD = {
    "a record inside": '{"status": "ok", "x": {}}',
    "a list inside": '{"status": "ok", "x": [1]}',
    "an infinite seed": '{"status": "ok", "seed": 1e400}',
    "half a place": '{"status": "ok", "places_visited": 1.5}',
    "text for a count": '{"status": "ok", "places_visited": "<b>"}',
    "text for a length": '{"status": "ok", "ate_rmse_m": "short"}',
    "a number for a word": '{"status": "ok", "world": 3}',
    "true for a count": '{"status": "ok", "missions": true}',
    "text where others have numbers": '{"status": "ok", "plan_length_m": "x"}',
    "a whole number of 5000 digits": '{"status": "ok", "extra": ' + "9" * 5000 + "}",
    "a whole number of 70 bits": '{"status": "ok", "extra": ' + str(2**70) + "}",
    "deep": "[" * 100_000,
    "deep records": '{"a":' * 50_000,
    "cut off": '{"status": "o',
    "empty": "",
    "a list": "[]",
    "no row at all": "{}",
    "no text": '{"status": "\\ud800"}',
    "binary": b"\xff\xfe\x00",
    "too large": '{"status": "' + "x" * (5 << 20) + '"}',
}


def good(folder, count=3):
    for seed in range(count):
        (folder / f"good{seed}").mkdir(parents=True)
        write_row(folder / f"good{seed}", {"status": "ok", "reason": "", "world": "w", "planner": "prm", "seed": seed,
                                           "task": "planning", "plan_success": 1, "plan_valid": 1.0, "plan_reason": "ok",
                                           "plan_length_m": 5.0 + seed, "plan_optimal_m": 5.0, "places_visited": None,
                                           "extra": 1, "wall_ms": 3.0, "map_resolution_m": 0.1})


def bad(folder, content):
    folder.mkdir(parents=True)
    (folder / "row.json").write_bytes(content if isinstance(content, bytes) else content.encode())


def pipe(folder):
    folder.mkdir()
    os.mkfifo(folder / "row.json")


def device(folder):
    folder.mkdir()
    (folder / "row.json").symlink_to("/dev/zero")


def directory(folder):
    (folder / "row.json").mkdir(parents=True)


def dangling(folder):
    folder.mkdir()
    (folder / "row.json").symlink_to("nowhere")


@pytest.mark.parametrize("name", BAD)
def test_a_malformed_row_is_named_and_the_others_are_told(tmp_path, capsys, name):
    good(tmp_path)
    bad(tmp_path / "bad", BAD[name])
    assert main([str(tmp_path)]) == 3
    said = capsys.readouterr()
    assert "5.1" in said.out or "6 [" in said.out  # the mean of the three
    assert len(said.err.splitlines()) == 1 and "bad/row.json" in said.err and "not counted (1 of 1)" in said.err
    assert report.main([str(tmp_path)]) == 3
    said = capsys.readouterr()
    assert "bad/row.json" in said.err and len(said.err.splitlines()) == 1
    assert "good1" in (tmp_path / "report.html").read_text() and "Not counted" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("make", [pipe, device, directory, dangling])
def test_pipes_devices_and_folders_are_not_opened(tmp_path, capsys, make):
    good(tmp_path)
    make(tmp_path / "bad")
    assert main([str(tmp_path)]) == 3
    assert "bad/row.json" in capsys.readouterr().err
    with pytest.raises(RhsError):
        rows([tmp_path])
    assert arena_log.main([str(tmp_path), "--log", str(tmp_path / "logs")]) == 3
    assert "bad/row.json" in capsys.readouterr().err


@pytest.mark.parametrize("name", BAD)
def test_a_folder_of_unreadable_rows_alone_is_one_line(tmp_path, capsys, name):
    if name == "text where others have numbers":
        pytest.skip("alone it is a row with a text column")
    bad(tmp_path / "a", BAD[name])
    bad(tmp_path / "b", BAD[name])
    for command in (main, report.main, lambda words: arena_log.main([*words, "--log", str(tmp_path / "logs")])):
        assert command([str(tmp_path)]) in (1, 2)
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert report.main([str(tmp_path / "a")]) in (1, 2)
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_one_bad_folder_does_not_stop_the_report_of_the_next(tmp_path, capsys):
    good(tmp_path / "sweep")
    bad(tmp_path / "bad", "[")
    assert report.main([str(tmp_path / "bad"), str(tmp_path / "sweep")]) == 3
    said = capsys.readouterr()
    assert "sweep/report.html" in said.out and len(said.err.splitlines()) == 1


@pytest.mark.parametrize("content", ["planner: {samples: [", "a: &a [*a]", "[" * 5000, "- 1", "\x00",
                                     "x: 1" + "0" * (2 << 20),
                                     "a: &a [1,1,1,1,1,1,1,1,1]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\n"
                                     "c: &c [*b,*b,*b,*b,*b,*b,*b,*b,*b]\nd: &d [*c,*c,*c,*c,*c,*c,*c,*c,*c]\n"
                                     "e: &e [*d,*d,*d,*d,*d,*d,*d,*d,*d]\nf: [*e,*e,*e,*e,*e,*e,*e,*e,*e]\n"])
def test_a_malformed_configuration_is_an_unknown_one(tmp_path, content):
    good(tmp_path)
    for seed in range(2):
        (tmp_path / f"good{seed}" / "config.yaml").write_text(yaml.safe_dump({"planner": {"name": "prm", "samples": seed}}))
    (tmp_path / "good2" / "config.yaml").write_text(content)
    assert rows([tmp_path])["planner.samples"].isna().sum() == 1
    assert settings_of(tmp_path / "good2") == {}


def test_a_pipe_for_a_configuration_is_not_opened(tmp_path):
    good(tmp_path)
    os.mkfifo(tmp_path / "good2" / "config.yaml")
    assert len(rows([tmp_path])) == 3


def test_many_bad_rows_are_counted_and_not_all_listed(tmp_path, capsys):
    good(tmp_path)
    for number in range(30):
        bad(tmp_path / f"bad{number}", "[")
    assert main([str(tmp_path)]) == 3
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 21 and "(1 of 30)" in said[0] and "10 more" in said[-1]


def test_a_row_cannot_command_the_terminal(tmp_path, capsys):
    bad(tmp_path / "a", json.dumps({"status": "ok", "world": "w", "reason": "\x1b]0;owned\x07", "planner": "\x1b[31mred"}))
    bad(tmp_path / "b", json.dumps({"status": "failed", "world": "w", "reason": "\x1b]0;owned\x07\nx", "planner": "prm"}))
    assert main([str(tmp_path)]) == 0 and main([str(tmp_path), "--rows"]) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_unknown_in_a_row_is_none_and_whole_numbers_stay_whole(tmp_path):
    bad(tmp_path / "a", '{"status": "ok", "ate_rmse_m": NaN, "seed": 3, "clearance_min_m": 1e999}')
    row = read_row(tmp_path / "a" / "row.json")
    assert row["ate_rmse_m"] is None and row["seed"] == 3 and row["clearance_min_m"] == float("inf")


@pytest.mark.parametrize("words", [
    ["rhs.table"], ["rhs.table", "x", "--nothing"], ["rhs.report"], ["rhs.report", "x", "--nothing"],
    ["rhs.planner_arena", "x"], ["rhs.evaluate"], ["rhs.evaluate", "--tolerance", "much", "x"],
    ["rhs.evaluate", "PIPE", "PIPE"], ["rhs.convert"], ["rhs.convert", "/dev/zero", "out.mcap"],
    ["rhs.convert", "PIPE", "out.mcap"]])
def test_every_tool_answers_a_wrong_request_in_one_line(tmp_path, words):
    os.mkfifo(tmp_path / "f.mcap")
    words = [str(tmp_path / "f.mcap") if word == "PIPE" else word for word in words]
    done = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and not done.stdout, done.stderr
