"""Sweeps: what is planned, and what resuming does. Bad jobs and interruptions: tests/faults."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, environment, installed, interruptible

from rhs.api.errors import ConfigError
from rhs.cli.main import main
from rhs.runfolder.row import canonical_hash, read_row
from rhs.sweeps.sweep import plan

FAULTY = [word for word in CHOICE if not word.startswith("odometry=")] + ["odometry=faulty", "source.views=3"]


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


def start(folder: Path, *words: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES),
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
                            preexec_fn=interruptible)


def rhs(folder: Path, *words: str, timeout: float = 300) -> subprocess.CompletedProcess:
    process = start(folder, *words)
    out, err = process.communicate(timeout=timeout)
    assert not alive(process.pid), "no process is left behind"
    return subprocess.CompletedProcess(words, process.returncode, out, err)


def alive(group: int) -> bool:
    """Whether a process of the group is left two seconds later."""
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.02)
    return True


def hashes(sweep: Path) -> dict[str, str]:
    return {path.parent.name: canonical_hash(read_row(path)) for path in sweep.glob("*/row.json")}


# --- planning, without running ---------------------------------------------------------------------------------------


def test_jobs_are_the_product_of_what_is_swept_the_first_slowest():
    names = [job.name.rpartition("_")[0] for job in plan([*CHOICE, "seed=0,1", "planner.samples=5,6"]).jobs]
    assert names == ["seed=0,planner.samples=5", "seed=0,planner.samples=6", "seed=1,planner.samples=5",
                     "seed=1,planner.samples=6"]


def test_one_configuration_twice_is_one_job():
    both = plan([*CHOICE, "seed=0,1,0"])
    assert (len(both.jobs), both.repeated) == (2, 1)


def test_names_of_jobs_are_plain_folder_names():
    jobs = plan([*CHOICE, "planner.mode='../../x','/etc/passwd','a b'"]).jobs
    assert all("/" not in job.name and " " not in job.name and not job.name.startswith(".") for job in jobs)
    assert len({job.name for job in jobs}) == 3


def test_many_jobs_are_planned_at_less_than_fifty_milliseconds_each():
    begin = time.process_time()
    assert len(plan([*CHOICE, "seed=range(300)"]).jobs) == 300
    assert (time.process_time() - begin) / 300 < 0.05


@pytest.mark.parametrize(("words", "says"), [
    (["seed=range(0)"], "no jobs"), (["seed=0,-1"], "seed=-1 is outside"), (["seed=0,x"], "seed=x: expected int"),
    (["planner=fake,fak"], "did you mean fake?"), (["planner=fake,broken"], "cannot be imported"),
    (["planner.samples=5,906970164"], "[1, 1000000]"), (["output=a,b"], "one folder"),
    (["seed=range(1000)", "planner.samples=range(1,1000)"], "at most 100000"),
])
def test_a_bad_axis_is_refused_before_the_first_job(words, says):
    with pytest.raises(ConfigError) as caught:
        plan([*CHOICE, *words])
    assert says in str(caught.value)


def test_a_sweep_whose_every_job_is_refused_is_refused(tmp_path, monkeypatch, capsys):
    """A world that nobody has: as of one run, one line and exit code 2, no empty table."""
    monkeypatch.chdir(tmp_path)
    assert main(["-m", "task=planning", "world=map9", "seed=0,1", "--jobs", "1"]) == 2
    out, err = capsys.readouterr()
    assert not out and "did you mean 'map4'? (all 2 jobs; files: " in err


# --- running ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    """Four seeds, run without any trouble, two at a time."""
    folder = tmp_path_factory.mktemp("good")
    done = rhs(folder, "-m", *FAULTY, "seed=range(4)", "odometry.how=sleep", "odometry.flag=/", "output=s", "--jobs", "2")
    assert done.returncode == 0, done.stderr
    return folder / "s"


def test_a_run_is_the_same_alone_and_in_a_sweep(good, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = [*FAULTY, "seed=2", "odometry.how=sleep", "odometry.flag=/", "recording=off"]
    assert main([*words, "output=alone"]) == 0
    assert canonical_hash(read_row(tmp_path / "alone" / "row.json")) == hashes(good)[next(good.glob("seed=2_*")).name]


def test_a_sweep_may_grow_but_not_change(good, monkeypatch, capfd):
    monkeypatch.chdir(good.parent)
    words = ["-m", *FAULTY, "odometry.how=sleep", "odometry.flag=/", "output=s"]
    before = hashes(good)
    assert main([*words, "seed=range(4)"]) == 2
    assert "already holds a sweep; go on with it by --resume" in capfd.readouterr().err
    assert main([*words, "seed=range(4)", "source.views=4", "--resume"]) == 2
    assert "source.views was 3, is 4" in capfd.readouterr().err
    assert hashes(good) == before
    assert main([*words, "seed=range(5)", "--resume"]) == 0
    assert "5 jobs: 5 ok (4 finished before)" in capfd.readouterr().out
    assert {name: hashes(good)[name] for name in before} == before
    shrunk = json.loads((good / "sweep.json").read_text())
    (good / "sweep.json").write_text(json.dumps(shrunk | {"rhs": "0.0.1"}))
    assert main([*words, "seed=range(5)", "--resume"]) == 2
    assert "was made by rhs 0.0.1" in capfd.readouterr().err
    assert main([*words, "seed=range(5)", "--resume", "--force"]) == 0


@pytest.mark.parametrize("keep", ["all", "none"])
def test_what_was_not_achieved_is_said_again_by_who_goes_on(tmp_path, monkeypatch, capsys, keep):
    """Seen: exit code 3, and 0 by --resume of the same folder, with nothing done in between."""
    monkeypatch.chdir(tmp_path)
    assert main(["-m", "task=planning", "world=map1", "planner=rrt", "planner.iterations=1", "seed=0,1", f"keep={keep}",
                 "output=s", "--jobs", "1"]) == 3
    said = capsys.readouterr().err
    assert said.endswith(f"2 of 2 jobs did not do all that was asked; see python -m rhs table --rows {tmp_path / 's'}\n")
    assert main(["--resume", "s"]) == 3
    assert capsys.readouterr().err == said


def test_words_that_leave_out_jobs_of_a_sweep_are_refused_by_what_is_wrong(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["-m", "task=planning", "world=map1", "seed=0,1", "output=s", "--jobs", "1"]) == 0
    capsys.readouterr()
    assert main(["--resume", "s", "seed=0"]) == 2
    assert "s holds jobs that these words do not ask for; take another folder or type --force" in capsys.readouterr().err
