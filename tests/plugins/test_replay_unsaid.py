"""Recordings that were read in silence, or not at all: what is wrong with them is said, and the rest is read."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from bags import KINDS, BagFile, picture

from rhs.api.errors import ConfigError
from rhs_sources.bags.messages import camera_of
from rhs_sources.folders.clouds import check_solid
from rhs_sources.replay import ReplaySource, open_recording
from rhs_sources.replay_config import Replay

NONE = (np.nan, 0.0, 0.0)


def scan(made: BagFile, k: int, ranges, least_m: float = 0.1, most_m: float = 10.0) -> None:
    values = np.asarray(ranges, np.float32)
    made.put("/scan", 1.0 + k, made.make(
        "sensor_msgs/msg/LaserScan", header=made.header(1.0 + k, "laser"), angle_min=-1.0, angle_max=1.0,
        angle_increment=2.0 / (len(values) - 1), time_increment=0.0, scan_time=0.1, range_min=least_m, range_max=most_m,
        ranges=values, intensities=np.zeros(0, np.float32)))


@pytest.mark.parametrize(("ranges", "least_m", "said"), [
    ([2.0, 3.0, 4.0], 5.0, "2.00 to 4.00 m) are nearer than its range_min, 5 m"),
    ([np.inf, 0.0, np.nan], 0.1, "no beam met anything"), ([2.0, 3.0, 6.0], 5.0, ""), ([np.inf, 0.0, 3.0], 0.1, "")])
def test_scans_that_hold_nothing_are_said_to(tmp_path, caplog, ranges, least_m, said):
    with BagFile(tmp_path, "ros2_mcap") as made:
        for k in range(3):
            scan(made, k, ranges, least_m)
    assert len(list(open_recording(Replay(path=str(made.path))).views)) == 3
    assert said in caplog.text and bool(caplog.text) == bool(said)


def test_one_broken_message_ends_no_recording(tmp_path):
    """A depth image of another kind, or a scan without a range_max, in the middle: a run of hours broke off."""
    for name, broken in (("images", False), ("scans", True)):
        (tmp_path / name).mkdir()
        with BagFile(tmp_path / name, "ros2_mcap") as made:
            for k in range(5):
                if broken:
                    made.odometry("/odom", 1.0 + k, 0.1 * k, 0.0, 0.0)
                    scan(made, k, [2.0] * 9, most_m=np.nan if k == 2 else 10.0)
                    continue
                made.camera_info("/camera/camera_info", 1.0 + k)
                made.image("/camera/image", 1.0 + k, picture(k), "rgb8")
                flat = np.full((48, 64), 200, np.uint8) if k == 2 else np.full((48, 64), 2000, np.uint16)
                made.image("/camera/depth", 1.0 + k, flat, "8UC1" if k == 2 else "16UC1")
        recording = open_recording(Replay(path=str(made.path)))
        assert len(list(recording.views)) == 4 and recording.rejected["unreadable"] == 1
        assert "1 views cannot be read" in recording.lost[0]


@pytest.mark.parametrize("listed", [True, False])
def test_one_image_of_another_kind_ends_no_folder(tmp_path, listed):
    for k in range(4):
        for name, image in (("rgb", picture(k)), ("depth", np.full((48, 64), 200, np.uint8 if k == 2 else np.uint16))):
            (tmp_path / name).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), image)
    for name in ("rgb", "depth") if listed else ():
        (tmp_path / f"{name}.txt").write_text("".join(f"{0.1 * k} {name}/{k}.png\n" for k in range(4)))
    settings = Replay(path=str(tmp_path), camera=[50.0, 50.0, 31.5, 23.5], depth_scale=100.0)
    recording = open_recording(settings)
    assert len(list(recording.views)) == 3 and "2.png is 8-bit" in recording.lost[0]
    cv2.imwrite(str(tmp_path / "depth" / "0.png"), np.full((48, 64), 200, np.uint8))
    with pytest.raises(ConfigError, match="is 8-bit"):
        open_recording(settings)


def test_scans_that_are_all_broken_are_refused_before_anything_runs(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as made:
        for k in range(3):
            scan(made, k, [2.0] * 9, most_m=np.nan)
    with pytest.raises(ConfigError, match="range_max are not finite"):
        ReplaySource(Replay(path=str(made.path)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_reading_of_the_wheels_without_a_pose_is_left_out_and_counted(tmp_path, kind):
    """NaN in the middle ended a run; the robot goes 0.1 m a view all the same."""
    with BagFile(tmp_path, kind) as made:
        for k in range(6):
            made.odometry("/odom", 1.0 + k, *(NONE if k == 3 else (0.1 * k, 0.0, 0.0)))
            made.camera_info("/camera/camera_info", 1.0 + k)
            made.image("/camera/image", 1.0 + k, picture(k), "rgb8")
    recording = open_recording(Replay(path=str(made.path), depth_topic="none"))
    travels = [capture.travel for capture, _ in recording.views]
    assert recording.rejected["no_pose"] == 1
    assert np.array(travels[1:]) == pytest.approx(np.tile([0.1, 0.0, 0.0], (5, 1)))


def test_links_of_tf_and_true_poses_that_are_none_are_left_out(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as made:
        for k in range(5):
            made.transform("/tf", 1.0 + k, "odom_combined", "base_footprint", np.nan if k == 2 else 0.1 * k)
            x, y, yaw = NONE if k == 2 else (0.1 * k, 0.0, 0.0)
            made.put("/gt", 1.0 + k, made.make("geometry_msgs/msg/PoseStamped", header=made.header(1.0 + k, "map"),
                                               pose=made.pose(x, y, yaw)))
            scan(made, k, [2.0, 3.0, 4.0])
    views = list(open_recording(Replay(path=str(made.path), truth_topic="/gt", max_truth_gap_s=0.5)).views)
    assert [None if truth is None else round(float(truth[0, 3]), 6) for _, truth in views] == [0.0, 0.1, None, 0.3, 0.4]
    assert [view.travel[0] for view, _ in views[1:]] == pytest.approx([0.1] * 4)  # of robot_pose_ekf's odom_combined


@pytest.mark.parametrize(("parent", "said"), [("laser_base", True), ("base", False)])
def test_a_laser_that_hangs_under_a_root_of_its_own_is_said_to(tmp_path, caplog, parent, said):
    with BagFile(tmp_path, "ros2_mcap") as made:
        made.transform("/tf_static", 1.0, "base", "imu", 0.1)
        made.transform("/tf_static", 1.0, parent, "laser", 0.3)
        for k in range(3):
            made.odometry("/odom", 1.0 + k, 0.1 * k, 0.0, 0.0)
            scan(made, k, [2.0, 3.0, 4.0])
    first = next(iter(open_recording(Replay(path=str(made.path))).views))[0].scan
    assert first.origin_xy_m == pytest.approx((0.0 if said else 0.3, 0.0))
    assert ("join the frame laser to base of the body" in caplog.text) == said


def test_a_heading_written_into_a_quaternion_is_refused(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as made:
        for k in range(3):
            pose = made.pose(0.0, 0.0, 0.0)
            pose = made.make("geometry_msgs/msg/Pose", position=pose.position, orientation=made.make(
                "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.5 * k, w=1.0))
            made.put("/gt", 1.0 + k, made.make("geometry_msgs/msg/PoseStamped", header=made.header(1.0 + k), pose=pose))
            scan(made, k, [2.0, 3.0, 4.0])
    with pytest.raises(ConfigError, match=r"/gt: quaternion .* is 1\.12 long"):
        open_recording(Replay(path=str(made.path), truth_topic="/gt"))


@pytest.mark.parametrize("name", ["walk.log", "walk.txt"])
def test_lines_that_are_indented_or_have_tabs_are_lines_of_a_log(tmp_path, name):
    rows = ["FLASER", "3", "1.0", "2.0", "3.0", *["0.1"] * 6, "1.5", "host", "1.5"]
    (tmp_path / name).write_text("\t" + "\t".join(rows) + "\n  " + " ".join(rows).replace("1.5", "1.7") + "\n")
    views = list(open_recording(Replay(path=str(tmp_path / name))).views)
    assert [view.scan.ranges_m.tolist() for view, _ in views] == [[1.0, 2.0, 3.0]] * 2


def test_a_line_in_the_middle_of_a_log_that_is_not_whole_is_left_out(tmp_path):
    line = "FLASER 3 1.0 2.0 3.0 0 0 0 {} 0 0 {} host 1\n"
    lines = [line.format(0.1 * k, k) for k in range(30)]
    lines[7] = lines[7][:20] + "\n"
    (tmp_path / "walk.log").write_text("".join(lines))
    recording = open_recording(Replay(path=str(tmp_path / "walk.log")))
    assert len(list(recording.views)) == 29 and "1 line is not whole, the first: walk.log:8" in recording.lost[0]
    (tmp_path / "walk.log").write_text("".join(lines[5:15]))  # one of nine is no slip of the pen
    with pytest.raises(ConfigError, match="walk.log:3"):
        open_recording(Replay(path=str(tmp_path / "walk.log")))


def test_what_macos_lays_beside_each_file_is_none_of_the_recording(tmp_path):
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(k))
        (tmp_path / f"._{k}.png").write_bytes(b"Mac OS X")
    assert len(list(open_recording(Replay(path=str(tmp_path), camera=[50.0, 50.0, 31.5, 23.5])).views)) == 3


@pytest.mark.parametrize(("text", "said"), [("POS 1 2 3\nLASER-RANGE 06-03-1999 17:54:26 0 180\n", "in cm and degrees"),
                                            ("#ROBOT 1 2 3\n#LASER 180 0\n", "in cm and degrees")])
def test_logs_of_beesoft_are_named(tmp_path, text, said):
    (tmp_path / "old.log").write_text(text)
    with pytest.raises(ConfigError, match=said):
        open_recording(Replay(path=str(tmp_path / "old.log")))


@pytest.mark.parametrize(("one", "other", "said"), [
    ("r-1316653580.48-131650062{}.ppm", "d-1316653580.47-131613841{}.ppm", "NYU's raw images"),
    ("a_{}0.png", "b_{}5.png", "two series; expected one in a folder: move the others")])
def test_two_series_in_a_folder_are_not_one_recording(tmp_path, one, other, said):
    """NYU's raw depth was led as every other colour image, in silence."""
    for k in range(3):
        for name in (one, other):
            cv2.imwrite(str(tmp_path / name.format(k)), picture(k))
    settings = Replay(path=str(tmp_path), camera=[50.0, 50.0, 31.5, 23.5])
    with pytest.raises(ConfigError, match=said):
        open_recording(settings)
    for path in tmp_path.glob(other.replace("{}", "*")):
        path.unlink()
    assert len(list(open_recording(settings).views)) == 3


