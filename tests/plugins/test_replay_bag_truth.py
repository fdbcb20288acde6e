"""True poses in bags: which topics hold any, frames with several parents, clocks; and views of a bag that cannot be read."""

from __future__ import annotations

import numpy as np
import pytest
from bags import HEIGHT, WIDTH, BagFile, picture
from helpers.replayed import views

from rhs.api.errors import ConfigError

COLOR, DEPTH, INFO = "/camera/color", "/camera/depth", "/camera/camera_info"
MILLIMETRES = np.full((HEIGHT, WIDTH), 2500, np.uint16)
STAMPS = [100.0, 100.1, 100.2, 100.3]


def write(folder, extra, kind="ros2_mcap", image=lambda k: picture(k)):
    """A bag of four views, a tenth of a second apart; extra(bag, k, stamp) puts in more."""
    with BagFile(folder, kind) as bag:
        for k, stamp in enumerate(STAMPS):
            bag.clock_s = stamp
            bag.camera_info(INFO, stamp)
            bag.image(COLOR, stamp, image(k), "rgb8")
            bag.image(DEPTH, stamp, MILLIMETRES[: len(image(k))], "16UC1")
            extra(bag, k, stamp)
    return bag.path


def way(seen):
    return [None if truth is None else round(float(truth[0, 3]), 6) for _, truth in seen]


def pose(topic, stamp_of):
    def put(bag, k, stamp):
        message = bag.make("geometry_msgs/msg/PoseStamped", header=bag.header(stamp_of(stamp), "world"),
                           pose=bag.pose(0.5 * k, 0.0, 0.0))
        bag.put(topic, stamp, message)
    return put


@pytest.mark.parametrize("kind", ["ros2_mcap", "ros2_sqlite"])
def test_true_poses_without_a_stamp_are_of_when_they_arrived(tmp_path, kind):
    _, seen = views(write(tmp_path, pose("/mocap", lambda stamp: 0.0), kind), truth_topic="/mocap")
    assert way(seen) == [0.0, 0.5, 1.0, 1.5]


def test_true_poses_of_another_clock_are_said_to_be_of_no_view(tmp_path, caplog):
    _, seen = views(write(tmp_path, pose("/mocap", lambda stamp: stamp - 95.0)), truth_topic="/mocap")
    assert way(seen) == [None] * 4 and "of no view a true pose is known, though source.truth_topic was typed" in caplog.text


def test_a_topic_that_holds_no_poses_is_refused_with_those_that_do(tmp_path):
    def both(bag, k, stamp):
        bag.scan("/scan", stamp, [1.0, 2.0])
        pose("/mocap", lambda s: s)(bag, k, stamp)
    path = write(tmp_path, both)
    with pytest.raises(ConfigError, match="/scan holds LaserScan; found /mocap with true poses"):
        views(path, truth_topic="/scan")
    with pytest.raises(ConfigError, match="no topic /vicon"):
        views(path, truth_topic="/vicon")


def test_true_poses_lie_in_a_file_beside_the_bag(tmp_path):
    """As Newer College's, seconds and nanoseconds apart."""
    path, truth = write(tmp_path, pose("/mocap", lambda s: s)), tmp_path / "gt.csv"
    rows = [f"{int(stamp)},{round(stamp % 1 * 1e9)},{0.5 * k},0,0,0,0,0,1\n" for k, stamp in enumerate(STAMPS)]
    truth.write_text("#sec,nsec,x,y,z,qx,qy,qz,qw\n" + "".join(rows))
    assert way(views(path, truth=str(truth))[1]) == [0.0, 0.5, 1.0, 1.5]
    with pytest.raises(ConfigError, match=r"found source\.truth and source\.truth_topic; expected one of them"):
        views(path, truth=str(truth), truth_topic="/mocap")
    truth.write_text("1 2 3\n")
    with pytest.raises(ConfigError, match=r"gt\.csv:1: found 3 columns"):
        views(path, truth=str(truth))


