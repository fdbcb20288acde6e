"""Where sensors sit: tf of bags of all kinds, mounts that are typed; what is typed is used or refused."""

from __future__ import annotations

import numpy as np
import pytest
from bags import KINDS, BagFile, picture

from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL, se2
from rhs.api.records import Scan
from rhs_sources.replay_config import Replay
from rhs_sources.replay_mounts import Mounts, links_of, mount_of, mounted

ALL_KINDS = pytest.mark.parametrize("kind", KINDS)
AHEAD = Scan(np.array([-1.0, 0.0, 1.0]), np.array([2.0, 3.0, np.inf]), 10.0)


def first(path, **settings):
    source = Replay(path=str(path), **settings).build(None)
    capture = source.lead()
    source.close()
    return source, capture


def scan_bag(folder, kind, links, *, wheels=True):
    """Two scans of beams at -1, 0, 1 rad; links: (topic, stamp, parent, child, x, yaw, roll)."""
    with BagFile(folder, kind) as bag:
        for k in range(2):
            for topic, parent, child, x, yaw, roll in links:
                bag.transform(topic, 1.0 + k, parent, child, x, yaw, roll)
            bag.scan("/scan", 1.0 + k, [2.0, 3.0, 4.0])
            if wheels:
                bag.odometry("/odom", 1.0 + k, 0.1 * k, 0.0, 0.0)
    return bag.path


@ALL_KINDS
@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
def test_a_laser_mounted_turned_by_90_degrees_is_turned(tmp_path, kind, topic):
    _, capture = first(scan_bag(tmp_path, kind, [(topic, "base", "laser", 0.2, np.pi / 2, 0.0)]))
    assert np.allclose(capture.scan.bearings_rad, np.array([-1.0, 0.0, 1.0]) + np.pi / 2)
    assert np.allclose(capture.scan.ranges_m, [2.0, 3.0, 4.0]) and np.allclose(capture.scan.origin_xy_m, (0.2, 0.0))


def test_a_laser_upside_down_sees_left_and_right_changed(tmp_path):
    _, capture = first(scan_bag(tmp_path, "ros2_mcap", [("/tf_static", "base", "laser", 0.0, 0.0, np.pi)]))
    assert np.allclose(capture.scan.bearings_rad, [-1.0, 0.0, 1.0])
    assert np.allclose(capture.scan.ranges_m, [4.0, 3.0, 2.0])


def test_links_are_followed_to_the_body_and_across_it(tmp_path):
    chain = [("/tf_static", "base_link", "tower", 0.1, np.pi / 2, 0.0), ("/tf_static", "tower", "laser", 0.3, 0.0, 0.0)]
    _, capture = first(scan_bag(tmp_path, "ros2_mcap", chain, wheels=False))
    assert np.allclose(capture.scan.origin_xy_m, (0.1, 0.3))
    _, capture = first(tmp_path / "bag", body_frame="tower")
    assert np.allclose(capture.scan.origin_xy_m, (0.3, 0.0))
    beside = Mounts({"laser": ("root", se2(1.0, 0.0, 0.0)), "base": ("root", se2(0.0, 0.5, np.pi / 2))}, wheels="base")
    assert np.allclose(beside.of("laser"), np.linalg.inv(se2(0.0, 0.5, np.pi / 2)) @ se2(1.0, 0.0, 0.0))


def test_a_link_that_moves_is_no_mount():
    links, _ = links_of([("a", "odom", se2(0.0, 0.0, 0.0), False), ("a", "odom", se2(0.5, 0.0, 0.0), False),
                         ("b", "a", se2(0.1, 0.0, 0.0), False), ("b", "a", se2(0.1, 0.0, 0.0), False)])
    assert set(links) == {"b"}
    assert Mounts({}).of("laser") is None


def test_a_mount_that_is_typed_wins(tmp_path):
    path = scan_bag(tmp_path, "ros2_mcap", [("/tf_static", "base", "laser", 0.2, np.pi / 2, 0.0)])
    _, capture = first(path, scan_mount=[0.5, -0.1, 0.3, 0, 0, -90])
    assert np.allclose(capture.scan.bearings_rad, np.array([-1.0, 0.0, 1.0]) - np.pi / 2)
    assert np.allclose(capture.scan.origin_xy_m, (0.5, -0.1))


def test_a_scanner_that_looks_behind_keeps_its_bearings_in_order():
    seen = mounted(AHEAD, mount_of([0, 0, 0, 0, 0, 180], "scan_mount"), "here")
    assert (np.diff(seen.bearings_rad) > 0).all() and np.abs(seen.bearings_rad).max() <= np.pi
    behind = seen.ranges_m[np.argmin(np.abs(np.abs(seen.bearings_rad) - np.pi))]
    assert behind == 3.0
    assert np.inf in seen.ranges_m.tolist()


@pytest.mark.parametrize(("settings", "words"), [
    ({"scan_mount": [1, 2, 3]}, "six numbers"), ({"scan_mount": [0, 0, 0, 0, 0, 999]}, "yaw=999"),
    ({"scan_mount": [0, 0, 0, 0, 45, 0]}, "tilted by 45 degrees"), ({"camera_mount": [0, 0, 1, 0, 0, 0]}, "nothing that is"),
    ({"body_frame": "nose"}, "no fixed tf links"),
])
def test_a_mount_without_use_is_refused_in_one_line(tmp_path, settings, words):
    path = scan_bag(tmp_path, "ros2_mcap", [("/tf_static", "base", "laser", 0.2, 0.0, 0.0)])
    with pytest.raises(ConfigError, match=words) as caught:
        first(path, **settings)
    assert "\n" not in str(caught.value)


def test_a_mount_typed_for_a_log_of_another_kind_is_refused(tmp_path):
    log = tmp_path / "a.clf"
    log.write_text("FLASER 3 1 2 3 0 0 0 0 0 0 1 host 1\n" * 2)
    with pytest.raises(ConfigError, match="camera_mount"):
        first(log, camera_mount=[0, 0, 1, 0, 0, 0])
    _, capture = first(log, scan_mount=[0.1, 0, 0, 0, 0, 90])
    assert np.allclose(capture.scan.origin_xy_m, (0.1, 0.0)) and capture.scan.bearings_rad[1] == pytest.approx(np.pi / 2)


def test_a_camera_sits_where_tf_puts_it_and_clouds_are_moved_to_it(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.transform("/tf_static", 1.0, "base_link", "camera", 0.3)
        bag.camera_info("/camera/rgb/camera_info", 1.0)
        bag.image("/camera/rgb/image_color", 1.0, picture(), "rgb8")
        bag.image("/camera/depth/image", 1.0, np.full((48, 64), 2500, np.uint16), "16UC1")
    source, _ = first(bag.path)
    assert np.allclose(source.camera.body_from_camera[:3, 3], (0.3, 0.0, 0.0))
    source, _ = first(bag.path, camera_mount=[0, 0, 1.2, 0, 0, 0])
    assert np.allclose(source.camera.body_from_camera[:3, :3], BODY_FROM_OPTICAL) and source.camera.height_m == 1.2
