"""--timeout and --memory-mb of a single run: its row says why it ended; options of sweeps are refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from rhs.cli import one_run

HANGS = '''
import time
from dataclasses import dataclass
from typing import ClassVar

@dataclass
class Hangs:
    """Never answers."""
    deaf: bool = False
    """whether it does not listen either"""
    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        while True:
            try:
                time.sleep(1.0)
            except BaseException:
                if not self.deaf:
                    raise
'''
BACK = HANGS.replace("Hangs", "Back").replace("import time", "import ctypes, os, signal, time").replace(
    "        while True:", """        def called():
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.2)
        ctypes.CFUNCTYPE(None)(called)()
        while True:""")
START = ("import sys; from rhs.cli import one_run; from rhs.cli.main import entry; "
         "one_run.GRACE_S = 0.5; sys.exit(entry())")


def run(folder, *words):
    (folder / "hangs.py").write_text(HANGS)
    words = ["--plugin", "hangs.py", "task=planning", "world=map1", "planner=Hangs", "output=run", *words]
    return subprocess.run([sys.executable, "-c", START, *words], cwd=folder, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(("words", "status", "reason"), [
    (["--timeout", "4"], "timeout", "took longer than the 4 s of --timeout in planner=Hangs"),
    (["--timeout", "1", "planner.deaf=true"], "timeout", "took longer than the 1 s of --timeout"),
    (["--memory-mb", "20"], "killed", "took more memory than the 20 MB of --memory-mb")])
def test_a_run_that_hangs_ends_with_a_row_that_says_why(tmp_path, words, status, reason):
    done = run(tmp_path, *words)
    row = json.loads((tmp_path / "run" / "row.json").read_text())
    assert done.returncode == 1 and row["status"] == status and row["reason"].startswith(reason) and row["success"] == 0.0
    assert f"rhs: {status}: {reason}" in done.stderr and done.stderr.count("rhs: ") == 1


def test_a_signal_that_comes_as_a_library_calls_back_is_not_lost(tmp_path):
    (tmp_path / "back.py").write_text(BACK)
    words = ["--plugin", "back.py", "task=planning", "world=map1", "planner=Back", "output=run"]
    done = subprocess.run([sys.executable, "-m", "rhs", *words], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    row = json.loads((tmp_path / "run" / "row.json").read_text())
    assert done.returncode == 143 and row["status"] == "interrupted" and done.stderr.count("rhs: ") == 1, done.stderr


@pytest.mark.parametrize(("words", "says"), [
    (["--jobs", "2"], "--jobs is for the jobs of a sweep; add -m, or leave it out"),
    (["--retries", "0"], "--retries is for the jobs of a sweep"), (["--timeout", "-1"], "--timeout=-1"),
    (["--memory-mb", "nan"], "--memory-mb=nan")])
def test_what_is_no_limit_of_one_run_is_refused(tmp_path, words, says):
    done = run(tmp_path, *words)
    assert done.returncode == 2 and says in done.stderr and not (tmp_path / "run").exists()


def test_a_run_that_ends_in_time_or_is_stopped_by_somebody_is_none_of_the_limits_business(tmp_path):
    with one_run.RunLimits(tmp_path, 100.0, 1e6) as within:
        pass
    for row in ({"status": "ok"}, {"status": "interrupted", "reason": "interrupted at step 3"}):
        assert within.told(row) is row and not os.listdir(tmp_path)
