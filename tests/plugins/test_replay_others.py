"""Recordings as people really have them: other units, names and ends; what cannot be right is refused, guesses are said."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from bags import HEIGHT, KINDS, WIDTH, BagFile, picture

from rhs.api.errors import ConfigError
from rhs_sources.replay import ReplaySource, open_recording
from rhs_sources.replay_config import Replay

CAMERA = [50.0, 50.0, 31.5, 23.5]
STAMPS = [1.7e9 + 0.1 * k for k in range(4)]
POSE = "0 0 0 0 0 0 1"


def opened(path, **settings):
    return open_recording(Replay(path=str(path), **settings))


def tum(folder, *, depth=2.0, steps=5000, stamp="{:.6f}".format, depth_late_s=0.0, truth=True):
    """Four views of a wall."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
    lists = {"rgb": "", "depth": ""}
    for k, seconds in enumerate(STAMPS):
        cv2.imwrite(str(folder / f"rgb/{k}.png"), picture(k))
        cv2.imwrite(str(folder / f"depth/{k}.png"), np.full((HEIGHT, WIDTH), depth * steps, np.uint16))
        lists["rgb"] += f"{stamp(seconds)} rgb/{k}.png\n"
        lists["depth"] += f"{stamp(seconds + depth_late_s)} depth/{k}.png\n"
    for name, text in lists.items():
        (folder / f"{name}.txt").write_text(text)
    if truth:
        (folder / "groundtruth.txt").write_text("".join(f"{stamp(seconds)} {POSE}\n" for seconds in STAMPS))
    return folder


def test_stamps_in_nanoseconds_are_seconds(tmp_path):
    recording = opened(tum(tmp_path, stamp=lambda s: str(round(s * 1e9)), depth_late_s=0.004), camera=CAMERA)
    views = list(recording.views)
    assert [view.stamp_s for view, _ in views] == pytest.approx(STAMPS, abs=1e-6)
    assert all(pose is not None for _, pose in views) and not recording.rejected


def test_depth_on_a_scale_that_makes_toys_or_halls_of_rooms_is_pointed_at(tmp_path, caplog):
    path = tum(tmp_path, depth=1.2, steps=1000)  # millimetres, where 5000 steps a metre are usual
    opened(path, camera=CAMERA)
    assert "5000 steps a metre: typically 0.24 m" in caplog.text and "type source.depth_scale=1000" in caplog.text
    caplog.clear()
    assert np.nanmedian(next(opened(path, camera=CAMERA, depth_scale=1000).views)[0].depth) == pytest.approx(1.2)
    assert "depth_scale" not in caplog.text


def test_a_truth_of_twelve_numbers_is_not_read_as_eight(tmp_path):
    path = tum(tmp_path)
    (path / "groundtruth.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 4)
    with pytest.raises(ConfigError, match=r"found 12 columns; expected stamp tx"):
        opened(path, camera=CAMERA)


def test_a_truth_of_another_clock_is_said_to_be_of_no_view(tmp_path, caplog):
    path = tum(tmp_path)
    (path / "groundtruth.txt").write_text(f"1.5 {POSE}\n2.5 {POSE}\n")
    assert [pose for _, pose in opened(path, camera=CAMERA).views] == [None] * 4
    assert "are of none of the views" in caplog.text


def test_intrinsics_of_another_image_size_are_pointed_at(tmp_path, caplog):
    path = tum(tmp_path)
    opened(path, camera=CAMERA)
    assert "principal point" not in caplog.text
    opened(path, camera=[2 * v for v in CAMERA])
    assert "principal point (63, 47) lies far from the middle of images of 64x48" in caplog.text


@pytest.mark.parametrize("width", [3, 4, 5])
def test_bin_clouds_are_read_by_fours_and_of_others_it_is_said(tmp_path, width):
    """1200 points of 3, 4 or 5 floats: all divisible by four."""
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.normal(0, 12, 1200), rng.normal(0, 8, 1200), rng.normal(-1, 0.7, 1200),
                             rng.uniform(0, 1, 1200), rng.integers(0, 32, 1200)]).astype("<f4")[:, :width]
    (tmp_path / "000000.bin").write_bytes(np.ascontiguousarray(table).tobytes())
    if width == 4:
        assert np.array_equal(next(opened(tmp_path).views)[0].extras["cloud"], table[:, :3])
    else:
        with pytest.raises(ConfigError, match=f"looks like {width} float32 a point"):
            opened(tmp_path)


