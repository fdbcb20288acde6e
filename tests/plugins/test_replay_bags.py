"""Replaying ROS bags of all three kinds: encodings, pairing, wheels, scans, clouds, truth, and refusals in one line."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from bags import HEIGHT, KINDS, WIDTH, BagFile, picture
from helpers.replayed import refused, views

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera
from rhs.recording.ros import camera_info
from rhs_sources.bags.bag import choose_topics
from rhs_sources.bags.messages import camera_of, points_of
from rhs_sources.replay_config import Replay
from rhs_sources.replay_sensor import suited_sensor

ALL_KINDS = pytest.mark.parametrize("kind", KINDS)
COLOR, DEPTH, INFO = "/camera/rgb/image_color", "/camera/depth/image", "/camera/rgb/camera_info"
MILLIMETRES = np.full((HEIGHT, WIDTH), 2500, np.uint16)


def write(folder, kind="ros2_mcap", count=4, depth=MILLIMETRES, encoding="16UC1", extra=None):
    """A bag of colour, depth 5 ms later, and camera info; `extra(bag, k, stamp)` puts in more. Its path."""
    with BagFile(folder, kind) as bag:
        for k in range(count):
            stamp = 100.0 + 0.1 * k
            bag.camera_info(INFO, stamp)
            bag.image(COLOR, stamp, picture(k), "rgb8")
            if depth is not None:
                bag.image(DEPTH, stamp + 0.005, depth, encoding)
            if extra:
                extra(bag, k, stamp)
    return bag.path


@ALL_KINDS
def test_colour_and_depth_are_paired_and_the_camera_is_the_recorded_one(tmp_path, kind):
    source, seen = views(write(tmp_path, kind))
    assert (source.camera.width, source.camera.fx, source.camera.cy) == (WIDTH, 50.0, 23.5)
    assert source.views_expected == 4
    assert [round(c.stamp_s, 3) for c, _ in seen] == [100.0, 100.1, 100.2, 100.3]
    assert [c.image[3, 3].tolist() for c, _ in seen] == [[50 + k, 0, 7] for k in range(4)]
    assert all(np.all(c.depth == 2.5) and c.sensed for c, _ in seen)
    assert all(truth is None for _, truth in seen)


def lens_bag(folder, distortion, model="plumb_bob"):
    with BagFile(folder, "ros2_mcap") as bag:
        bag.camera_info(INFO, 1.0, distortion, model)
        bag.image(COLOR, 1.0, picture(), "rgb8")
        bag.image(DEPTH, 1.0, MILLIMETRES, "16UC1")
    return bag.path


def test_the_lens_of_a_recording_is_undone_where_pixels_become_rays(tmp_path):
    """k1 = -0.2: the point (0.3, 0.4) of the plane z = 1 is seen at 0.95 of that: 14.25 px right, 19 px down."""
    source, _ = views(lens_bag(tmp_path, (-0.2, 0.0, 0.0, 0.0, 0.0)))
    assert source.camera.distortion == (-0.2, 0.0, 0.0, 0.0, 0.0)
    seen = np.array([[31.5 + 14.25, 23.5 + 19.0]])
    assert source.camera.rays(seen)[0] == pytest.approx([0.3, 0.4, 1.0], abs=1e-6)


@pytest.mark.parametrize(("distortion", "model", "complaint"), [
    ((0.1, 0.2, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.1), "rational_polynomial", "the ninth or later not zero"),
    ((0.1, 0.2, 0.0, 0.0), "double_sphere", "expected plumb_bob"),
    ((-9.0, 0.0, 0.0, 0.0), "equidistant", "fold the image over itself"),
])
def test_a_lens_of_another_kind_is_refused_in_one_line(tmp_path, distortion, model, complaint):
    with pytest.raises(ConfigError, match=complaint) as caught:
        views(lens_bag(tmp_path, distortion, model))
    assert "\n" not in str(caught.value)


def test_start_stride_and_count_choose_views(tmp_path):
    source, seen = views(write(tmp_path, count=9), start=1, stride=3, count=2)
    assert source.views_expected == 2
    assert [c.image[0, 0, 0] for c, _ in seen] == [51, 54] and [c.index for c, _ in seen] == [0, 1]


@pytest.mark.parametrize(
    ("depth", "encoding", "metres"),
    [(MILLIMETRES, "mono16", 2.5), (np.full((HEIGHT, WIDTH), 1.25, np.float32), "32FC1", 1.25)],
)
def test_depth_encodings_become_metres(tmp_path, depth, encoding, metres):
    _, seen = views(write(tmp_path, depth=depth, encoding=encoding))
    assert np.all(seen[0][0].depth == metres)


@ALL_KINDS
def test_compressed_images_and_compressed_depth_are_read(tmp_path, kind):
    with BagFile(tmp_path, kind) as bag:
        bag.camera_info(INFO, 1.0)
        bag.compressed(f"{COLOR}/compressed", 1.0, picture()[:, :, ::-1], "rgb8; png compressed bgr8")
        bag.compressed(f"{DEPTH}/compressedDepth", 1.0, MILLIMETRES, "16UC1; compressedDepth png")
    _, seen = views(bag.path)
    assert seen[0][0].image[0, 0].tolist() == [50, 0, 7] and np.all(seen[0][0].depth == 2.5)


def test_wheels_and_scans_go_along_with_the_views(tmp_path):
    def extra(bag, k, stamp):
        bag.odometry("/odom", stamp + 0.001, 0.2 * k, 0.0, 0.0)
        bag.scan("/scan", stamp + 0.001, [1.0, 20.0, 0.05])

    _, seen = views(write(tmp_path, extra=extra))
    assert seen[0][0].travel is None
    np.testing.assert_allclose(seen[2][0].travel, [0.2, 0.0, 0.0], atol=1e-9)
    np.testing.assert_array_equal(seen[0][0].scan.ranges_m, [1.0, np.inf, np.nan])


def test_a_bag_of_scans_alone_is_a_laser_recording(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(3):
            bag.odometry("/odom", 1.0 + k, 0.0, 0.0, 0.1 * k)
            bag.scan("/scan", 1.01 + k, [1.0, 2.0, 3.0])
    _, seen = views(bag.path)
    assert len(seen) == 3 and seen[0][0].image is None
    np.testing.assert_allclose(seen[1][0].travel, [0.0, 0.0, 0.1], atol=1e-9)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("padding", [0, 8])
def test_a_cloud_is_read_in_its_byte_order_and_without_what_its_rows_end_in(order, padding):
    points = np.arange(18.0).reshape(2, 3, 3)
    fields = [SimpleNamespace(name=n, offset=4 * k, datatype=7) for k, n in enumerate("xyz")]
    raw = np.pad(points.astype(order + "f4").view(np.uint8).reshape(2, -1), ((0, 0), (0, padding)))
    cloud = SimpleNamespace(fields=fields, point_step=12, width=3, height=2, row_step=36 + padding, data=raw.ravel(),
                            is_bigendian=order == ">")
    np.testing.assert_array_equal(points_of(cloud, "/cloud")[0], points.reshape(6, 3))


@pytest.mark.parametrize("nothing", [10.0, 10.5, 9.97, np.inf])
def test_a_laser_that_met_nothing_says_so_by_its_range_max_or_just_below(tmp_path, nothing):
    """One beam of three; range_max is 10 m, the walls are up to 9 m away."""
    walls = np.random.default_rng(0).uniform(0.5, 9.0, (200, 2))
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k, (a, b) in enumerate(walls):
            bag.scan("/scan", 1.0 + 0.1 * k, [a, nothing, b])
    for (capture, _), (a, b) in zip(views(bag.path)[1], walls, strict=True):
        np.testing.assert_allclose(capture.scan.ranges_m, [a, np.inf, b])


def test_a_cloud_stands_in_for_depth_nearest_point_first(tmp_path):
    points = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0], [np.nan, 0, 1], [0, 0, -1]])

    _, seen = views(write(tmp_path, depth=None, extra=lambda bag, k, stamp: bag.cloud("/points", stamp, points)))
    depth = seen[0][0].depth
    assert np.isfinite(depth).sum() == 1 and depth[24, 32] == 2.0  # (31.5, 23.5) rounds to even


def test_truth_is_taken_only_where_it_is_named(tmp_path):
    path = write(tmp_path, extra=lambda bag, k, stamp: bag.odometry("/vicon", stamp, 1.0 + k, 0.0, 0.0))
    _, seen = views(path, truth_topic="/vicon", wheel_topic="none")
    np.testing.assert_allclose([truth[0, 3] for _, truth in seen], [1.0, 2.0, 3.0, 4.0])
    with pytest.raises(ConfigError, match="no topic /mocap; found"):
        views(path, truth_topic="/mocap")


def test_truth_from_tf_follows_the_chain_to_the_camera(tmp_path):
    def extra(bag, k, stamp):
        bag.transform("/tf", stamp, "world", "rig", 1.0 * k)
        if k == 0:
            bag.transform("/tf_static", stamp, "rig", "camera", 0.5)

    path = write(tmp_path, extra=extra)
    _, seen = views(path, truth_frame="world")
    np.testing.assert_allclose([truth[0, 3] for _, truth in seen], [0.5, 1.5, 2.5, 3.5], atol=1e-6)
    with pytest.raises(ConfigError, match="no tf chain from map to camera; found camera, rig, world"):
        views(path, truth_frame="map")


def test_repeated_and_backward_stamps_are_dropped_and_counted(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.camera_info(INFO, 1.0)
        for k, stamp in enumerate((1.0, 1.1, 1.1, 1.05, 1.2, 1.3)):
            bag.clock_s = 5.0 + k
            bag.image(COLOR, stamp, picture(k), "rgb8")
            if stamp != 1.2:
                bag.image(DEPTH, stamp, MILLIMETRES, "16UC1")
    source = Replay(path=str(bag.path)).build(None)
    seen = []
    while (capture := source.lead()) is not None:
        seen.append(round(capture.stamp_s, 2))
        counts = dict(source.rejected)
    assert seen == [1.0, 1.1, 1.3]
    assert counts == {"duplicate": 2, "backward": 2, "unpaired": 1}


def test_headers_without_a_stamp_mean_the_time_of_arrival(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.camera_info(INFO, 0.0)
        for k in range(3):
            bag.clock_s = 5.0 + 0.1 * k
            bag.image(COLOR, 0.0, picture(k), "rgb8")
            bag.image(DEPTH, 0.0, MILLIMETRES, "16UC1")
    _, seen = views(bag.path)
    assert [round(c.stamp_s, 3) for c, _ in seen] == [5.0, 5.1, 5.2]


@pytest.mark.parametrize("kind", KINDS)
def test_a_simulators_clock_begins_at_zero(tmp_path, kind):
    with BagFile(tmp_path, kind) as bag:
        for k in range(3):
            bag.clock_s = 1.6e9 + 0.1 * k
            bag.camera_info(INFO, 0.1 * k)
            bag.image(COLOR, 0.1 * k, picture(k), "rgb8")
            bag.image(DEPTH, 0.1 * k, MILLIMETRES, "16UC1")
            bag.odometry("/pose", 0.1 * k, float(k), 0.0, 0.0)
    _, seen = views(bag.path, truth_topic="/pose")
    assert [round(c.stamp_s, 3) for c, _ in seen] == [0.0, 0.1, 0.2]
    assert [float(truth[0, 3]) for _, truth in seen] == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("distortion", [(), (0.26, -0.95, -0.005, 0.002, 1.1), (0.5, -2, 6e-4, -2e-4, 1.5, 0.4, -2.5, 1.5)])
def test_a_camera_info_says_the_lens(distortion):
    camera = Camera(640, 480, 517.3, 516.5, 318.6, 255.3, distortion=distortion)
    message = camera_info(camera, 0, "camera")
    assert camera_of(message).distortion == distortion
    assert message.distortion_model == ("rational_polynomial" if len(distortion) == 8 else "plumb_bob")
    message.d = np.arange(1.0, 13.0)
    with pytest.raises(ConfigError, match="camera info has 12 distortion numbers, the ninth"):
        camera_of(message)


@pytest.mark.parametrize(
    ("change", "settings", "words"),
    [
        ({"depth": np.full((HEIGHT, WIDTH), 9, np.uint8), "encoding": "8UC1"}, {}, "depth is 8-bit 8UC1"),
        ({"depth": np.full((24, 32), 900, np.uint16)}, {}, "colour is 64x48 but depth is 32x24"),
        ({}, {"color_topic": "/left"}, "no topic /left; found"),
        ({}, {"depth_scale": 1e6}, "typical depth is 0.0025 m"),
        ({}, {"camera": "tum_fr2"}, "64x48 but source.camera=tum_fr2"),
    ],
)
def test_what_does_not_fit_is_refused_before_the_first_view(tmp_path, change, settings, words):
    with pytest.raises(ConfigError, match=words) as caught:
        views(write(tmp_path, **change), **settings)
    assert "\n" not in str(caught.value)


def test_a_bag_of_one_camera_is_read_without_a_word_about_depth(tmp_path):
    """It was refused, also with sensor=mono, until source.depth_topic=none was typed."""
    path = write(tmp_path, depth=None)
    assert {"image", "gray"} <= views(path)[0].provides and "depth" not in views(path)[0].provides
    assert suited_sensor(Replay(path=str(path))) == "mono"


def test_no_intrinsics_anywhere_is_said(tmp_path):
    with BagFile(tmp_path, "ros1") as bag:
        bag.image(COLOR, 1.0, picture(), "rgb8")
        bag.image(DEPTH, 1.0, MILLIMETRES, "16UC1")
    with pytest.raises(ConfigError, match="holds no camera intrinsics"):
        views(bag.path)
    assert len(views(bag.path, camera=[50, 50, 31.5, 23.5])[1]) == 1


def test_damaged_and_lone_files_are_refused_in_one_line(tmp_path):
    path = write(tmp_path, "ros1")
    path.write_bytes(path.read_bytes()[:300])
    (tmp_path / "x.bag").write_bytes(b"")
    (tmp_path / "y.db3").write_bytes(b"SQLite format 3")
    for broken in (path, tmp_path / "x.bag", tmp_path / "y.db3"):
        with pytest.raises(ConfigError) as caught:
            views(broken)
        assert "\n" not in str(caught.value) and str(broken) in str(caught.value)


def test_the_registered_depth_and_the_raw_colour_are_preferred():
    image, info = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
    found = {"/a/color/image_raw": image, "/a/color/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
             "/a/depth/image_rect_raw": image, "/a/aligned_depth_to_color/image_raw": image, "/a/infra1/image": image,
             "/a/color/camera_info": info, "/a/depth/camera_info": info}
    topics = choose_topics(found, Replay(), "bag")
    assert topics.color == "/a/color/image_raw" and topics.depth == "/a/aligned_depth_to_color/image_raw"
    assert topics.info == "/a/color/camera_info"
    with pytest.raises(ConfigError, match="several color topics"):
        choose_topics({"/l/image": image, "/r/image": image}, Replay(), "bag")


def part(folder, kind, first):
    """Three views of a bag, from view `first` on; its file."""
    folder.mkdir()
    with BagFile(folder, kind) as bag:
        for k in range(first, first + 3):
            bag.camera_info(INFO, 100.0 + k)
            bag.image(COLOR, 100.0 + k, picture(k), "rgb8")
            bag.image(DEPTH, 100.0 + k, MILLIMETRES, "16UC1")
    return bag.path if kind == "ros1" else next(bag.path.glob("*.mcap"))


@pytest.mark.parametrize(("kind", "names"), [
    ("ros1", ("walk_2026-01-02-10-00-00_0.bag", "walk_2026-01-02-10-00-09_1.bag")), ("ros1", ("a_0.bag", "a_1.bag")),
    ("ros2_mcap", ("a_0.mcap", "a_1.mcap"))])
def test_the_parts_of_a_split_bag_are_one(tmp_path, kind, names):
    (tmp_path / "split").mkdir()
    for k, name in reversed([*enumerate(names)]):
        part(tmp_path / str(k), kind, 3 * k).rename(tmp_path / "split" / name)
    source, seen = views(tmp_path / "split")
    assert [int(capture.image[3, 3, 0]) for capture, _ in seen] == [50, 51, 52, 53, 54, 55] and source.views_expected == 6


@pytest.mark.parametrize("names", [("monday.bag", "tuesday.bag"), ("walk_1.bag", "walk_2.bag"), ("a_0.bag", "b_1.bag")])
def test_bags_that_are_not_the_parts_of_one_are_not_read_as_one(tmp_path, names):
    (tmp_path / "two").mkdir()
    for k, name in enumerate(names):
        part(tmp_path / str(k), "ros1", 3 * k).rename(tmp_path / "two" / name)
    assert f"found 2 bags; type source.path={tmp_path / 'two' / names[0]}" in refused(tmp_path / "two")


def test_a_bag_that_cannot_be_read_further_gives_what_came_before_and_says_so(tmp_path, monkeypatch):
    """As SQLite says it where a page in the middle of a .db3 is damaged."""
    from rosbags.highlevel import AnyReader

    whole = AnyReader.messages

    def damaged(self, connections=()):
        for one in whole(self, connections=connections):
            if one[1] > 100.25e9:
                raise RuntimeError("database disk image is malformed")
            yield one

    monkeypatch.setattr(AnyReader, "messages", damaged)
    source, seen = views(write(tmp_path, "ros2_sqlite"))
    assert len(seen) == 3 and "cannot be read further (RuntimeError: database disk image is malformed)" in source.lost


def test_messages_that_are_packed_each_are_refused_where_nothing_says_so(tmp_path):
    """The metadata of the bag says how; its file alone does not."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    bag = BagFile(tmp_path, "ros2_mcap")
    bag.writer = Writer(bag.path, version=9, storage_plugin=StoragePlugin.MCAP)
    bag.writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with bag:
        bag.camera_info(INFO, 1.0)
        bag.image(COLOR, 1.0, picture(), "rgb8")
        bag.image(DEPTH, 1.0, MILLIMETRES, "16UC1")
    assert len(views(bag.path)[1]) == 1
    assert "cannot be read further" in refused(next(bag.path.glob("*.mcap")))


def test_a_thermal_camera_that_is_typed_is_no_depth_too(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for k in range(2):
            rows = np.linspace(0, 16383, HEIGHT * WIDTH).astype(np.uint16).reshape(HEIGHT, WIDTH)
            bag.image("/thermal/image_raw", 1.0 + k, rows, "16UC1")
    source, seen = views(bag.path, color_topic="/thermal/image_raw", camera=[50.0, 50.0, 31.5, 23.5])
    assert source.provides == {"image", "gray"} and int(seen[0][0].image.max()) == 255
