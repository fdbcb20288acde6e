"""A recording holds what was put in, and other programs can read it."""

import numpy as np
from helpers.synthetic_run import CAMERA, FACTS, make_steps, room

from rhs.recording import Recorder
from rhs.ros import nanoseconds, seconds


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


def test_two_recordings_of_one_run_are_equal(tmp_path):
    assert record(tmp_path / "a.mcap").read_bytes() == record(tmp_path / "b.mcap").read_bytes()


def test_stamps_of_the_size_of_today_survive():
    for stamp in (0.0, 0.4, 1305031910.765238, 1.7e9 + 0.1):
        assert seconds(nanoseconds(stamp)) == stamp
