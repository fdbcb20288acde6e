"""Recordings as robots' own drivers write them: several robots or sensors in one bag, frames without optical axes, units."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest
from bags import HEIGHT, KINDS, WIDTH, BagFile, picture

import rhs
from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL
from rhs.config.compose import compose_config
from rhs_sources.bags.files import opened as open_files
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

CAMERA = [50.0, 50.0, 31.5, 23.5]
MILLIMETRES = np.full((HEIGHT, WIDTH), 2000, np.uint16)
SCAN = "sensor_msgs/msg/LaserScan"


def opened(path, **settings):
    return open_recording(Replay(path=str(path), **settings))


def robot(bag, name, turn):
    """Two scans and the tf of a robot in a namespace, all robots with the same names of frames."""
    for k in range(2):
        bag.transform(f"{name}/tf_static", 1.0 + k, "base_link", "laser", 0.2, turn)
        bag.transform(f"{name}/tf", 1.0 + k, "odom", "base_link", 0.1 * k)
        bag.scan(f"{name}/scan", 1.0 + k, [2.0, 3.0, 4.0])


@pytest.mark.parametrize("kind", KINDS)
def test_a_laser_sits_where_the_tf_of_its_own_robot_puts_it(tmp_path, kind):
    with BagFile(tmp_path, kind) as bag:
        robot(bag, "/robot1", np.pi / 2)
        robot(bag, "/robot2", 0.0)
        robot(bag, "", -np.pi / 2)
    ahead = {topic: float(next(opened(bag.path, scan_topic=topic).views)[0].scan.bearings_rad[1])
             for topic in ("/robot1/scan", "/robot2/scan", "/scan")}
    assert ahead == pytest.approx({"/robot1/scan": np.pi / 2, "/robot2/scan": 0.0, "/scan": -np.pi / 2})


@pytest.mark.parametrize("kind", ["ros2_mcap", "ros2_sqlite"])
def test_topics_that_were_listed_and_never_heard_are_none(tmp_path, kind):
    """`ros2 bag record -a` lists whatever was advertised."""
    with BagFile(tmp_path, kind) as bag:
        for topic, said in (("/scan_filtered", SCAN), ("/odom", "nav_msgs/msg/Odometry"),
                            ("/camera/image_raw", "sensor_msgs/msg/Image")):
            bag.connections[topic] = bag.writer.add_connection(topic, said, typestore=bag.store)
        robot(bag, "", 0.0)
    recording = opened(bag.path)
    assert recording.provides == {"scan", "wheel"} and len(list(recording.views)) == 2  # the wheels are tf's


def test_two_scanners_on_one_topic_are_not_one(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        robot(bag, "", 0.0)
        message = bag.make(SCAN, header=bag.header(1.5, "rear_laser"), angle_min=-1.0, angle_max=1.0, angle_increment=1.0,
                           time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=10.0,
                           ranges=np.full(3, 9.0, np.float32), intensities=np.zeros(0, np.float32))
        bag.put("/scan", 1.5, message)
    recording = opened(bag.path)
    assert [capture.stamp_s for capture, _ in recording.views] == [1.0, 2.0] and recording.rejected == {"other_frame": 1}


def camera_bag(folder, frame, depth="/camera/aligned_depth_to_color/image_raw", depth_frame="", pixels=(MILLIMETRES,) * 2):
    with BagFile(folder, "ros2_mcap") as bag:
        bag.transform("/tf_static", 1.0, "base_link", frame, 0.1)
        for k, one in enumerate(pixels):
            bag.camera_info("/camera/color/camera_info", 1.0 + 0.1 * k)
            bag.image("/camera/color/image_raw", 1.0 + 0.1 * k, picture(k), "rgb8", frame)
            bag.image(depth, 1.0 + 0.1 * k, one, "16UC1", depth_frame or frame)
    return bag.path


@pytest.mark.parametrize(("frame", "looks"), [
    ("camera_link", np.array(BODY_FROM_OPTICAL)), ("ceiling_optical_frame", np.eye(3))])
def test_images_of_a_frame_whose_x_is_ahead_do_not_look_at_the_ceiling(tmp_path, caplog, frame, looks):
    """As simulators write them; by REP 103 the axes of a camera's picture are those of a frame called _optical."""
    assert np.allclose(opened(camera_bag(tmp_path, frame)).camera.body_from_camera[:3, :3], looks)
    assert ("it is taken to look along its x" in caplog.text) == (frame == "camera_link")


