"""The recording opens in Rerun with images, cloud, map, path and frames shown: its own reader says what it made of it."""

import os
import shutil
import subprocess

import pytest
from helpers.synthetic_run import CAMERA, FACTS, make_steps, room

from rhs.recording.writer import Recorder

SHOWN = {
    "/camera/image/compressed": "EncodedImage:blob", "/camera/depth": "DepthImage:buffer",
    "/camera/camera_info": "Pinhole:image_from_camera", "/cloud": "Points3D:positions",
    "/scan_points": "Points3D:positions", "/path_points": "Points3D:positions", "/map": "GridMap:data",
    "/tf": "Transform3D:translation", "/truth": "InstancePoses3D:translations",
}


def test_rerun_decodes_what_a_viewer_must_show(tmp_path):
    rerun = os.environ.get("RHS_RERUN") or shutil.which("rerun")
    if not rerun:
        pytest.skip("no rerun command; pip install 'rhs[live]', or point RHS_RERUN at one")
    recorder = Recorder(tmp_path / "run.mcap", "full", CAMERA, FACTS)
    for step in [*make_steps(4), *make_steps(4, phase="patrol", first=4)]:
        recorder.step(step)
    recorder.map(room(), 4.0)
    recorder.close()
    for words in (["mcap", "check", "run.mcap"], ["mcap", "convert", "run.mcap", "-o", "run.rrd"]):
        done = subprocess.run([rerun, *words], cwd=tmp_path, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        if words[1] == "check":
            assert {line.split()[0] for line in done.stdout.splitlines() if "  /" in line} == {"ok"}
    printed = subprocess.run([rerun, "rrd", "print", "run.rrd"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    for topic, component in SHOWN.items():
        assert any(f" {topic} " in line and component in line for line in printed.stdout.splitlines()), (topic, component)
