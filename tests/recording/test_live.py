"""The live view: refused early where it cannot be; what it streams can be read back by Rerun."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.synthetic_run import CAMERA, make_steps, room

from rhs.api.errors import ConfigError
from rhs.recording.rerun_view import Audience, LiveView, check_live


def test_off_needs_nothing():
    check_live("")


def test_nonsense_is_refused_with_what_is_possible():
    with pytest.raises(ConfigError, match="viewer .*rrd"):
        check_live("yes")


def test_a_missing_viewer_says_what_to_type(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'rhs\[live\]'"):
        check_live("viewer")


def test_an_audience_hears_everything():
    heard: list = []

    class Ear:
        def step(self, step):
            heard.append(step.index)

        def map(self, grid, stamp_s):
            heard.append("map")

        def close(self, status="ok", reason=""):
            heard.append(status)

    audience = Audience([Ear(), Ear()])
    for step in make_steps(2):
        audience.step(step)
    audience.map(room(), 1.0)
    audience.close("failed")
    assert heard == [0, 0, 1, 1, "map", "map", "failed", "failed"]


def test_what_is_streamed_is_there(tmp_path):
    pytest.importorskip("rerun", reason="rerun is not installed; pip install 'rhs[live]'")
    view = LiveView(str(tmp_path / "run.rrd"), CAMERA)
    for phase in ("survey", "patrol"):
        for step in make_steps(4, phase=phase):
            view.step(step)
    view.map(room(), 2.0)
    view.close()
    rerun = Path(sys.executable).with_name("rerun")
    command = [str(rerun), "rrd", "print"] if rerun.exists() else [sys.executable, "-m", "rerun", "rrd", "print"]
    done = subprocess.run([*command, str(tmp_path / "run.rrd")], capture_output=True, text=True, timeout=60)
    for name in ("/world/robot/camera/image", "/world/robot/camera/depth", "/world/plan", "/world/map",
                 "/world/survey_true", "/numbers/error_m"):
        assert name in done.stdout, (name, done.stderr)
