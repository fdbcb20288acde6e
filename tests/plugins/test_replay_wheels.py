"""Wheels of a bag: slower than the views, or in tf alone."""

from __future__ import annotations

import numpy as np
import pytest
from bags import KINDS, BagFile

from rhs.api.errors import ConfigError
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

SPEED = 1.0  # m/s straight ahead


def opened(path, **settings):
    return open_recording(Replay(path=str(path), **settings))


def ways(recording):
    return [None if capture.travel is None else float(capture.travel[0]) for capture, _ in recording.views]


def test_wheels_slower_than_the_views_do_not_come_in_leaps(tmp_path):
    """40 scans and 10 readings of the wheels a second; the last three scans come after the last reading."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(40):
            stamp = 1.0 + 0.025 * k
            if k % 4 == 0:
                bag.odometry("/odom", stamp, SPEED * 0.025 * k, 0.0, 0.0)
            bag.scan("/scan", stamp, [2.0, 3.0, 4.0])
    assert ways(opened(bag.path))[1:37] == pytest.approx([0.025] * 36)


def test_views_do_not_wait_for_ever_for_wheels_that_stopped(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(60):
            bag.scan("/scan", 1.0 + 0.1 * k, [2.0, 3.0, 4.0])
            if k < 5:
                bag.odometry("/odom", 1.0 + 0.1 * k, 0.1 * k, 0.0, 0.0)
    found = ways(opened(bag.path))
    assert len(found) == 60 and found[-1] == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_wheels_that_only_tf_tells_of_are_read(tmp_path, kind, caplog):
    with BagFile(tmp_path, kind) as bag:
        for k in range(12):
            stamp = 1.0 + 0.1 * k
            bag.transform("/tf_static", stamp, "base_link", "laser", 0.2, np.pi / 2)
            bag.transform("/tf", stamp, "map", "odom", 0.01 * k)
            bag.transform("/tf", stamp, "odom", "base_link", 0.1 * k)
            bag.scan("/scan", stamp, [2.0, 3.0, 4.0])
    recording = opened(bag.path)
    capture = [capture for capture, _ in recording.views][5]
    assert capture.travel == pytest.approx([0.1, 0.0, 0.0]) and capture.scan.bearings_rad[1] == pytest.approx(np.pi / 2)
    assert "wheel" in recording.provides and "odom -> base_link of tf" in caplog.text
    assert "wheel" not in opened(bag.path, wheel_topic="none").provides
    assert "wheel" not in opened(bag.path, truth_frame="odom").provides  # the truth is not for estimators


def test_views_that_were_taken_earlier_than_stamped_get_the_wheels_of_then(tmp_path):
    """Scans stamped 0.3 s after they were taken, 20 readings of the wheels a second, faster and faster."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(40):
            stamp = 1.0 + 0.05 * k
            bag.odometry("/odom", stamp, (stamp - 1.0) ** 2, 0.0, 0.0)
            if k % 2 == 0 and k >= 6:
                bag.scan("/scan", stamp, [2.0, 3.0, 4.0])
    recording = list(opened(bag.path, views_late_s=0.3).views)
    assert [capture.stamp_s for capture, _ in recording] == pytest.approx([1.0 + 0.1 * k for k in range(17)])
    assert [float(capture.travel[0]) for capture, _ in recording[1:]] == pytest.approx(
        [(0.1 * k) ** 2 - (0.1 * k - 0.1) ** 2 for k in range(1, 17)])


def driven(folder, *odometry, linked=()):
    """A laser and topics of Odometry (frames odom and base, 0.1 m a scan), and the same as a link of tf."""
    folder.mkdir(exist_ok=True)
    with BagFile(folder, "ros2_mcap") as bag:
        for k in range(12):
            stamp = 1.0 + 0.1 * k
            for topic in odometry:
                bag.odometry(topic, stamp, 0.1 * k, 0.0, 0.0)
            for parent, child in linked:
                bag.transform("/tf", stamp, parent, child, 0.1 * k)
            bag.scan("/scan", stamp, [2.0, 3.0, 4.0])
    return bag.path


@pytest.mark.parametrize("linked", [(), [("odom", "base")]])  # the same told by tf too
@pytest.mark.parametrize("topic", ["/odom", "/ground_truth/state"])
def test_the_topic_that_is_typed_as_the_truth_is_not_taken_for_wheels(tmp_path, topic, linked):
    recording = opened(driven(tmp_path, topic, linked=linked), truth_topic=topic)
    views = list(recording.views)
    assert "wheel" not in recording.provides and [view.travel for view, _ in views] == [None] * 12
    assert views[10][1][0, 3] == pytest.approx(1.0)


@pytest.mark.parametrize("topic", ["/ground_truth/odom", "/base_pose_ground_truth", "/gt_odom", "/vicon/robot/odom"])
def test_odometry_that_is_the_truth_by_its_name_is_not_taken_for_wheels_unless_typed(tmp_path, caplog, topic):
    alone, beside = driven(tmp_path / "a", topic), driven(tmp_path / "b", "/odom", topic)
    assert "wheel" not in opened(alone).provides and f"{topic}: by its name the truth" in caplog.text
    assert "wheel" in opened(alone, wheel_topic=topic).provides
    assert "wheel" in opened(beside).provides and "wheel" in opened(beside, truth_topic=topic).provides


def test_wheels_and_truth_of_one_topic_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"are both /odom: .* type source\.wheel_topic=none"):
        opened(driven(tmp_path, "/odom"), truth_topic="/odom", wheel_topic="/odom")


@pytest.mark.parametrize(("body", "said"), [("base_link", True), ("base", False)])  # of which /odom tells: base
def test_wheels_that_tell_of_a_frame_that_tf_does_not_know_are_said_to(tmp_path, caplog, body, said):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.transform("/tf_static", 1.0, body, "laser", 0.2)
        for k in range(4):
            bag.odometry("/odom", 1.0 + 0.1 * k, 0.1 * k, 0.0, 0.0)
            bag.scan("/scan", 1.0 + 0.1 * k, [2.0, 3.0, 4.0])
    assert ways(opened(bag.path))[1:] == pytest.approx([0.1] * 3)
    assert ("/odom tells of the frame base, which tf does not know: it is taken to be base_link" in caplog.text) == said