def test_the_truth_of_such_a_frame_is_the_bodys(tmp_path):
    path = camera_bag(tmp_path, "camera_link")
    poses = [pose for _, pose in opened(path, truth_frame="base_link").views]
    assert np.allclose(poses, np.eye(4))


def test_depth_aligned_to_another_camera_is_not_aligned_to_colour(tmp_path, caplog):
    opened(camera_bag(tmp_path, "camera", "/camera/aligned_depth_to_infra1/image_raw", "camera_infra1_optical_frame"))
    assert "camera_infra1_optical_frame is joined by no fixed tf links" in caplog.text


def test_the_scale_of_depth_is_judged_by_the_first_image_that_shows_any(tmp_path):
    path = camera_bag(tmp_path, "camera", pixels=(np.zeros((HEIGHT, WIDTH), np.uint16), MILLIMETRES))
    with pytest.raises(ConfigError, match=r"typical depth is 2e\+03 m"):
        opened(path, depth_scale=1.0)


def test_points_at_the_scanner_itself_are_beams_that_met_nothing(tmp_path):
    """As Ouster's driver writes them; moved to the body they would stand where the scanner is."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.transform("/tf_static", 1.0, "base_link", "camera", 0.5)
        bag.cloud("/points", 1.0, np.array([[1.0, 2.0, 0.5], [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]))
    assert np.allclose(next(opened(bag.path).views)[0].extras["cloud"], [[1.5, 2.0, 0.5], [3.5, 0.0, 0.0]])


def test_beams_that_go_the_other_way_round_are_put_in_order(tmp_path):
    """angle_increment below zero: particle_filter_scan was lost all the way."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        message = bag.make(SCAN, header=bag.header(1.0, "laser"), angle_min=0.5, angle_max=-1.0, angle_increment=-0.5,
                           time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=10.0,
                           ranges=np.array([1, 2, 3, 4], np.float32), intensities=np.zeros(0, np.float32))
        bag.put("/scan", 1.0, message)
    scan = next(opened(bag.path).views)[0].scan
    np.testing.assert_allclose(np.column_stack([scan.bearings_rad, scan.ranges_m]), [[-1, 4], [-0.5, 3], [0, 2], [0.5, 1]])


def test_images_of_disparity_and_confidence_are_neither_depth_nor_colour(tmp_path):
    """Pixels of disparity were taken for metres: near was far."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.camera_info("/left/camera_info", 1.0)
        bag.image("/left/image_rect", 1.0, picture(), "rgb8")
        for topic in ("/disparity", "/confidence/confidence_map"):
            bag.image(topic, 1.0, np.full((HEIGHT, WIDTH), 12.0, np.float32), "32FC1")
    with pytest.raises(ConfigError, match="no depth topic; .*found .*/disparity"):
        opened(bag.path)
    assert opened(bag.path, depth_topic="none").provides == {"image", "gray"}


def test_clouds_that_somebody_moved_into_the_map_are_refused_unless_their_place_is_typed(tmp_path):
    """FAST-LIO's /cloud_registered: the scanner would stand still, tracked in every view."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        message = bag.cloud
        bag.header = lambda stamp_s, frame="", header=bag.header: header(stamp_s, "camera_init")
        message("/cloud_registered", 1.0, np.array([[1.0, 2.0, 0.5], [3.0, 0.0, 0.0]]))
    with pytest.raises(ConfigError, match="of the frame camera_init, in which the robot moves"):
        opened(bag.path)
    assert len(list(opened(bag.path, scan_mount=[0.0] * 6).views)) == 1


@pytest.mark.parametrize(("topic", "timed"), [("/points", True), ("/lio/cloud_deskewed", False)])
def test_a_topic_that_says_that_its_clouds_are_deskewed_is_believed(tmp_path, topic, timed):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.cloud(topic, 1.0, np.array([[1.0, 2.0, 0.5], [3.0, 0.0, 0.0]]), times_ns=np.array([0, 100_000_000]))
    assert ("cloud_time_s" in next(opened(bag.path).views)[0].extras) == timed


