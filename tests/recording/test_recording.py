"""A recording holds what was put in, and other programs can read it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.synthetic_run import CAMERA, FACTS, make_steps, room

import rhs
from rhs.patrol.observers import _foretell
from rhs.recording.reader import read, read_head
from rhs.recording.ros import nanoseconds, seconds
from rhs.recording.writer import Recorder, bytes_a_view


def record(path, level="full", count=6):
    recorder = Recorder(path, level, CAMERA, FACTS)
    for step in make_steps(count):
        recorder.step(step)
    recorder.map(room(), 0.4 * count)
    recorder.close()
    return path


def test_rosbags_reads_every_topic(tmp_path):
    from rosbags.highlevel import AnyReader

    with AnyReader([record(tmp_path / "run.mcap")]) as bag:
        counts = {c.topic: c.msgcount for c in bag.connections}
        for connection, _, raw in bag.messages():
            bag.deserialize(raw, connection.msgtype)
    assert counts["/camera/image/compressed"] == counts["/tf"] == counts["/odom"] == 6
    assert counts["/map"] == counts["/tf_static"] == 1


def test_images_are_kept_bit_for_bit(tmp_path):
    import cv2
    from rosbags.highlevel import AnyReader

    steps = list(make_steps(3))
    with AnyReader([record(tmp_path / "run.mcap", count=3)]) as bag:
        seen = {"/camera/image/compressed": [], "/camera/depth": []}
        for connection, _, raw in bag.messages([c for c in bag.connections if c.topic in seen]):
            seen[connection.topic].append(bag.deserialize(raw, connection.msgtype))
    for step, png, depth in zip(steps, seen["/camera/image/compressed"], seen["/camera/depth"], strict=True):
        assert np.array_equal(cv2.imdecode(png.data, cv2.IMREAD_COLOR)[:, :, ::-1], step.observation.image)
        assert np.array_equal(depth.data.view("<f4").reshape(24, 32), step.observation.depth, equal_nan=True)


def test_light_leaves_the_images_out_and_off_writes_nothing(tmp_path):
    from rosbags.highlevel import AnyReader

    full, light = record(tmp_path / "full.mcap"), record(tmp_path / "light.mcap", "light")
    with AnyReader([light]) as bag:
        topics = {c.topic for c in bag.connections}
    assert not {t for t in topics if t.startswith(("/camera", "/cloud"))} and {"/tf", "/scan_points", "/odom"} <= topics
    assert light.stat().st_size < full.stat().st_size
    record(tmp_path / "off.mcap", "off")
    assert not (tmp_path / "off.mcap").exists()


def test_jpeg_keeps_all_but_the_last_bits_of_colour(tmp_path):
    path = record(tmp_path / "run.mcap", "jpeg", count=3)
    assert read_head(path).has_images and not read_head(record(tmp_path / "light.mcap", "light")).has_images
    for step, view in zip(make_steps(3), read(path).views(), strict=True):
        assert view.capture.image.shape == step.observation.image.shape
        assert np.array_equal(view.capture.depth, step.observation.depth, equal_nan=True)


@pytest.mark.parametrize("level", ["full", "jpeg"])
def test_how_large_a_recording_will_be_is_known_beforehand(tmp_path, level):
    words = ["world=corridor", "task=survey", "odometry=wheel", "loop_closer=none", f"recording={level}", "source.step_m=1"]
    rhs.run([*words, f"output={tmp_path / 'run'}"], quiet=True)
    path, views = tmp_path / "run" / "run.mcap", len(rhs.load_run(tmp_path / "run").steps)
    said = views * bytes_a_view(level, read_head(path).camera, frozenset({"image", "depth", "scan"}))
    assert 0.67 < said / path.stat().st_size < 1.5


def test_a_large_recording_is_spoken_of_and_a_small_one_is_not(caplog):
    _foretell("full", 0.2e6, 400)
    assert "run.mcap takes about 80 MB for the survey's 400 views, and 200 kB for each of the patrol's" in caplog.text
    assert "recording=jpeg: half, recording=light" in caplog.text
    caplog.clear()
    _foretell("jpeg", 0.1e6, 400)
    assert "40 MB" in caplog.text and "recording=jpeg" not in caplog.text, "what was typed helps no more"
    caplog.clear()
    _foretell("full", 0.2e6, 0), _foretell("full", 100.0, 400)
    assert not caplog.text


def test_two_recordings_of_one_run_are_equal(tmp_path):
    assert record(tmp_path / "a.mcap").read_bytes() == record(tmp_path / "b.mcap").read_bytes()


def test_stamps_of_the_size_of_today_survive():
    for stamp in (0.0, 0.4, 1305031910.765238, 1.7e9 + 0.1):
        assert seconds(nanoseconds(stamp)) == stamp


def test_views_come_back_bit_for_bit(tmp_path):
    """All an estimator was given: image, depth, scan, command, wheel, stamp, camera."""
    steps = list(make_steps(5))
    path = record(tmp_path / "run.mcap", count=5)
    views = list(read(path).views())
    assert len(views) == 5
    for step, view in zip(steps, views, strict=True):
        seen, capture = step.observation, view.capture
        assert (capture.index, capture.stamp_s) == (seen.index, seen.stamp_s)
        np.testing.assert_array_equal(capture.image, seen.image)
        assert capture.depth.dtype == np.float32
        np.testing.assert_array_equal(capture.depth, seen.depth)
        np.testing.assert_array_equal(capture.scan.ranges_m, seen.scan.ranges_m)
        np.testing.assert_array_equal(capture.scan.bearings_rad, seen.scan.bearings_rad)
        assert capture.scan.origin_xy_m == seen.scan.origin_xy_m
        np.testing.assert_array_equal(capture.travel, seen.wheel)
        assert vars(capture.command) == vars(seen.command)
        np.testing.assert_array_equal(view.truth, step.truth)
    head = read_head(path)
    assert head.facts == FACTS and head.level == "full"
    np.testing.assert_array_equal(head.camera.matrix, CAMERA.matrix)
    np.testing.assert_array_equal(head.camera.body_from_camera, CAMERA.body_from_camera)


def test_a_killed_writer_leaves_all_but_the_last_chunk(tmp_path):
    code = ("import os, signal, sys; from pathlib import Path\n"
            "from helpers.synthetic_run import CAMERA, FACTS, make_steps; from rhs.recording.writer import Recorder\n"
            "r = Recorder(Path(sys.argv[1]), 'light', CAMERA, FACTS)\n"
            "for s in make_steps(200):\n"
            "    r.step(s)\n"
            "os.kill(os.getpid(), signal.SIGKILL)\n")
    path = tmp_path / "run.mcap"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code, str(path)], env=environment, timeout=60)
    assert done.returncode == -9
    reading = read(path)
    count = len(list(reading.views()))
    assert 150 < count < 200 and "the file " in reading.report.line
    assert read_head(path).facts == FACTS


def test_a_failed_run_leaves_a_finished_file_that_says_so(tmp_path):
    recorder = Recorder(tmp_path / "run.mcap", "full", CAMERA, FACTS)
    recorder.step(next(make_steps(1)))
    recorder.close("failed", "the planner fell over")
    reading = read(tmp_path / "run.mcap")
    assert len(list(reading.views())) == 1 and reading.report.whole
    assert reading.notes["rhs.end"] == {"status": "failed", "reason": "the planner fell over"}


def test_a_full_disk_is_one_line_and_what_was_written_is_readable(tmp_path):
    code = ("import resource, signal, sys; from pathlib import Path\n"
            "from helpers.synthetic_run import CAMERA, FACTS, make_steps; from rhs.recording.writer import Recorder\n"
            "from rhs.api.errors import RhsError\n"
            "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (150000, 150000))\n"
            "r = Recorder(Path(sys.argv[1]), 'light', CAMERA, FACTS)\n"
            "try:\n"
            "    for s in make_steps(400): r.step(s)\n"
            "except RhsError as error:\n"
            "    r.close('failed', str(error)); sys.exit(str(error))\n")
    path = tmp_path / "run.mcap"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code, str(path)], env=environment, timeout=60, capture_output=True,
                          text=True)
    assert done.returncode == 1 and "run.mcap" in done.stderr and "MB free" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert len(list(read(path).views())) > 50
