"""Jobs that differ only after the survey share one: rows as of jobs alone, and a job still fails alone."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, environment, installed

from rhs.base.processes import children
from rhs.config.compose import compose_config
from rhs.patrol.shared import survey_key
from rhs.runfolder.row import canonical_hash, read_row

CHAIN = [word for word in CHOICE if not word.startswith("localiser=")]
SWEEP = [*CHAIN, "localiser=fake,leaver", "planner.samples=5,6,7"]


def start(folder: Path, *words: str) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES),
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)


def rhs(folder: Path, *words: str) -> str:
    return start(folder, *words).communicate(timeout=200)[0]


def hashes(sweep: Path) -> dict[str, str]:
    return {path.parent.name: canonical_hash(read_row(path)) for path in sweep.glob("*/row.json")}


def surveys(sweep: Path) -> list[str]:
    """The survey's rows of steps.csv, times and all, of the runs that ended well: no two surveys take the same time."""
    files = [path.parent / "steps.csv" for path in sorted(sweep.glob("*/row.json")) if read_row(path)["status"] == "ok"]
    return ["".join(line for line in path.read_text().splitlines() if ",survey," in line) for path in files]


@pytest.fixture(scope="module")
def shared(tmp_path_factory) -> Path:
    """Six jobs with one survey; the localiser of three ends its process by os._exit."""
    folder = tmp_path_factory.mktemp("shared")
    said = rhs(folder, "-m", *SWEEP, "output=s", "--jobs", "2")
    assert "6 jobs: 3 ok, 3 failed" in said, said
    return folder / "s"


def test_one_survey_gives_the_rows_of_six(shared, tmp_path):
    said = rhs(tmp_path, "-m", *SWEEP, "output=s", "share=false", "--jobs", "2")
    assert "6 jobs: 3 ok, 3 failed" in said, said
    alone = tmp_path / "s"
    assert hashes(shared) == hashes(alone)
    assert (len(set(surveys(shared))), len(set(surveys(alone)))) == (1, 3)
    for run in hashes(alone):
        assert {path.name for path in (shared / run).iterdir()} == {path.name for path in (alone / run).iterdir()}
        assert (shared / run / "config.yaml").read_bytes() == (alone / run / "config.yaml").read_bytes()
        if "localiser=fake" in run:
            assert (shared / run / "run.mcap").read_bytes() == (alone / run / "run.mcap").read_bytes()


def test_a_job_that_ends_its_process_costs_one_row(shared):
    rows = [read_row(path) for path in shared.glob("*/row.json")]
    assert sorted((row["localiser"], row["status"]) for row in rows) == [("fake", "ok")] * 3 + [("leaver", "failed")] * 3
    assert {row["reason"] for row in rows if row["status"] == "failed"} == {
        "a part ended the process by os._exit(3) at step 8"}
    assert not list(shared.glob(".survey*")) and not (shared / "not_shared.log").exists()


def test_a_group_half_done_is_resumed(shared, tmp_path):
    sweep = tmp_path / "s"
    shutil.copytree(shared, sweep)
    kept, *lost = [path.parent for path in sorted(sweep.glob("*localiser=fake*/row.json"))]
    before = (kept / "row.json").stat().st_mtime_ns
    for folder in lost:
        shutil.rmtree(folder)
    said = rhs(tmp_path, "--resume", "s", "--jobs", "2")
    assert "6 jobs: 3 ok, 3 failed (1 finished before)" in said, said
    assert hashes(sweep) == hashes(shared) and (kept / "row.json").stat().st_mtime_ns == before


def test_who_kills_the_process_of_the_survey_costs_no_row(shared, tmp_path):
    words = [*CHAIN, "localiser=fake", "planner.samples=5,6,7", "source.delay_s=0.03"]
    process = start(tmp_path, "-m", *words, "output=s", "--jobs", "2")
    while process.poll() is None and not list(tmp_path.glob("s/planner*/steps.jsonl.tmp-*")):
        time.sleep(0.01)
    leaders = [pid for server in children(process.pid) for pid in children(server) if children(pid)]
    assert len(leaders) == 1
    os.kill(leaders[0], signal.SIGKILL)
    said = process.communicate(timeout=200)[0]
    assert "3 jobs: 3 ok" in said, said
    assert len(hashes(tmp_path / "s")) == 3 and not list(tmp_path.glob("s/.survey*"))


def test_a_survey_that_fails_fails_in_each_row(tmp_path):
    """Also one whose parts hold a file open, of which forked processes would share the place, is left to each job."""
    chain = [word for word in CHAIN if not word.startswith("odometry=")]
    said = rhs(tmp_path, "-m", *chain, "localiser=fake,vandal", "odometry=faulty", "odometry.how=raise,leak", "output=s",
               "--jobs", "2")
    rows = [read_row(path) for path in (tmp_path / "s").glob("*/row.json")]
    assert len(rows) == 4, said
    told = (tmp_path / "s" / "not_shared.log").read_text()
    assert "and 1 more: " in told
    failed = {str(row["reason"]) for row in rows if row["status"] == "failed"}
    assert len(failed) == 1 and "at step 2" in failed.pop()


def test_what_comes_after_the_survey_is_left_out_of_its_key():
    with installed(FAKES):
        def key(*words: str) -> str | None:
            return survey_key(compose_config([*CHOICE, "recording=light", "pictures=off", *words]))

        first = key()
        assert first and first == key("planner.samples=5") == key("mission.arrive_m=0.5") == key("localiser=vandal")
        assert first == key("output=elsewhere", "replan=wait")
        others = [key("seed=1"), key("odometry=fake_blind"), key("source.views=7"), key("gate.patience=11"),
                  key("places.every=2"), key("features.count=99"), key("obstacles=[[3,3,1,1]]"), key("recording=off")]
        assert len({first, *others}) == 1 + len(others)
        assert key("recording=full") is None and key("pictures=page") is None
        survey = [word for word in CHOICE if not word.startswith(("planner", "localiser"))]
        assert survey_key(compose_config([*survey, "recording=light", "task=survey"])) is None