@pytest.mark.parametrize(("begins_s", "refused"), [(2.0, False), (300.0, True)])
def test_bags_numbered_like_parts_are_one_only_where_one_goes_on_from_the_other(tmp_path, begins_s, refused):
    (tmp_path / "bags").mkdir()
    for number, begin in enumerate((1.0, begins_s)):
        (tmp_path / str(number)).mkdir()
        with BagFile(tmp_path / str(number), "ros1") as bag:
            for k in range(3):
                bag.scan("/scan", begin + 0.3 * k, [2.0, 3.0, 4.0])
        shutil.move(bag.path, tmp_path / "bags" / f"lab_{number}.bag")
    if refused:
        with pytest.raises(ConfigError, match=r"298.4 s apart .* type source.path=.*lab_0.bag"):
            open_files(tmp_path / "bags")
    else:
        assert len(list(opened(tmp_path / "bags").views)) == 6


@pytest.mark.parametrize(("unit", "refused"), [(1.0, False), (180.0 / np.pi, True)])
def test_headings_in_degrees_are_known_by_where_the_robot_goes(tmp_path, unit, refused):
    """Round a circle of 2 m."""
    angles = np.linspace(0.0, 3.0, 60)
    poses = [(2.0 * np.sin(a), 2.0 - 2.0 * np.cos(a), unit * a) for a in angles]
    lines = [f"FLASER 3 1 2 3 {x} {y} {h} {x} {y} {h} {10 + 0.2 * k} robot 0" for k, (x, y, h) in enumerate(poses)]
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n")
    if refused:
        with pytest.raises(ConfigError, match=r"headings \(2.9\d* to 171.9\) are degrees"):
            opened(tmp_path / "a.log")
    else:
        assert len(list(opened(tmp_path / "a.log").views)) == 60


def numbered(folder, names, *, depth=()):
    for k, name in enumerate((*names, *depth)):
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        cv2.imwrite(str(folder / name), MILLIMETRES if name in depth else picture(k)[..., ::-1])
    return opened(folder, camera=CAMERA)


def test_names_of_ten_digits_that_begin_with_zeros_are_no_times(tmp_path):
    """KITTI's; as Unix times they were a second apart."""
    recording = numbered(tmp_path, [f"rgb/{k:010d}.png" for k in range(3)])
    assert not recording.timed and np.allclose([c.stamp_s for c, _ in recording.views], np.arange(3) / 30.0)


def test_numbers_in_the_middle_of_names_count_where_those_at_the_end_are_one(tmp_path):
    recording = numbered(tmp_path, [f"rgb/view_{k}_of_12.png" for k in (10, 9, 2)])
    assert [int(capture.image[0, 0, 0]) for capture, _ in recording.views] == [52, 51, 50]


def test_two_series_in_one_folder_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="found left_1.png and right_1.png, two of one number"):
        numbered(tmp_path, [f"rgb/{side}_{k}.png" for side in ("left", "right") for k in (1, 2)])


def test_depth_whose_names_end_in_one_number_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"2 depth images have 1 numbers at the end of their names \(1_d0.png, 2_d0.png\)"):
        numbered(tmp_path, ["rgb/1_c0.png", "rgb/2_c0.png"], depth=["depth/1_d0.png", "depth/2_d0.png"])


def tum(folder, metres, *, steps=1000, broken=()):
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
    lines = ""
    for k, far in enumerate(metres):
        cv2.imwrite(str(folder / f"rgb/{k}.png"), picture(k))
        cv2.imwrite(str(folder / f"depth/{k}.png"), np.full((HEIGHT, WIDTH), far * steps, np.uint16))
        if k in broken:
            (folder / f"rgb/{k}.png").write_bytes(b"no picture")
        lines += f"{10 + 0.1 * k:.1f} rgb/{k}.png {10 + 0.1 * k:.1f} depth/{k}.png\n"
    (folder / "associations.txt").write_text(lines)
    return folder


def test_a_wrong_scale_of_depth_is_said_also_where_only_a_later_view_is_near(tmp_path, caplog):
    opened(tum(tmp_path, [3.0, 2.0, 3.0, 0.9, 2.5]), camera=CAMERA)  # millimetres, where 5000 steps a metre are usual
    assert "typically 0.50 m, from 0.18 to 0.60 m; if that is not so type source.depth_scale=1000" in caplog.text


