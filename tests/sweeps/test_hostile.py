"""Jobs that go out of their way to harm a sweep: each costs itself, nothing of it is left, and the account is given."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fakes.rhs_fakes.parts import MARK
from installing import CHOICE, FAKES, environment, installed

from rhs.cli.main import main
from rhs.runfolder.row import read_row

FAULTY = [word for word in CHOICE if not word.startswith("odometry=")] + ["odometry=faulty", "source.views=3"]
FATES = {"none": ("ok", ""), "remove_folder": ("failed", ""), "thread": ("ok", ""), "child": ("ok", ""),
         "orphan": ("ok", ""), "os_exit_zero": ("failed", "os._exit(0)"), "memory": ("killed", "the 700 MB of --memory-mb"),
         "kill_server": ("killed", ""), "huge_reason": ("failed", "131073 characters"), "escape": ("failed", "]0;owned")}


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


def rhs(folder: Path, *words: str, timeout: float = 400) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES), capture_output=True,
                          text=True, timeout=timeout)


def left_behind() -> list[str]:
    """Command lines of processes that a hostile part started, a second later."""
    time.sleep(1.0)
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_text().replace("\0", " ")
        except OSError:
            continue
        lines += [line] if MARK in line and "pytest" not in line else []
    return lines


@pytest.fixture(scope="module")
def sweep(tmp_path_factory) -> tuple[subprocess.CompletedProcess, Path]:
    folder = tmp_path_factory.mktemp("hostile")
    done = rhs(folder, "-m", *FAULTY, f"odometry.how={','.join(FATES)}", "output=s", "--jobs", "2", "--timeout", "90",
               "--memory-mb", "700")
    return done, folder / "s"


@pytest.mark.slow
@pytest.mark.parametrize("how", FATES)
def test_a_hostile_job_costs_itself(sweep, how):
    row = read_row(next(sweep[1].glob(f"odometry.how={how}_*/row.json")))
    assert row["status"] == FATES[how][0]
    assert FATES[how][1] in str(row["reason"])
    assert all(c.isprintable() for c in str(row["reason"]))


@pytest.mark.slow
def test_the_sweep_ends_with_its_account_and_nothing_is_left(sweep):
    done, folder = sweep
    assert done.returncode == 3
    accounts = json.loads((folder / "jobs.json").read_text())
    assert accounts == {path.parent.name: read_row(path)["status"] for path in folder.glob("*/row.json")}
    assert len(accounts) == len(FATES) and f"{len(FATES)} jobs: 4 ok" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr
    assert left_behind() == []


@pytest.mark.slow
def test_a_killed_job_is_tried_again_and_may_then_end_well(tmp_path):
    """It kills itself unless the flag is there; the flag comes while it is tried for the second time."""
    flag = tmp_path / "flag"
    words = [sys.executable, "-m", "rhs", "-m", *FAULTY, "odometry.how=kill", f"odometry.flag={flag}", "source.delay_s=1",
             "seed=0", "output=s", "--retries", "5"]
    process = subprocess.Popen(words, cwd=tmp_path, env=environment(FAKES), stdout=subprocess.PIPE, text=True)
    wait_for(lambda: list(tmp_path.glob("s/*/steps.jsonl*")))
    time.sleep(2.0)
    flag.touch()
    out, _ = process.communicate(timeout=200)
    assert process.returncode == 0 and "1 jobs: 1 ok" in out


@pytest.mark.slow
def test_a_single_run_leaves_neither_threads_nor_processes(tmp_path):
    begin = time.monotonic()
    for how in ("thread", "orphan"):
        done = rhs(tmp_path, *FAULTY, f"odometry.how={how}", f"output={how}")
        assert done.returncode == 0, done.stderr
    assert left_behind() == [] and time.monotonic() - begin < 300


def test_an_exit_with_zero_is_no_success(tmp_path):
    done = rhs(tmp_path, *FAULTY, "odometry.how=os_exit_zero", "output=run")
    assert done.returncode == 1
    assert "os._exit(0)" in done.stderr
    row = read_row(tmp_path / "run" / "row.json")
    assert row["status"] == "failed" and row["success"] == 0.0
    assert len((tmp_path / "run" / "steps.csv").read_text().splitlines()) == 3


def test_a_hang_up_is_like_a_termination(tmp_path):
    words = [sys.executable, "-m", "rhs", *CHOICE, "source.views=600", "source.delay_s=0.05", "output=run"]
    process = subprocess.Popen(words, cwd=tmp_path, env=environment(FAKES), stdout=subprocess.DEVNULL)
    wait_for(lambda: [p for p in tmp_path.glob("run/steps.jsonl*") if p.stat().st_size])
    process.send_signal(signal.SIGHUP)
    assert process.wait(timeout=60) == 143
    assert read_row(tmp_path / "run" / "row.json")["status"] == "interrupted"


def test_forced_into_another_configuration_the_old_rows_step_aside(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert main(["-m", *FAULTY, "seed=0,1", "output=s", "--jobs", "1"]) == 0
    assert main(["-m", *FAULTY, "seed=0", "source.views=4", "output=s", "--resume", "--force", "--jobs", "1"]) == 0
    assert [read_row(path)["survey_steps"] for path in (tmp_path / "s").glob("*/row.json")] == [4]
    aside = next(tmp_path.glob("s.before-*"))
    assert sorted(read_row(path)["seed"] for path in aside.glob("*/row.json")) == [0, 1]


def wait_for(true, seconds: float = 120) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, os.listdir()
        time.sleep(0.05)
