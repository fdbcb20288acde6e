"""What a stranger's part does to its process: crashes it, takes its output away, leaves things for the next run."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

import rhs
from rhs.api.errors import RhsError
from rhs.api.files import replacing
from rhs.base.commands import not_written
from rhs.config import registry
from rhs.sweeps import ending

PLANNER = '''"""Does to its process what a part must not."""
import os
import sys
import threading
import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api.records import Path, PlanReason


@dataclass
class Rude:
    """Straight to the goal."""

    how: str = "learns"
    """what it does"""
    learnt: ClassVar[list[int]] = []
    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        if self.how == "aborts":
            os.abort()
        if self.how == "silences":
            sys.stdout = None
        if self.how == "closes":
            sys.stdout.close()
        if self.how == "litters":
            for number in range(3):
                warnings.warn(f"{number} is odd")
                thread = threading.Thread(target=int, args=("x",))
                thread.start()
                thread.join()
        if self.how == "learns":
            self.learnt.append(1)
        if self.how == "moves":
            os.chdir("/")
            np.seterr(all="raise")
        return Path(PlanReason.OK, np.vstack([problem.start_m, problem.goal_m]))
'''
WORDS = ["task=planning", "world=map1", "pictures=off", "planner=rude"]


@pytest.fixture
def rude(tmp_path, monkeypatch):
    (tmp_path / "rude_planner.py").write_text(PLANNER, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    import rude_planner

    yield rude_planner.Rude
    sys.modules.pop("rude_planner")
    registry._by_hand.clear()
    registry.forget()


def typed(folder, *words):
    return subprocess.run([sys.executable, "-m", "rhs", "--plugin", "rude_planner.py", *WORDS, *words], cwd=folder,
                          capture_output=True, text=True, timeout=180, check=False)


def test_a_part_that_crashes_the_process_is_told_with_its_line(rude, tmp_path):
    line = 1 + PLANNER.splitlines().index("            os.abort()")
    alone = typed(tmp_path, "planner.how=aborts")
    assert alone.returncode == -6 and f'rude_planner.py", line {line} in plan' in alone.stderr
    swept = typed(tmp_path, "-m", "planner.how=aborts", "--jobs", "1", "--retries", "0")
    assert f"killed by SIGABRT in {tmp_path.name}/rude_planner.py:{line}" in swept.stdout


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_a_run_without_streams_is_a_run(closed, tmp_path):
    command = f"{sys.executable} -m rhs task=planning world=map1 pictures=off output=run {closed}"
    assert subprocess.run(command, shell=True, cwd=tmp_path, timeout=180, check=False).returncode == 0
    assert rhs.load_run(tmp_path / "run").row["status"] == "ok"


def test_a_disk_that_cannot_be_written_to_is_told_with_what_to_do(monkeypatch, tmp_path):
    said = not_written(OSError(errno.EROFS, "Read-only file system", "results"))
    assert said.startswith("cannot write results: Read-only file system; ") and "output=FOLDER" in said
    assert not_written(FileNotFoundError(errno.ENOENT, "No such file", "results")) == ""
    assert "no space" not in ending._fate(1, tmp_path)[1]
    monkeypatch.setattr(ending, "free_mb", lambda folder: 0.2)
    assert "no space is left on the disk" in ending._fate(1, tmp_path)[1]


def test_what_to_do_about_a_file_follows_from_why_it_cannot_be_written(tmp_path):
    """Of a folder that a part had removed, and of too many open files, `free some space` was said."""
    with pytest.raises(RhsError, match="its folder was removed under way"), replacing(tmp_path / "gone" / "row.json"):
        pass
    with pytest.raises(RhsError, match="a part may keep files open"), replacing(tmp_path / "row.json"):
        raise OSError(errno.EMFILE, "Too many open files")
    with pytest.raises(RhsError, match="free some space"), replacing(tmp_path / "row.json"):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_job_log_without_a_crash_names_nobody(tmp_path):
    assert ending._crashed_in(tmp_path) == ""
    (tmp_path / "job.log").write_text('  File "/a/b.py", line 3 in plan\n')
    assert ending._crashed_in(tmp_path) == ""


@pytest.mark.parametrize("how", ["silences", "closes"])
def test_the_table_is_printed_though_a_part_took_stdout_away(how, rude, tmp_path):
    said = typed(tmp_path, f"planner.how={how}")
    assert "files: " in said.stdout and said.stderr.startswith("rhs: not achieved") and said.returncode == 3


def test_what_a_part_warns_of_and_what_fails_in_its_threads_is_a_line_for_each_place(rude, tmp_path):
    """Each thread's traceback was printed, and each warning whose text held another number."""
    warned, failed, _ = typed(tmp_path, "planner.how=litters").stderr.splitlines()
    assert warned.startswith("rhs: warning in ") and warned.endswith("UserWarning: 0 is odd")
    assert failed.startswith("rhs: error in a thread, ") and "ValueError: invalid literal for int()" in failed


def test_what_a_run_leaves_for_the_next_one_in_its_process_is_said_and_put_back(rude, tmp_path):
    def run(how):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            row = rhs.run({"task": "planning", "world": "map1", "pictures": "off", "planner": rude(how)}, quiet=True)
        assert row["status"] == "ok"
        return [str(one.message) for one in told if one.filename == __file__]

    before = np.geterr()
    assert run("moves") == [] and os.getcwd() == str(tmp_path) and np.geterr() == before
    assert [text.partition(":")[0] for text in run("learns")] == ["this run changed Rude.learnt"]
