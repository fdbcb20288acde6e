"""`python -m rhs recover`: a killed run becomes a whole folder with the figures of what it had seen."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest
from installing import CHOICE, FAKES, environment, installed

import rhs
from rhs.api.trajectory import read_tum
from rhs.cli.evaluate import differences
from rhs.cli.recover import main
from rhs.recording.mcap_scan import open_scan, scan
from rhs.runfolder.row import begin_row, read_row, write_row
from rhs.runfolder.run import load_run


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A run of fakes, killed once twelve steps were on the disk."""
    place = tmp_path_factory.mktemp("killed")
    words = [*CHOICE, "source.views=18", "source.delay_s=0.05", "output=run", "pictures=off"]
    process = subprocess.Popen([sys.executable, "-m", "rhs", *words], cwd=place, env=environment(FAKES),
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 120
    while sum(len(path.read_text().splitlines()) for path in place.glob("run/steps.jsonl*")) < 12:
        assert time.monotonic() < end and process.poll() is None
        time.sleep(0.02)
    assert read_row(place / "run" / "row.json")["status"] == "running"
    assert main([str(place)]) == 0, "a run under way is left alone"
    assert read_row(place / "run" / "row.json")["status"] == "running"
    process.send_signal(signal.SIGKILL)
    process.wait()
    return place / "run"


def test_a_killed_run_is_seen_then_recovered_with_all_its_steps(killed, capfd):
    assert read_row(killed / "row.json")["status"] == "killed"
    assert main([str(killed.parent)]) == 0
    assert "steps from steps.jsonl; run.mcap:" in capfd.readouterr().out
    row = read_row(killed / "row.json")
    steps = load_run(killed).steps
    assert row["status"] == "killed" and "pid" not in row and row["success"] == 0.0
    assert [int(step["index"]) for step in steps] == list(range(len(steps)))
    assert 12 <= len(steps) == row["views"] == len(read_tum(killed / "estimate.tum")) == row["survey_steps"]
    assert row["ate_rmse_m"] is not None and differences(killed) == []
    file, report = open_scan(killed / "run.mcap")
    file.close()
    assert len(list(scan(killed / "run.mcap", report))) > 0 and report.whole  # the last chunk died with the process
    assert not list(killed.glob("*.tmp-*"))
    assert main([str(killed)]) == 0 and "no killed run" in capfd.readouterr().out


def test_where_the_steps_are_lost_the_recording_has_them(tmp_path):
    whole, left = tmp_path / "whole", tmp_path / "left"
    rhs.run([*CHOICE, "source.views=6", "pictures=off", f"output={whole}"], quiet=True)
    left.mkdir()
    (left / "run.mcap").write_bytes((whole / "run.mcap").read_bytes())
    begin_row(left, {"task": "patrol", "world": "room", "seed": 0})
    assert main([str(left)]) == 0
    ours, theirs = load_run(left).steps, load_run(whole).steps
    assert 6 < len(ours) == len(theirs)
    for column in ("index", "phase", "stamp_s", "motion_status", "x_m", "yaw_rad", "true_x_m", "clearance_m", "forward_mps"):
        assert [step[column] for step in ours] == [step[column] for step in theirs]
    for name in ("estimate.tum", "patrol.tum", "truth_survey.tum", "truth_patrol.tum"):
        assert (left / name).read_bytes() == (whole / name).read_bytes()


def test_a_step_that_was_cut_is_left_out(tmp_path):
    begin_row(tmp_path, {"task": "survey"})
    whole = '[{"index": 0, "phase": "survey"}, {"estimate": "0.0 0 0 0 0 0 0 1\\n"}]\n'
    (tmp_path / "steps.jsonl.tmp-1").write_text(whole + '[{"index": 1, "pha')
    assert main([str(tmp_path)]) == 0
    assert len((tmp_path / "steps.csv").read_text().splitlines()) == 2 and read_row(tmp_path / "row.json")["views"] == 1


def test_what_is_finished_is_not_touched_and_what_is_no_folder_refused(tmp_path, capfd):
    write_row(tmp_path, {"status": "ok", "seed": 3})
    before = (tmp_path / "row.json").read_bytes()
    assert main([str(tmp_path)]) == 0 and (tmp_path / "row.json").read_bytes() == before
    assert main([str(tmp_path / "nowhere")]) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1
