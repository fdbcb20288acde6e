"""Recordings of forms that are not read say which program makes one that is; those whose names hold a number and a time."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from bags import BagFile, picture
from helpers.replayed import refused, views

from rhs.base.commands import LONGEST
from rhs_sources.unread import FILES, of_file


@pytest.mark.parametrize(("name", "said"), [
    ("a.svo2", "zed_wrapper"),
    ("a.pcap", "record the PointCloud2"),
    ("lcmlog-2012-06-15.00", "convert it to a ROS bag"), ("a.laz", "write .pcd or .ply"),
    ("000000.npy", "astype('float32')"), ("scans.csv", "FLASER N ranges"), ("intel.gfs", "the CARMEN log"),
    ("aces.relations", "source.relations=aces.relations"), ("a.rawlog", "CARMEN log"),
    ("a.bag.active", "rosbag reindex a.bag.active"), ("IMG_1.HEIC", "mogrify"), ("SCAN1.mat", "of MATLAB"),
    ("a.tfrecord", "of TensorFlow"), ("1.feather", "float32 x, y, z as .bin"), ("map.ply", "a folder of them, numbered"),
    ("a.lvx2", "lvx_to_rosbag.launch"), ("a.osf", "of Ouster"), ("a.rrd", "of Rerun"),
])
def test_a_file_of_another_form_says_what_makes_it_one_that_is_read(tmp_path, name, said):
    (tmp_path / name).write_bytes(b"\0" * 100)
    assert said in refused(tmp_path / name) and said in refused(tmp_path)


@pytest.mark.parametrize("ending", FILES)
def test_a_line_is_not_cut_before_it_has_said_what_to_type(ending):
    assert len(f"source.path=recording{ending}: found {of_file(Path('recording' + ending))}") <= LONGEST


def test_a_table_beside_a_recording_hides_none(tmp_path):
    (tmp_path / "imu.csv").write_text("0,0,0\n")
    (tmp_path / "walk" / "rgb").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "walk" / "rgb" / "1.png"), picture())
    assert f"type source.path={tmp_path}/walk" in refused(tmp_path)


@pytest.mark.parametrize(("profile", "kind", "said"), [
    ("", "protobuf", "messages in protobuf; expected those of ROS (cdr): record them by ros2 bag"), ("", "json", "in json"),
    ("ros1", "ros1", "give the .bag that it was made of"),
    ("px4", "cdr", "the profile 'px4' in MCAP; expected ros2: play it (ros2 bag play a.mcap)"),
])
def test_an_mcap_of_other_messages_says_so(tmp_path, profile, kind, said):
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile=profile)
        channel = writer.register_channel("/scan", kind, writer.register_schema("acme.Scan", kind, b""))
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    assert said in refused(tmp_path / "a.mcap") and "cut" not in refused(tmp_path / "a.mcap")


def test_a_recording_of_an_azure_kinect_says_how_its_depth_is_unpacked(tmp_path, caplog):
    (tmp_path / "a.mkv").write_bytes(b"\x1aE\xdf\xa3" + bytes(50) + b"K4A_DEPTH_MODE")
    refused(tmp_path / "a.mkv")
    assert "azure_kinect_mkv_reader.py --input a.mkv" in caplog.text


def test_views_of_a_clock_that_was_set_back_are_lost(tmp_path):
    """A simulator that was begun again while it was recorded: the later half is of before the first."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(60):
            bag.clock_s = 1e9 + 0.1 * k
            bag.scan("/scan", 100.0 + 0.1 * k - (40.0 if k >= 20 else 0.0), np.full(90, 2.0))
    source, seen = views(bag.path)
    assert len(seen) == 20 and source.views_lost == 40 and "clock that was set back" in source.lost