@pytest.mark.parametrize("kind", ["npy", "tiff"])
def test_depth_in_floating_metres_is_read_as_metres(tmp_path, kind):
    for name in ("color", "depth", "pose"):
        (tmp_path / name).mkdir()
    for k in range(3):
        depth = np.full((HEIGHT, WIDTH), 2.5, np.float32)
        depth[0] = np.nan
        cv2.imwrite(str(tmp_path / f"color/frame_{k:04d}.png"), picture(k))
        np.save(tmp_path / f"depth/{k:04d}.npy", depth) if kind == "npy" else cv2.imwrite(
            str(tmp_path / f"depth/{k:04d}.tiff"), depth)
        np.savetxt(tmp_path / f"pose/frame_{k:04d}.txt", np.eye(4))
    views = list(opened(tmp_path, camera=CAMERA).views)
    assert len(views) == 3 and all(np.nanmedian(view.depth) == 2.5 and np.isnan(view.depth[0]).all() for view, _ in views)
    assert all(pose is not None for _, pose in views)  # the numbers at the ends of their names


def test_depth_of_a_kind_that_is_not_read_is_named(tmp_path, caplog):
    for name in ("color", "depth"):
        (tmp_path / name).mkdir()
    cv2.imwrite(str(tmp_path / "color/0.png"), picture())
    (tmp_path / "depth/0.exr").write_bytes(b"v/1\x01")
    assert "depth" not in opened(tmp_path, camera=CAMERA).provides and "no depth is read from depth" in caplog.text


def bag(folder, fill):
    with BagFile(folder, "ros2_mcap") as made:
        fill(made)
    return made.path


def scans(ranges, **changes):
    def fill(made):
        for k in range(3):
            values = {"angle_min": -1.0, "angle_max": 1.0, "angle_increment": 2.0 / max(len(ranges) - 1, 1),
                      "range_min": 0.0, "range_max": 30.0} | changes
            made.put("/scan", STAMPS[k], made.make(
                "sensor_msgs/msg/LaserScan", header=made.header(STAMPS[k], "laser"), time_increment=0.0, scan_time=0.1,
                ranges=np.asarray(ranges, np.float32), intensities=np.zeros(0, np.float32), **values))

    return fill


def test_a_range_of_zero_is_no_wall_where_the_scanner_stands(tmp_path):
    scan = next(opened(bag(tmp_path, scans([2.0, 0.0, 3.0, np.inf]))).views)[0].scan
    assert np.array_equal(scan.ranges_m, [2.0, np.nan, 3.0, np.inf], equal_nan=True)


@pytest.mark.parametrize("end", [np.inf, 3e38])
def test_a_scanner_that_names_no_end_of_its_range_is_read(tmp_path, end):
    """As pointcloud_to_laserscan writes it where nobody sets range_max."""
    scan = next(opened(bag(tmp_path, scans([2.0, np.inf, 3.0, np.nan], range_max=end))).views)[0].scan
    assert np.array_equal(scan.ranges_m, [2.0, np.inf, 3.0, np.nan], equal_nan=True) and np.isfinite(scan.max_range_m)


@pytest.mark.parametrize("ranges, changes, words", [
    ([2.0] * 9, {"angle_increment": 0.0}, "0 rad apart"),
    ([2.0] * 181, {"angle_increment": 1.0}, "in radians"), ([200.0] * 9, {"range_max": 3e3}, "in centimetres"),
    ([2000.0] * 9, {"range_max": 3e4}, "typical reading is 2000")])
def test_scans_in_degrees_or_millimetres_are_refused(tmp_path, ranges, changes, words):
    with pytest.raises(ConfigError, match=words):
        next(opened(bag(tmp_path, scans(ranges, **changes))).views)


@pytest.mark.parametrize("kind", KINDS)
def test_of_several_echoes_the_first_is_the_scan_and_a_beam_without_one_is_unknown(tmp_path, kind):
    """As Hokuyo's drivers write them, and the bags of the Deutsches Museum hold them; through glass there are two."""
    with BagFile(tmp_path, kind) as made:
        for k in range(3):
            echoes = [made.make("sensor_msgs/msg/LaserEcho", echoes=np.array(one, np.float32))
                      for one in ([2.0], [1.5, 4.0], [], [np.inf])]
            made.put("/horizontal", STAMPS[k], made.make(
                "sensor_msgs/msg/MultiEchoLaserScan", header=made.header(STAMPS[k], "laser"), angle_min=-0.3, angle_max=0.3,
                angle_increment=0.2, time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=30.0, ranges=echoes,
                intensities=[]))
    recording = opened(made.path)
    scan = next(recording.views)[0].scan
    assert recording.provides == {"scan"}
    assert np.array_equal(scan.ranges_m, [2.0, 1.5, np.nan, np.inf], equal_nan=True)
    np.testing.assert_allclose(scan.bearings_rad, [-0.3, -0.1, 0.1, 0.3], atol=1e-6)


