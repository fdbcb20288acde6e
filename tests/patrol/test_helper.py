"""The process beside a run: what it gives is what the run itself would give, and it ends with the run."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.synthetic_run import make_steps

from rhs.api.records import FeatureSettings, View
from rhs.base import processes
from rhs.estimation.views.features import features
from rhs.patrol.helper import Helper, pictures
from rhs.patrol.sights import Sights


@pytest.fixture
def helper():
    begun = Helper()
    yield begun
    begun.close()
    begun.close()


def test_it_gives_what_a_function_gives_and_raises_what_it_raises(helper):
    assert helper.ask(math.hypot, 3.0, 4.0) == 5.0
    with pytest.raises(ValueError, match="invalid literal"):
        helper.ask(int, "x")
    helper.ask(print, "not an answer")
    assert helper.ask(os.getpid) == helper._process.pid


def test_one_that_was_killed_or_closed_says_so(helper):
    helper._process.kill()
    with pytest.raises((OSError, EOFError)):
        helper.ask(int)
    helper.close()
    with pytest.raises(EOFError):
        helper.ask(int)


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no masks of signals on this system")
def test_a_ctrl_c_is_the_runs(helper):
    for number in (signal.SIGINT, signal.SIGTERM):
        os.kill(helper._process.pid, number)
    assert helper.ask(int) == 0
    assert not {signal.SIGINT, signal.SIGTERM} & signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="prctl is Linux's")
def test_it_ends_with_a_run_that_is_killed(tmp_path):
    code = ("import os, time; from rhs.patrol.helper import Helper\n"
            "print(Helper().ask(os.getpid), flush=True); time.sleep(60)")
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as run:
        pid = int(run.stdout.readline())
        assert Path(f"/proc/{pid}").exists()
        run.kill()
    until = time.monotonic() + 10.0
    while Path(f"/proc/{pid}").exists() and not processes._is_zombie(pid) and time.monotonic() < until:
        time.sleep(0.02)
    assert not Path(f"/proc/{pid}").exists() or processes._is_zombie(pid)


def test_a_folder_is_drawn_and_what_cannot_be_drawn_is_said(helper, tmp_path):
    helper.ask(pictures, tmp_path)  # nothing to be drawn
    (tmp_path / "plan.json").write_text("{")
    with pytest.raises(Exception, match=r"map\.yaml"):
        helper.ask(pictures, tmp_path)


def compared(folder: Path, helper: Helper | None) -> str:
    """What Sights say of a view of a survey, seen again: JSON."""
    steps, settings = list(make_steps(7)), FeatureSettings()
    sights = Sights(3, settings, helper)
    list(sights.watch(steps))
    views = [View(step.index, step.stamp_s, step.observation.camera, step.motion, step.belief.map_from_body,
                  step.belief.covariance, None, features(step.observation, settings)) for step in steps]
    sights.settle(views)
    sights.compare(replace(steps[3]), "01_east", folder, rng=np.random.default_rng(0))
    return json.dumps(sights.rows)


@pytest.mark.parametrize("killed", [False, True])
def test_places_are_compared_beside_the_run_as_in_it_whatever_becomes_of_the_helper(helper, tmp_path, killed):
    if killed:
        helper._process.kill()
    folders = tmp_path / "a", tmp_path / "b"
    assert compared(folders[0], helper) == compared(folders[1], None)
    ours, theirs = ({path.name: path.read_bytes() for path in folder.glob("*")} for folder in folders)
    assert ours == theirs and ours