def test_of_several_topics_what_to_type_comes_before_their_names(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(5):
            bag.image(f"/alphasense_driver_ros/cam{k}/image_raw", 1.0, picture(), "rgb8")
    text = refused(bag.path)
    assert text.index("type source.color_topic=NAME") < text.index("/alphasense")


def test_a_log_of_player_is_named(tmp_path):
    (tmp_path / "a.log").write_text("## Player version 2.0.5\n## File version: 0.3.0\n1.0 16777343 6665 laser 00 001 001\n")
    assert "a log of Player" in refused(tmp_path / "a.log")


def test_images_of_video_in_a_bag_are_named(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.camera_info("/camera/camera_info", 1.0)
        bag.put("/camera/image/compressed", 1.0, bag.make(
            "sensor_msgs/msg/CompressedImage", header=bag.header(1.0), format="h264", data=np.zeros(50, np.uint8)))
    assert "h264 video, which is not read; republish" in refused(bag.path, depth_topic="none")


def test_of_names_with_a_number_and_a_time_the_time_is_the_stamp(tmp_path, caplog):
    """SUN3D and Redwood's objects: colour and depth have numbers of their own, and microseconds since the beginning."""
    (tmp_path / "image").mkdir()
    (tmp_path / "depth").mkdir()
    (tmp_path / "intrinsics.txt").write_text("50 0 31.5\n0 50 23.5\n0 0 1\n")
    row = np.arange(1500, 1564, dtype=np.uint16)
    for k in range(4):
        cv2.imwrite(str(tmp_path / "image" / f"{k + 1:07d}-{33333 * k:012d}.jpg"), picture(k))
        shifted = np.tile(row << 3, (48, 1))
        cv2.imwrite(str(tmp_path / "depth" / f"{k + 3:07d}-{33333 * k + 150:012d}.png"), shifted)
    _, seen = views(tmp_path)
    assert len(seen) == 4 and seen[3][0].stamp_s == pytest.approx(0.1, abs=1e-4)
    assert "type source.depth_scale=8000" in caplog.text
    _, seen = views(tmp_path, depth_scale=8000)
    assert seen[0][0].depth[0, 0] == pytest.approx(1.5)


def test_a_focal_length_below_zero_is_answered(tmp_path):
    assert "type 480" in refused(tmp_path, camera=[481.2, -480.0, 319.5, 239.5])


def test_stamps_that_do_not_tell_images_apart_give_way_to_when_they_arrived(tmp_path, caplog):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(20):
            bag.clock_s = 1e9 + 0.1 * k
            bag.image("/camera/image_raw", float(int(bag.clock_s)), picture(k), "rgb8")
            bag.camera_info("/camera/camera_info", bag.clock_s)
    _, seen = views(bag.path, depth_topic="none")
    assert len(seen) == 20 and seen[7][0].stamp_s == pytest.approx(1e9 + 0.7)
    assert "of its first 10 messages 1 have stamps of their own" in caplog.text


def test_a_bag_of_infrared_images_says_what_to_type(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.image("/camera/infra1/image_rect_raw", 1.0, picture()[:, :, 0], "mono8")
        bag.image("/camera/depth/image_rect_raw", 1.0, np.full((48, 64), 2000, np.uint16), "16UC1")
    assert "type source.color_topic=/camera/infra1/image_rect_raw" in refused(bag.path)


def test_depth_is_told_by_its_encoding_too(tmp_path):
    """OAK's depth is called /stereo/image_raw; a picture of depth in colours is neither."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(3):
            bag.image("/oak/rgb/image_raw", 1e9 + k, picture(k), "rgb8")
            bag.image("/oak/stereo/image_raw", 1e9 + k, np.full((48, 64), 2000, np.uint16), "16UC1")
            bag.image("/oak/depth_colored", 1e9 + k, picture(k), "bgr8")
        bag.camera_info("/oak/rgb/camera_info", 1e9)
    _, seen = views(bag.path)
    assert len(seen) == 3 and seen[0][0].depth[0, 0] == pytest.approx(2.0) and seen[0][0].image[0, 0, 0] == 50


def test_scans_whose_angles_contradict_each_other_are_said(tmp_path, caplog):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(3):
            bag.put("/scan", 1e9 + k, bag.make(
                "sensor_msgs/msg/LaserScan", header=bag.header(1e9 + k, "laser"), angle_min=-1.5, angle_max=1.5,
                angle_increment=0.0125, time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=10.0,
                ranges=np.full(121, 3.0, np.float32), intensities=np.zeros(0, np.float32)))
    views(bag.path)
    assert "121 beams, 0.0125 rad apart, end at 0.00 rad, and angle_max says 1.50" in caplog.text
