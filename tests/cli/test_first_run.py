"""The first run of an installation: its inner loops are compiled ahead by a process beside it, which nobody notices."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rhs.base import processes
from rhs.base.processes import die_with_parent
from rhs.cli import first_run
from rhs.cli.one_run import COMPILES

RUN = ["world=square_small", "recording=off", "pictures=off", "ahead=off", "source.image_width=160"]
ALONE = "import os; from rhs.cli.first_run import compile_ahead; compile_ahead(os.getppid())"
BEGIN = """
import os, sys, time
from rhs.base.processes import children
from rhs.cli import first_run
if sys.argv[1:] == ["allowed"]:
    from rhs.base.processes import allow_helpers; allow_helpers()
first_run.begin()
first_run.begin()
print(*children(os.getpid()), flush=True)
time.sleep(float(60 * len(sys.argv[1:])))
"""


def process(cache: Path | None, *words: str) -> subprocess.Popen:
    """Python with these words. cache: the folder of compiled loops; None: as usual."""
    environment = {**os.environ, **({} if cache is None else {"NUMBA_CACHE_DIR": str(cache)})}
    return subprocess.Popen([sys.executable, *words], env=environment, text=True, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, preexec_fn=die_with_parent)


def row_of(folder: Path) -> dict:
    row = json.loads((folder / "row.json").read_text())
    return {key: value for key, value in row.items()
            if not key.endswith("_ms") and key not in ("peak_memory_mb", "real_time_factor")}


@pytest.mark.benchmark  # compiles all of it twice over: run apart when kernels change
def test_after_what_is_listed_is_compiled_a_run_compiles_nothing_and_leaves_the_same_row(tmp_path):
    """A row with loops that another process compiled is that of a run that compiled them itself, or had them."""
    assert process(tmp_path / "cache", "-c", ALONE).wait(300) == 0
    rows = []
    for name, cache in (("ahead", tmp_path / "cache"), ("usual", None)):
        run = process(cache, "-m", "rhs", *RUN, f"output={tmp_path / name}")
        said = run.communicate(timeout=300)[1]
        assert run.returncode == 0, said
        assert name == "usual" or COMPILES not in said, f"conf/kernels.txt lacks one of {fresh(tmp_path)}"
        rows.append(row_of(tmp_path / name))
    assert rows[0] == rows[1]


def fresh(tmp_path: Path) -> list[str]:
    """The loops that the run compiled: their files are younger than the run folder's first."""
    since = min(file.stat().st_mtime for file in (tmp_path / "ahead").iterdir())
    return sorted(file.name for file in (tmp_path / "cache").rglob("*.nbc") if file.stat().st_mtime > since)


def test_the_process_begins_once_and_ends_with_the_run(tmp_path):
    run = process(tmp_path, "-c", BEGIN, "allowed")
    started = run.stdout.readline().split()
    assert len(started) == 1
    beside = Path(f"/proc/{started[0]}")
    waited_until = time.monotonic() + 20.0
    while not (words := (beside / "cmdline").read_bytes()):  # noted after its pipes are closed
        assert time.monotonic() < waited_until
    assert b"compile_ahead" in words
    run.kill()
    run.wait()
    while beside.exists() and (beside / "stat").read_text().rpartition(")")[2].split()[0] != "Z":
        assert time.monotonic() < waited_until
        time.sleep(0.05)


def test_what_is_no_command_of_its_own_begins_none(tmp_path):
    assert process(tmp_path, "-c", BEGIN).communicate(timeout=60)[0].split() == []


def test_none_begins_where_nothing_is_kept_on_disk(monkeypatch):
    import rhs.api.jit

    begun = []
    monkeypatch.setattr(subprocess, "Popen", lambda *words, **_: begun.append(words))
    monkeypatch.setattr(processes, "_helpers", True)
    for kept in (False, True):
        monkeypatch.setattr(rhs.api.jit, "_kept_on_disk", kept)
        first_run.begin.__wrapped__()
        assert len(begun) == kept


def test_a_process_that_cannot_be_started_is_not_missed(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    monkeypatch.setattr(processes, "_helpers", True)
    first_run.begin.__wrapped__()


def test_every_line_of_the_list_names_what_is_there():
    from importlib import import_module

    for module, function, signature in first_run.listed():
        found = import_module(module)
        assert not function or callable(getattr(found, function)), (module, function)
        assert bool(function) == bool(signature)
