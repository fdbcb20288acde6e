"""Sweeps beside other sweeps and other code of their process: threads, forked children, workers of a pool."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor

import pytest

import rhs
from rhs.config.compose import compose_config
from rhs.runfolder.row import read_row
from rhs.sweeps import jobs
from rhs.sweeps.job import Job, Limits


@pytest.fixture
def pool(tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "_idle", [])
    return lambda: jobs._Pool(iter(()), tmp_path, Limits(1), lambda job, status: None)


def test_no_two_sweeps_at_a_time_have_one_server_and_the_next_takes_one_that_is_free(pool):
    """Seen: of three sweeps in threads, one killed the jobs of another as orphans of its own."""
    first, second = pool(), pool()
    assert first.server is not second.server
    first.close()
    third = pool()
    assert third.server is first.server
    second.close(), third.close()


def test_a_forked_child_has_no_use_for_the_server_of_its_parent(pool):
    pool().close()
    jobs._idle[:] = [(os.getpid() + 1, server) for _, server in jobs._idle]
    child = pool()
    assert child.server is not jobs._idle[0][1]
    child.close()


def test_a_worker_of_a_pool_is_told_where_to_sweep(monkeypatch):
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(rhs.RhsError, match="call it in the parent, or in a concurrent.futures.ProcessPoolExecutor"):
        rhs.sweep(["seed=0,1"], quiet=True)


def test_a_job_that_cannot_be_started_has_its_row(tmp_path, monkeypatch):
    def nothing(*_):
        raise ChildProcessError("no child processes")

    monkeypatch.setattr(jobs._Pool, "_start", nothing)
    config = compose_config(["task=planning", "world=map1"])
    outcome = jobs.run_jobs([Job("one", config, ())], tmp_path, Limits(1, retries=0), tell=lambda job, status: None)
    row = read_row(tmp_path / "one" / "row.json")
    assert outcome.counts["killed"] == 1
    assert row["status"] == "killed" and row["reason"] == "it could not be started: ChildProcessError: no child processes"


def test_configurations_are_composed_in_any_number_of_threads():
    """Seen: `GlobalHydra is already initialized`."""
    with ThreadPoolExecutor(6) as threads:
        found = list(threads.map(lambda seed: compose_config(["planner=rrt", f"seed={seed}"]).seed, range(12)))
    assert found == list(range(12))
