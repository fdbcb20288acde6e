"""Inputs that are small and ask for much: refused in one line, before anything is counted out, unpacked or waited for."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from faults.files import png
from installing import CHOICE, FAKES, environment

MOST_MB, MOST_S = 500.0, 1.0  # of memory; of CPU time beyond what any refusal takes, which is a second on an idle core


# Between this process and the command stands a small one: what a child holds is counted from what its parent held.
MEASURE = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
print(os.waitstatus_to_exitcode(status), usage.ru_maxrss / 1024, usage.ru_utime + usage.ru_stime)
"""


def measured(folder: Path, words: list[str], **more: str) -> tuple[int, float, float, str]:
    """(exit code, most memory in MB, CPU seconds, what it wrote to stderr) of a command."""
    done = subprocess.run([sys.executable, "-S", "-c", MEASURE, sys.executable, "-m", *words], cwd=folder, text=True,
                          env=environment(FAKES, **more), capture_output=True)
    code, peak_mb, cpu_s = done.stdout.split()
    return int(code), float(peak_mb), float(cpu_s), done.stderr


@cache
def usual_s() -> float:
    """CPU time of a refusal of nothing special on this machine, now."""
    return measured(Path(), ["rhs", "task=planning", "world=nowhere"])[2]


def refused(folder: Path, *words: str, module: str = "rhs", code: int | tuple[int, ...] = 2, **more: str) -> str:
    """The one line of a command that must refuse, within the limits."""
    returned, peak_mb, cpu_s, error = measured(folder, [module, *words], **more)
    assert returned in ((code,) if isinstance(code, int) else code), error
    assert len(error.splitlines()) == 1 and len(error) < 260, error
    assert peak_mb < MOST_MB and cpu_s < MOST_S + usual_s()
    return error


# --- words -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "says"), [
    (["-m", "seed=range(10000000000)"], "1e+10 jobs; at most 100000"), (["-m", "seed=range(1e300)"], "at most 100000"),
    (["-m", "seed=range(0,1,0)"], "the step not 0"), (["-m", "seed=interval(0,1)"], "an interval has no values"),
    (["seed=" + "9" * 5000], "4300 digits"), (["obstacles=" + "[" * 5000 + "]" * 5000], "nested more deeply than 64"),
    (["output='~nosuchuser/x'"], "nosuchuser"), (["--resume"], "which sweep?"), (["--resume", "seed=3"], "which sweep?"),
    (["-m", "seed=0", "--memory-mb", "-1"], "outside the allowed range"),
])
def test_words(tmp_path, words, says):
    assert says in refused(tmp_path, *CHOICE, *words)
    assert list(tmp_path.iterdir()) == []


# --- files -----------------------------------------------------------------------------------------------------------


def tum(folder: Path, colour: bytes, depth: bytes) -> None:
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    (folder / "rgb" / "1.png").write_bytes(colour)
    (folder / "depth" / "1.png").write_bytes(depth)
    (folder / "rgb.txt").write_text("1.0 rgb/1.png\n")
    (folder / "depth.txt").write_text("1.0 depth/1.png\n")


def test_images_of_recordings(tmp_path):
    tum(tmp_path / "bomb", png(20000, 20000), png(64, 48, bits=16))
    words = ["task=survey", "source=replay", "source.path=bomb", "source.camera=[50,50,32,24]", "output=o"]
    assert "20000 x 20000 pixels" in refused(tmp_path, *words)
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("what", ["fifo", "device"])
def test_what_is_no_file_is_not_read(tmp_path, what):
    if what == "fifo":
        for name in ("x.mcap", "x.yaml", "x.tum", "x.map"):
            os.mkfifo(tmp_path / name)
    else:
        for name in ("x.mcap", "x.yaml", "x.tum", "x.map"):
            (tmp_path / name).symlink_to("/dev/zero")
    refused(tmp_path, "x.mcap", "out.mcap", module="rhs.convert")
    refused(tmp_path, "x.tum", "x.tum", module="rhs.evaluate")
    refused(tmp_path, "task=planning", "world=x.yaml")
    refused(tmp_path, "task=planning", "world=x.map", "start=[1,1]", "goal=[2,2]")
    refused(tmp_path, "task=survey", "source=replay", "source.path=x.mcap")


# --- plugins ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_plugin_that_never_ends_importing_does_not_hang_the_help(tmp_path):
    (tmp_path / "slow-1.0.dist-info").mkdir()
    (tmp_path / "slow-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: slow\nVersion: 1.0\n")
    (tmp_path / "slow-1.0.dist-info" / "entry_points.txt").write_text("[rhs.planner]\nsleepy = sleepy:Sleepy\n")
    (tmp_path / "sleepy.py").write_text("import time\ntry:\n    time.sleep(3600)\nexcept Exception:\n    time.sleep(3600)\n")
    done = subprocess.run([sys.executable, "-m", "rhs", "help", "planner"], cwd=tmp_path, env=environment(tmp_path),
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0
    told = done.stdout[done.stdout.index("planner=sleepy"):][:300]
    assert "NOT USABLE" in told and "took longer than" in " ".join(told.split())
