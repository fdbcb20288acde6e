"""Systems that are not Linux: what Windows does not have is taken away, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from rhs.base import system

WITHOUT = """
import importlib.abc, os, signal, subprocess, sys, types

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in ("fcntl", "resource", "termios", "pwd", "grp", "pybullet", "ompl"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

for name in ("fcntl", "resource", "termios", "pwd", "grp"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Absent())
locking = types.ModuleType("msvcrt")
locking.LK_NBLCK, locking.locking = 2, lambda descriptor, mode, size: None
sys.modules["msvcrt"] = locking
for name in ("fork", "getpgid", "killpg", "nice", "pread", "pwrite", "register_at_fork", "sched_getaffinity", "setsid",
             "statvfs", "sysconf", "O_NONBLOCK"):
    delattr(os, name)
for name in ("SIGALRM", "SIGCHLD", "SIGHUP", "SIGKILL", "setitimer"):
    delattr(signal, name)
from rhs.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def without_posix(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", WITHOUT, *words], capture_output=True, text=True, timeout=600)


@pytest.mark.slow
@pytest.mark.parametrize("words", [["task=planning", "world=map1"],
                                   ["task=survey", "world=square_small", "source.image_width=160", "source.step_m=0.25"]])
def test_a_run_goes_through_without_what_windows_lacks(tmp_path, words):
    """Planning and a survey led along its route, without PyBullet and OMPL too; sealed with a row that says ok."""
    done = without_posix(*words, f"output={tmp_path}/run")
    assert done.returncode == 0, done.stderr
    assert '"status": "ok"' in (tmp_path / "run" / "row.json").read_text()


@pytest.mark.slow
def test_a_sweep_without_fork_is_refused_in_a_line(tmp_path):
    done = without_posix("-m", "task=planning", "world=map1", "seed=0,1", f"output={tmp_path}/sweep")
    assert done.returncode == 2 and "fork" in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "sweep").exists()


def test_bytes_are_read_and_written_at_positions_with_pread_and_without(tmp_path, monkeypatch):
    descriptor = os.open(tmp_path / "file", os.O_RDWR | os.O_CREAT)
    system.write_at(descriptor, b"0123456789", 0)
    for name in ("pread", "pwrite"):
        monkeypatch.delattr(os, name)
    system.write_at(descriptor, b"ab", 4)
    assert system.read_at(descriptor, 6, 2) == b"23ab67"
    os.close(descriptor)