def test_scans_without_beams_are_left_out_and_counted(tmp_path):
    """Drivers send some while a scanner starts."""
    def fill(made):
        scans([])(made)
        made.put("/scan", STAMPS[3], made.make(
            "sensor_msgs/msg/LaserScan", header=made.header(STAMPS[3], "laser"), angle_min=-1.0, angle_max=1.0,
            angle_increment=1.0, range_min=0.0, range_max=30.0, time_increment=0.0, scan_time=0.1,
            ranges=np.full(3, 2.0, np.float32),
            intensities=np.zeros(0, np.float32)))

    recording = opened(bag(tmp_path, fill))
    assert len(list(recording.views)) == 1 and recording.rejected == {"empty": 3}


def images(made, color="/camera/rgb/image_raw", *, late_s=0.0, infos=("/camera/rgb/camera_info",), lens=(0.0,) * 5):
    for k, seconds in enumerate(STAMPS):
        made.image(color, seconds, picture(k), "rgb8")
        made.image("/camera/depth/image_raw", seconds + late_s, np.full((HEIGHT, WIDTH), 2000, np.uint16), "16UC1")
        for info in infos:
            made.camera_info(info, seconds, lens)


@pytest.mark.parametrize("color, bent", [("/camera/rgb/image_rect_color", False), ("/camera/rgb/image_raw", True)])
def test_the_lens_of_images_that_are_rectified_is_not_undone_again(tmp_path, color, bent):
    path = bag(tmp_path, lambda made: images(made, color, lens=(0.26, -0.9, 0.0, 0.0, 1.1)))
    assert bool(opened(path).camera.distortion) == bent


def test_of_two_cameras_infos_beside_neither_the_user_chooses(tmp_path):
    path = bag(tmp_path, lambda made: images(made, "/rgb", infos=("/front/camera_info", "/rear/camera_info")))
    with pytest.raises(ConfigError, match=r"several info topics; type source\.info_topic=NAME of /front/camera_info, "):
        opened(path)
    assert opened(path, info_topic="/front/camera_info").camera.fx == 50.0


def test_colour_and_depth_that_never_meet_are_refused_before_anything_runs(tmp_path):
    path = bag(tmp_path, lambda made: images(made, late_s=0.05))
    with pytest.raises(ConfigError, match=r"no whole view .*unpaired.*source\.max_difference_s"):
        ReplaySource(Replay(path=str(path)))
    source = ReplaySource(Replay(path=str(path), max_difference_s=0.06))
    assert source.lead() is not None
    source.close()


def test_a_carmen_log_that_is_cut_is_read_up_to_its_last_whole_line(tmp_path):
    line = "FLASER 4 1.0 2.0 2.0 1.0 0 0 0 0 0 0 {k} host {k}\n"
    (tmp_path / "cut.log").write_text("".join(line.format(k=k) for k in range(5)) + "FLASER 4 1.0 2.")
    recording = opened(tmp_path / "cut.log")
    assert len(list(recording.views)) == 5 and "its last line, 6, is not whole" in recording.lost[0]
    (tmp_path / "bad.log").write_text("FLASER 4 1.0 2.\n" + line.format(k=1))
    with pytest.raises(ConfigError, match=r"bad\.log:1"):
        opened(tmp_path / "bad.log")


def test_a_video_that_is_cut_says_how_much_of_it_there_is(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "whole.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, (WIDTH, HEIGHT))
    for k in range(40):
        writer.write(picture(k))
    writer.release()
    whole = (tmp_path / "whole.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) // 2])
    recording = opened(tmp_path / "cut.avi", camera=CAMERA)
    count = len(list(recording.views))
    assert 0 < count < 36 and recording.lost == [f"the video is cut: {count} of 40 pictures"]
    recording = opened(tmp_path / "whole.avi", camera=CAMERA)
    assert len(list(recording.views)) == 40 and not recording.lost


def test_what_is_missing_of_a_kitti_folder_or_a_bag_is_named(tmp_path):
    (tmp_path / "kitti/image_2").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "kitti/image_2/000000.png"), picture())
    with pytest.raises(ConfigError, match=r"without its calib\.txt"):
        opened(tmp_path / "kitti")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag/bag_0.db3").write_bytes(b"SQLite format 3\x00")
    with pytest.raises(ConfigError, match="ros2 bag reindex"):
        opened(tmp_path / "bag")