def test_true_poses_of_another_frame_than_the_body_are_carried_to_it(tmp_path):
    """The body of a camera in a hand is its mount, x ahead. Poses in optical axes, of a camera that looks along the room's
    x, and of a marker 0.2 m behind it, are of the same body."""
    path = write(tmp_path, lambda bag, k, stamp: bag.transform("/tf_static", stamp, "marker", "camera", 0.2))
    truth = tmp_path / "gt.txt"
    for frame, behind, turn in (("camera", 0.0, "-0.5 0.5 -0.5 0.5"), ("marker", 0.2, "0 0 0 1")):
        truth.write_text("".join(f"{stamp} {0.5 * k - behind} 0 0 {turn}\n" for k, stamp in enumerate(STAMPS)))
        _, seen = views(path, truth=str(truth), truth_of=frame, body_frame="" if frame == "camera" else "marker")
        at = 0.0 if frame == "camera" else -behind  # a body that is typed is the marker itself
        assert way(seen) == [at, at + 0.5, at + 1.0, at + 1.5]
        np.testing.assert_allclose(seen[1][1][:3, :3], np.eye(3), atol=1e-9)
    with pytest.raises(ConfigError, match="truth_of=imu: no fixed tf links join it to camera; found camera, marker; or "):
        views(path, truth=str(truth), truth_of="imu")
    with pytest.raises(ConfigError, match=r"source\.truth_of: expected with source\.truth=FILE"):
        views(path, truth_of="camera")


def test_a_bag_without_static_links_or_without_any_is_asked_for_its_tf(tmp_path):
    moving = write(tmp_path, lambda bag, k, stamp: bag.transform("/tf", stamp, "world", "camera", 0.5 * k))
    assert way(views(moving, truth_frame="world")[1]) == [0.0, 0.5, 1.0, 1.5]
    (tmp_path / "still").mkdir()
    with pytest.raises(ConfigError, match="no tf chain from world to camera; found no tf at all"):
        views(write(tmp_path / "still", lambda bag, k, stamp: None), truth_frame="world")


@pytest.mark.parametrize("order", [("odom", "world"), ("world", "odom")])
def test_of_two_parents_of_a_frame_the_one_that_was_named_leads_to_the_truth(tmp_path, order):
    """Odometry says that the camera stands 7 m from its origin; motion capture, that it goes half a metre a view."""
    def both(bag, k, stamp):
        for parent in order:
            bag.transform("/tf", stamp, parent, "camera", 7.0 if parent == "odom" else 0.5 * k)
    path = write(tmp_path, both)
    assert way(views(path, truth_frame="world")[1]) == [0.0, 0.5, 1.0, 1.5]
    assert way(views(path, truth_frame="odom")[1]) == [7.0] * 4


def test_motion_capture_of_a_laser_is_that_of_the_body_it_sits_on(tmp_path):
    """The laser sits half a metre ahead of the body, and is seen at 0.5, 1.0, ... m of the room."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.transform("/tf_static", STAMPS[0], "base_link", "laser", 0.5)
        for k, stamp in enumerate(STAMPS):
            bag.scan("/scan", stamp, [1.0, 2.0, 3.0])
            bag.transform("/tf", stamp, "room", "laser", 0.5 + 0.5 * k)
    assert way(views(bag.path, truth_frame="room")[1]) == [0.0, 0.5, 1.0, 1.5]


def test_a_view_of_a_bag_that_cannot_be_read_is_left_out_and_said_to_be_lost(tmp_path):
    """The third view is half as high as the others, which the camera is not of."""
    path = write(tmp_path, lambda bag, k, stamp: None, image=lambda k: picture(k)[: HEIGHT // 2] if k == 2 else picture(k))
    source, seen = views(path)
    assert [round(capture.stamp_s, 1) for capture, _ in seen] == [100.0, 100.1, 100.3]
    assert "1 views cannot be read" in source.lost and "64x24" in source.lost