@pytest.mark.parametrize(("words", "broken", "why"), [
    ([], (1, 2, 3, 4, 5, 6), "6 of 8 views never arrived"), ([], (1,), ""),
    (["degrade.drop_chance=0.95"], (), "7 of 8 views never arrived")])
def test_a_run_of_whose_views_most_never_arrived_is_not_achieved(tmp_path, words, broken, why):
    path = tum(tmp_path, [2.0] * 8, steps=5000, broken=broken)
    row = rhs.run(["source=replay", f"source.path={path}", f"source.camera={CAMERA}", "task=survey", "recording=off",
                   "pictures=off", "odometry=procrustes", *words, f"output={tmp_path / 'run'}"], quiet=True)
    assert row["status"] == "ok" and row["views"] + row["views_lost"] == 8
    assert ("never arrived" in row["failure"]) == bool(why) and (not why or row["failure"] == why)


def test_a_run_recorded_from_images_without_times_stays_without_times(tmp_path):
    numbered(tmp_path / "folder", [f"rgb/{k}.png" for k in range(3)], depth=[f"depth/{k}.png" for k in range(3)])
    words = ["task=survey", "pictures=off", f"output={tmp_path / 'run'}", f"source.path={tmp_path / 'folder'}"]
    rhs.run(["source=replay", f"source.camera={CAMERA}", *words], quiet=True)
    assert not opened(tmp_path / "run").timed
    rhs.run(["source=replay", f"source.camera={CAMERA}", "source.rate_hz=10", "overwrite=true", *words], quiet=True)
    assert opened(tmp_path / "run").timed


@pytest.mark.parametrize(("late_s", "off_s", "travel"), [(0.01, 0.0, 0.2), (0.37, 0.0, 0.2), (0.37, -500.0, 0.2)])
def test_the_wheels_of_a_view_are_those_of_when_it_was_taken(tmp_path, late_s, off_s, travel):
    """Wheels ten times a second, 0.1 m further each; a scan every 0.2 s that arrives late, or whose clock is another."""
    events = [(1.0 + 0.1 * k, "wheel", k) for k in range(12)] + [(1.0 + 0.2 * k + late_s, "scan", k) for k in range(3)]
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for bag.clock_s, what, k in sorted(events):
            if what == "wheel":
                bag.odometry("/odom", bag.clock_s, 0.1 * k, 0.0, 0.0)
            else:
                bag.scan("/scan", 1.0 + 0.2 * k + off_s, [2.0, 3.0, 4.0])
    seen = [capture.travel for capture, _ in opened(bag.path).views]
    assert seen[0] is None and [one[0] for one in seen[1:]] == pytest.approx([travel, 0.2])


@pytest.mark.parametrize(("views", "stamps", "holds"), [
    ("auto", [1.05, 1.1], {"image", "gray", "depth", "scan"}), ("scans", [1.0, 1.12], {"scan"})])
def test_of_a_robot_with_camera_and_laser_the_scans_come_when_they_were_taken(tmp_path, views, stamps, holds):
    """As sensor=laser asks for; beside images a scan is as old as it happens to be."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.camera_info("/camera/color/camera_info", 1.0)
        for scan_s, image_s in ((1.0, 1.05), (1.12, 1.1)):
            bag.clock_s = image_s if scan_s > image_s else scan_s
            bag.scan("/scan", scan_s, [2.0, 3.0, 4.0])
            bag.clock_s = image_s
            bag.image("/camera/color/image_raw", image_s, picture(), "rgb8")
            bag.image("/camera/depth/image_raw", image_s, MILLIMETRES, "16UC1")
    recording = opened(bag.path, views=views)
    assert [capture.stamp_s for capture, _ in recording.views] == stamps and recording.provides == holds


def test_sensors_of_lasers_ask_for_their_own_views():
    for sensor, views in (("laser", "scans"), ("lidar", "clouds"), ("rgbd", "auto")):
        config = compose_config([f"sensor={sensor}", "source=replay", "source.path=x"])
        assert config.parts["source"].settings.views == views
