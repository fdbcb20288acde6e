"""Surveys that differ only in what is made of their views have these drawn once: rows as of jobs alone."""

from __future__ import annotations

import csv
import os
import signal
import time
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, installed
from test_sharing import hashes, rhs, start

from rhs.base.errors import RhsError
from rhs.base.processes import children
from rhs.config.compose import compose_config
from rhs.patrol import shared
from rhs.patrol.shared import draw_views, views_key
from rhs.runfolder.row import read_row

CHAIN = [word for word in CHOICE if not word.startswith(("odometry=", "sensor="))]
WORDS = [*CHAIN, "sensor=fake", "source.ahead=true", "odometry=fake,fake_blind,faulty"]
SURVEYS = [word for word in WORDS if not word.startswith(("planner", "localiser"))]


def times(sweep: Path, stage: str) -> set[tuple[str, ...]]:
    """The milliseconds of a stage in the survey's steps, once for each run of which they are others."""
    found = set()
    for path in sweep.glob("*/steps.csv"):
        with path.open() as file:
            found.add(tuple(row[stage] for row in csv.DictReader(file) if row["phase"] == "survey"))
    return found


@pytest.mark.parametrize(("words", "jobs"), [([*WORDS, "planner.samples=5,6"], 6), ([*SURVEYS, "task=survey"], 3)])
def test_views_drawn_once_give_the_rows_of_views_drawn_by_each(tmp_path, words, jobs):
    for name, more in (("once", []), ("each", ["share=false"])):
        said = rhs(tmp_path, "-m", *words, *more, f"output={name}", "--jobs", "1", "cache=false")
        assert f"{jobs} jobs: {jobs} ok" in said, said
    once, each = tmp_path / "once", tmp_path / "each"
    assert hashes(once) == hashes(each) and len(hashes(once)) == jobs
    assert (len(times(once, "capture_ms")), len(times(each, "capture_ms"))) == (1, jobs)
    assert len(times(once, "odometry_ms")) == 3
    assert not list(once.glob(".survey*")) and not (once / "not_shared.log").exists()
    for run in hashes(each):
        assert (once / run / "run.mcap").read_bytes() == (each / run / "run.mcap").read_bytes()


def test_an_odometry_that_ends_its_process_costs_its_own_rows(tmp_path):
    words = [word for word in WORDS if not word.startswith("odometry")]
    words += ["odometry=faulty", "odometry.how=none,os_exit,raise", "planner.samples=5,6"]
    said = rhs(tmp_path, "-m", *words, "output=s", "--jobs", "2")
    rows = [read_row(path) for path in (tmp_path / "s").glob("*/row.json")]
    assert sorted(row["status"] for row in rows) == ["failed"] * 4 + ["ok"] * 2, said


def test_who_kills_the_process_of_the_views_costs_no_row(tmp_path):
    process = start(tmp_path, "-m", *WORDS, "planner.samples=5,6", "source.delay_s=0.03", "output=s", "--jobs", "1")
    while process.poll() is None and not list(tmp_path.glob("s/*/steps.jsonl.tmp-*")):
        time.sleep(0.01)
    holders = [pid for server in children(process.pid) for pid in children(server) if children(pid)]
    assert len(holders) == 1
    os.kill(holders[0], signal.SIGKILL)
    said = process.communicate(timeout=200)[0]
    assert "6 jobs: 6 ok" in said, said
    assert len(hashes(tmp_path / "s")) == 6 and not list(tmp_path.glob("s/.survey*"))


def test_what_is_made_of_the_views_is_left_out_of_their_key():
    with installed(FAKES):
        def key(*words: str) -> str | None:
            return views_key(compose_config([*CHOICE, *words]))

        first = key()
        assert first and first == key("planner.samples=5") == key("odometry=fake_blind") == key("gate.patience=11")
        assert first == key("places.every=2", "recording=full", "pictures=on", "localiser=vandal")
        others = [key("seed=1"), key("source.views=7"), key("features.count=99"), key("obstacles=[[3,3,1,1]]"),
                  key("world=square_small"), key("people_count=1")]
        assert len({first, *others}) == 1 + len(others)
        assert key("mission.survey=explore") is None
        slam = [word for word in CHOICE if word.startswith(("source", "sensor", "planner"))]
        assert views_key(compose_config([*slam, "slam=fake"])) is None


def test_views_that_cannot_be_kept_are_refused_with_the_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(shared, "_check_forkable", lambda before, folder: None)  # of a process that does nothing else
    with installed(FAKES):
        ahead = compose_config([*CHOICE, "source.ahead=true"])
        assert len(draw_views(ahead, tmp_path).seen) == 6
        with pytest.raises(RhsError, match="wants to be asked view by view"):
            draw_views(compose_config(CHOICE), tmp_path)
        monkeypatch.setattr(shared, "MOST_MB", 0.0)
        with pytest.raises(RhsError, match="MB of views are too many to be kept"):
            draw_views(ahead, tmp_path)
