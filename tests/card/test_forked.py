"""Work in a process of its own, whatever becomes of it."""

from __future__ import annotations

import mmap
import os
import tempfile
import time

import numpy as np
import pytest

from rhs.card.card import verdict
from rhs.card.forked import queued_s, run_forked


def test_what_was_said_before_the_end_is_heard():
    def ends():
        yield 1
        yield 2
        os._exit(7)

    result = run_forked(ends, patience_s=5.0)
    assert result.items == [1, 2] and "exit code 7" in result.ended


def test_an_error_is_named_and_a_silence_ends():
    def raises():
        yield "first"
        raise ValueError("of mine")

    def hangs():
        yield "first"
        time.sleep(60)

    assert run_forked(raises, patience_s=5.0).ended.startswith("ValueError: of mine (test_forked.py:")
    began = time.monotonic()
    result = run_forked(hangs, patience_s=0.3)
    assert result.items == ["first"] and result.ended == "no answer for 0.3 s" and time.monotonic() - began < 10


def test_a_part_that_forks_is_heard_once():
    def forks():
        for k in range(3):
            os.fork()
            yield k

    result = run_forked(forks, patience_s=5.0)
    assert result.items == [0, 1, 2] and not result.ended


def test_memory_and_time_are_its_own():
    def takes():
        kept = np.frombuffer(mmap.mmap(-1, 64_000_000))  # 61 MiB that no freed block of this process can serve
        kept[:] = 1.0
        yield float(kept.sum())

    result = run_forked(takes, patience_s=20.0)
    assert 50 < result.memory_mb < 150 and result.cpu_s < 5 and not result.ended


@pytest.mark.skipif(np.isnan(queued_s()), reason="the system does not tell who stands in line")
def test_what_sleeps_is_told_from_what_computes():
    def sleeps():
        time.sleep(0.5)
        yield 1

    def computes():
        began = time.process_time()
        while time.process_time() - began < 0.3:
            pass
        yield 1

    assert run_forked(sleeps, patience_s=30.0).waited_share > 0.8
    assert run_forked(computes, patience_s=30.0).waited_share < 0.1
    said = verdict({"part": "planner=mine", "contract": [], "waited_share": 0.95})
    assert said[1].startswith("waits for 95 % of its time")


def test_one_of_ours_that_did_not_come_to_its_end_beside_a_part_is_named():
    said = verdict({"part": "planner=mine", "contract": [], "ended": {"planner=mine": "", "planner=astar": "no answer"}})
    assert said[-1] == "beside it, planner=astar did not come to its end: no answer"


def test_a_part_that_stands_in_line_for_a_processor_is_waited_for(monkeypatch):
    """Of a machine so busy that it stood in line for two seconds of the first tenth."""
    waited = iter([5.0, 7.0, 7.0, 7.0])
    monkeypatch.setattr("rhs.card.forked.queued_s", lambda pid=None: next(waited) if pid else 0.0)

    def slow():
        time.sleep(0.4)
        yield "answer"

    assert run_forked(slow, patience_s=0.1).items == ["answer"]


def test_what_is_killed_leaves_no_temporary_files(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def hangs():
        tempfile.mkdtemp()
        yield len(list(tmp_path.rglob("*")))
        time.sleep(60)

    assert run_forked(hangs, patience_s=0.3).items == [2] and list(tmp_path.iterdir()) == []