def test_a_list_that_was_written_on_windows_is_read(tmp_path):
    (tmp_path / "rgb").mkdir()
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"rgb/{k}.png"), picture(k))
    (tmp_path / "rgb.txt").write_text("1.0 rgb\\0.png\r\n1.1 .\\rgb\\1.png\r\n")
    settings = Replay(path=str(tmp_path), camera=[50.0, 50.0, 31.5, 23.5])
    assert len(list(open_recording(settings).views)) == 2
    (tmp_path / "rgb.txt").write_text("1.0 ..\\0.png\r\n")
    with pytest.raises(ConfigError, match="leads out of the recording"):
        open_recording(settings)


def test_a_folder_with_one_video_says_what_to_type(tmp_path):
    (tmp_path / "CLIP.MP4").write_bytes(b"x")
    with pytest.raises(ConfigError, match=r"type source\.path=.*CLIP\.MP4"):
        open_recording(Replay(path=str(tmp_path)))


def test_clouds_in_millimetres_and_flat_ones_with_beams_that_met_nothing_are_refused():
    rng = np.random.default_rng(0)
    points = rng.uniform(-5.0, 5.0, (500, 3))
    check_solid(points, "/points")
    with pytest.raises(ConfigError, match="expected metres"):
        check_solid(1000.0 * points, "/points")
    flat = points * [1.0, 1.0, 0.0]
    flat[::3] = np.nan
    with pytest.raises(ConfigError, match="one plane"):
        check_solid(flat, "/points")


def test_intrinsics_that_are_shares_of_the_image_are_none(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as made:
        made.image("/camera/image", 1.0, picture(), "rgb8")
        message = made.make("sensor_msgs/msg/CameraInfo", header=made.header(1.0), height=48, width=64,
                            distortion_model="plumb_bob", d=np.zeros(5), k=np.array([0.8, 0, 0.5, 0, 1.1, 0.5, 0, 0, 1]),
                            r=np.eye(3).ravel(), p=np.zeros(12), binning_x=0, binning_y=0, roi=made.make(
                                "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0,
                                do_rectify=False))
    assert camera_of(message) is None
