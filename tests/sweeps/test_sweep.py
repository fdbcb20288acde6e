"""Sweeps: what a bad job costs, what an interruption leaves, what resuming does. A job costs one job, never the sweep."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, environment, installed, interruptible

from rhs.api.errors import ConfigError
from rhs.cli.main import main
from rhs.reports.table import rows, to_csv
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


def statuses(sweep: Path) -> dict[str, str]:
    return {path.parent.name.rpartition("_")[0]: str(read_row(path)["status"]) for path in sweep.glob("*/row.json")}


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


# --- running ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bad_company(tmp_path_factory) -> tuple[subprocess.CompletedProcess, Path]:
    """One sweep in which every job but two goes wrong in a way of its own."""
    folder = tmp_path_factory.mktemp("bad")
    how = "none,raise,exit,os_exit,kill,segfault,none_result,nan_pose,spin,leak"
    return rhs(folder, "-m", *FAULTY, f"odometry.how={how}", "output=s", "--jobs", "2", "--timeout", "20"), folder / "s"


@pytest.mark.parametrize(("how", "status", "reason"), [
    ("none", "ok", ""), ("leak", "ok", ""), ("raise", "failed", "ValueError at step 2: the odometry of this test"),
    ("exit", "failed", "SystemExit at step 2: 3"), ("os_exit", "failed", "ended the process by os._exit(3) at step 2"),
    ("kill", "killed", "SIGKILL"), ("segfault", "killed", "SIGSEGV"), ("none_result", "failed", "expected a Motion"),
    ("nan_pose", "failed", "expected finite 4x4 numbers"), ("spin", "timeout", "took longer than the 20 s of --timeout"),
])
def test_a_bad_job_costs_itself_and_says_why(bad_company, how, status, reason):
    row = read_row(next(bad_company[1].glob(f"odometry.how={how}_{10 * chr(63)}/row.json")))
    assert row["status"] == status
    assert reason in str(row["reason"])
    assert (row["odometry"], row["seed"]) == ("faulty", 0)


def test_the_accounts_of_a_sweep_add_up(bad_company):
    done, sweep = bad_company
    assert done.returncode == 3
    accounts = list(json.loads((sweep / "jobs.json").read_text()).values())
    assert len(accounts) == 10 == len(list(sweep.glob("*/row.json")))
    assert "10 jobs: 2 ok, 5 failed, 2 killed, 1 timeout" in done.stdout
    assert {name: accounts.count(name) for name in set(accounts)} == {"ok": 2, "failed": 5, "killed": 2, "timeout": 1}
    assert len(done.stderr.splitlines()) == 1 and "8 of 10 jobs did not end well" in done.stderr
    assert len((sweep / "table.csv").read_text().splitlines()) == 11


def test_the_log_of_a_failed_job_holds_the_traceback(bad_company):
    log = next(bad_company[1].glob("odometry.how=raise_*/job.log")).read_text()
    assert "Traceback" in log and "the odometry of this test" in log


def test_what_a_failed_job_had_seen_is_kept(bad_company):
    for how in ("raise", "exit", "nan_pose"):
        steps = next(bad_company[1].glob(f"odometry.how={how}_*/steps.csv"))
        assert len(steps.read_text().splitlines()) == 3


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


def test_a_killed_sweep_is_resumed_to_the_same_table(good, tmp_path):
    """SIGKILL while seed 2 hangs: nothing is left running, and --resume does only what is missing."""
    flag = tmp_path / "well"
    words = ["-m", *FAULTY, "seed=range(4)", "odometry.how=sleep", f"odometry.flag={flag}", "odometry.at=3", "output=s"]
    process = start(tmp_path, *words, "--jobs", "1")
    wait_for_running(tmp_path / "s", 0)
    process.kill()
    process.communicate()
    assert not alive(process.pid), "its jobs died with it"
    flag.touch()
    (tmp_path / "s" / "left.tmp-123").write_text("half a ro")
    first = rhs(tmp_path, "--resume", "s", "--jobs", "2")
    assert first.returncode == 0, first.stderr
    assert statuses(tmp_path / "s") == {f"seed={n}": "ok" for n in range(4)}
    assert numbers(tmp_path / "s") == numbers(good)
    again = rhs(tmp_path, "--resume", "s")
    assert "(4 finished before)" in again.stdout
    assert (tmp_path / "s" / "table.csv").exists()


def numbers(sweep: Path) -> str:
    """The canonical table without the hash of the configuration, which knows the path of the flag."""
    return to_csv(rows([sweep]).drop(columns=["config_hash"]), canonical=True).replace(str(sweep), "")


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


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_sweep_flushes_and_says_how_to_go_on(tmp_path, number, code):
    process = start(tmp_path, "-m", *CHOICE, "seed=range(3)", "source.views=600", "source.delay_s=0.05", "output=s",
                    "--jobs", "1")
    wait_for_running(tmp_path / "s", 3)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    assert not alive(process.pid)
    assert "1 interrupted, 2 skipped" in out and "--resume" in out
    assert statuses(tmp_path / "s") == {"seed=0": "interrupted"}
    assert len(next((tmp_path / "s").glob("seed=0_*/steps.csv")).read_text().splitlines()) > 3
    assert not list((tmp_path / "s").glob("*/*.tmp-*"))


def test_a_second_ctrl_c_stops_at_once(tmp_path):
    process = start(tmp_path, "-m", *FAULTY, "seed=0", "odometry.how=spin", "output=s")
    wait_for_running(tmp_path / "s", 2)
    process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=8)
    assert process.returncode == 130
    assert not alive(process.pid)


def test_two_sweeps_cannot_share_a_folder(tmp_path, monkeypatch, capfd):
    process = start(tmp_path, "-m", *FAULTY, "seed=0", "odometry.how=sleep", "output=s")
    wait_for_running(tmp_path / "s", 0)
    monkeypatch.chdir(tmp_path)
    assert main(["-m", *FAULTY, "seed=0", "output=s", "--resume"]) == 2
    assert "is in use by another run" in capfd.readouterr().err
    process.kill()
    process.communicate()
    assert not alive(process.pid)


def test_a_sweep_stops_when_every_job_fails_alike(tmp_path):
    done = rhs(tmp_path, "-m", *FAULTY, "seed=range(9)", "odometry.how=raise", "output=s", "--jobs", "1", "--fail-fast", "2")
    assert done.returncode == 3
    assert "9 jobs: 2 failed, 7 skipped" in done.stdout
    assert "stopped after 2 jobs ended alike: failed: odometry=faulty" in done.stdout
    assert "ValueError at step 2" in done.stdout


def test_a_job_that_cannot_begin_is_refused_and_the_others_run(tmp_path):
    done = rhs(tmp_path, "-m", *CHOICE, "world=square_small,nowhere", "source.views=2", "output=s")
    assert done.returncode == 3
    assert statuses(tmp_path / "s") == {"world=square_small": "ok", "world=nowhere": "refused"}
    assert "refused: " in done.stdout and "nowhere" in done.stdout


def wait_for_running(sweep: Path, lines: int, seconds: float = 90) -> None:
    """Until a job of the sweep has begun, and written so many steps."""
    end = time.monotonic() + seconds
    while True:
        files = list(sweep.glob("*/steps.jsonl*")) if lines else list(sweep.glob("*/config.yaml"))
        if any(len(path.read_text().splitlines()) >= lines for path in files):
            return
        assert time.monotonic() < end, f"no job of {sweep} got going"
        time.sleep(0.05)
