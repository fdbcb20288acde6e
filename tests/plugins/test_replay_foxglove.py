"""MCAP files of Foxglove's schemas, in protobuf and in JSON, and of ROS 1: read as bags are."""

from __future__ import annotations

import base64
import json
import struct

import cv2
import numpy as np
import pytest
from bags import HEIGHT, WIDTH, BagFile, picture
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from helpers.replayed import views

from rhs.api.errors import ConfigError
from rhs_sources.bags.protobuf import reader_of

K = [50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0]
DOUBLE, FIXED32, TEXT, MESSAGE, RAW, INT64, INT32 = 1, 7, 9, 11, 12, 3, 5


def varint(value):
    out = b""
    while value > 0x7F:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def wired(number, value):
    """A field of a message: floats as doubles, whole numbers as varints, else bytes."""
    if isinstance(value, float):
        return varint(number << 3 | 1) + struct.pack("<d", value)
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    value = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(value)) + value


def fixed(number, value):
    return varint(number << 3 | 5) + struct.pack("<I", value)


def schema(name, *fields, package="foxglove"):
    """A file of one message; fields: (name, number, type, many, message)."""
    file = FileDescriptorProto(name=f"{package}/{name}.proto", package=package, syntax="proto3")
    message = file.message_type.add(name=name)
    for one, number, kind, many, of in fields:
        message.field.add(name=one, number=number, type=kind, label=3 if many else 1, type_name=f".{of}" if of else None)
        if of:
            file.dependency.append("/".join(of.rsplit(".", 1)) + ".proto")
    return file


def together(*files):
    return FileDescriptorSet(file=files).SerializeToString()


TIME = schema("Timestamp", ("seconds", 1, INT64, 0, ""), ("nanos", 2, INT32, 0, ""), package="google.protobuf")
STAMPED = ("timestamp", 1, MESSAGE, 0, "google.protobuf.Timestamp")
POSE = (schema("Pose", ("position", 1, MESSAGE, 0, "foxglove.V"), ("orientation", 2, MESSAGE, 0, "foxglove.V")),
        schema("V", *((axis, number, DOUBLE, 0, "") for number, axis in enumerate("xyzw", start=1))))
IMAGE = together(schema("RawImage", STAMPED, ("width", 2, FIXED32, 0, ""), ("height", 3, FIXED32, 0, ""),
                        ("encoding", 4, TEXT, 0, ""), ("step", 5, FIXED32, 0, ""), ("data", 6, RAW, 0, ""),
                        ("frame_id", 7, TEXT, 0, "")), TIME)
CAMERA = together(schema("CameraCalibration", STAMPED, ("width", 2, FIXED32, 0, ""), ("height", 3, FIXED32, 0, ""),
                         ("D", 5, DOUBLE, 1, ""), ("K", 6, DOUBLE, 1, ""), ("frame_id", 9, TEXT, 0, "")), TIME)
CLOUD = together(TIME, *POSE, schema(
    "PointCloud", STAMPED, ("frame_id", 2, TEXT, 0, ""), ("pose", 3, MESSAGE, 0, "foxglove.Pose"),
    ("point_stride", 4, FIXED32, 0, ""), ("fields", 5, MESSAGE, 1, "foxglove.F"), ("data", 6, RAW, 0, "")),
    schema("F", ("name", 1, TEXT, 0, ""), ("offset", 2, FIXED32, 0, ""), ("type", 3, INT32, 0, "")))
AT = together(TIME, *POSE, schema("PoseInFrame", STAMPED, ("frame_id", 2, TEXT, 0, ""),
                                  ("pose", 3, MESSAGE, 0, "foxglove.Pose")))


def stamp(k):
    return wired(1, wired(1, 1_700_000_000) + wired(2, 100_000_000 * k))


def image(k, pixels, encoding):
    return (stamp(k) + fixed(2, WIDTH) + fixed(3, HEIGHT) + wired(4, encoding) + fixed(5, pixels.strides[0])
            + wired(6, pixels.tobytes()) + wired(7, "camera"))


def written(path, channels, profile=""):
    """channels: topic -> (encoding, schema's name, schema, messages)."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=profile)
        for topic, (encoding, name, text, messages) in channels.items():
            channel = writer.register_channel(topic, encoding, writer.register_schema(name, encoding, text))
            for k, message in enumerate(messages):
                writer.add_message(channel, 1_700_000_000 * 10**9 + k * 10**8, message, 0)
        writer.finish()
    return path


def in_protobuf(path):
    numbers = b"".join(map(struct.Struct("<d").pack, K))
    metres = np.full((HEIGHT, WIDTH), 2500, np.uint16)
    placed = [stamp(k) + wired(2, "world") + wired(3, wired(1, wired(1, 0.5 * k)) + wired(2, wired(4, 1.0)))
              for k in range(3)]
    return written(path, {
        "/color": ("protobuf", "foxglove.RawImage", IMAGE, [image(k, picture(k), "rgb8") for k in range(3)]),
        "/depth": ("protobuf", "foxglove.RawImage", IMAGE, [image(k, metres, "16UC1") for k in range(3)]),
        "/info": ("protobuf", "foxglove.CameraCalibration", CAMERA,
                  [stamp(0) + fixed(2, WIDTH) + fixed(3, HEIGHT) + wired(6, numbers) + wired(9, "camera")]),
        "/gt": ("protobuf", "foxglove.PoseInFrame", AT, placed)})


def test_images_depth_camera_and_poses_of_protobuf_are_read_by_the_schema_in_the_file(tmp_path):
    source, seen = views(in_protobuf(tmp_path / "a.mcap"), truth_topic="/gt")
    assert (source.camera.fx, source.camera.cx, source.camera.distortion) == (50.0, 31.5, ())
    assert [int(capture.image[0, 0, 0]) for capture, _ in seen] == [50, 51, 52]
    assert [float(np.median(capture.depth)) for capture, _ in seen] == [2.5] * 3
    assert [round(capture.stamp_s - 1.7e9, 3) for capture, _ in seen] == [0.0, 0.1, 0.2]
    assert [pose[0, 3] for _, pose in seen] == [0.0, 0.5, 1.0]


def test_scans_and_transforms_of_json_are_read_and_a_largest_reading_shared_by_many_is_free(tmp_path):
    ranges = [2.0] * 40 + [29.99] * 21

    def of(k, **more):
        return json.dumps({"timestamp": {"sec": 1_700_000_000, "nsec": 10**8 * k}} | more).encode()

    scans = [of(k, frame_id="laser", start_angle=-0.3, end_angle=0.3, ranges=ranges) for k in range(30)]
    place = {"parent_frame_id": "base_link", "child_frame_id": "laser", "translation": {"x": 0.2, "y": 0.0, "z": 0.0},
             "rotation": {"x": 0.0, "y": 0.0, "z": 2**-0.5, "w": 2**-0.5}}
    path = written(tmp_path / "a.mcap", {"/scan": ("json", "foxglove.LaserScan", b"{}", scans), "/where/it/is": (
        "json", "foxglove.FrameTransforms", b"{}", [of(k, transforms=[json.loads(of(k, **place))]) for k in range(30)])})
    _, seen = views(path)
    scan = seen[0][0].scan
    assert scan.bearings_rad[0] == pytest.approx(np.pi / 2 - 0.3) and scan.bearings_rad[-1] == pytest.approx(np.pi / 2 + 0.3)
    assert scan.origin_xy_m == pytest.approx((0.2, 0.0)) and np.isinf(scan.ranges_m).sum() == 21


def test_compressed_images_of_json_are_base64_and_a_lens_of_kannala_and_brandt_is_known(tmp_path):
    packed = base64.b64encode(cv2.imencode(".png", picture()[:, :, ::-1])[1].tobytes()).decode()
    at = {"timestamp": {"sec": 3, "nsec": 5}, "frame_id": "camera"}
    seen = at | {"format": "png", "data": packed}
    told = at | {"width": WIDTH, "height": HEIGHT, "distortion_model": "kannala_brandt", "D": [0.1, 0, 0, 0], "K": K}
    path = written(tmp_path / "a.mcap", {
        "/camera": ("json", "foxglove.CompressedImage", b"{}", [json.dumps(seen).encode()]),
        "/info": ("json", "foxglove.CameraCalibration", b"{}", [json.dumps(told).encode()])})
    source, images = views(path)
    np.testing.assert_array_equal(images[0][0].image, picture())
    assert images[0][0].stamp_s == 3.000000005 and any(source.camera.distortion)


def cloud(k, pose=b""):
    points = np.random.default_rng(k).uniform(-5, 5, (200, 3)).astype("<f4")
    fields = b"".join(wired(5, wired(1, axis) + fixed(2, 4 * n) + wired(3, 7)) for n, axis in enumerate("xyz"))
    return stamp(k) + wired(2, "lidar") + pose + fixed(4, 12) + fields + wired(6, points.tobytes())


def test_point_clouds_are_read_and_a_pose_of_their_own_is_where_the_scanner_sits(tmp_path):
    still = [cloud(k) for k in range(3)]
    path = written(tmp_path / "a.mcap", {"/points": ("protobuf", "foxglove.PointCloud", CLOUD, still)})
    _, seen = views(path)
    wanted = np.random.default_rng(1).uniform(-5, 5, (200, 3)).astype("<f4")
    np.testing.assert_array_equal(seen[1][0].extras["cloud"], wanted)
    moved = [cloud(k, wired(3, wired(1, wired(1, 1.5)))) for k in range(3)]
    path = written(tmp_path / "b.mcap", {"/points": ("protobuf", "foxglove.PointCloud", CLOUD, moved)})
    _, seen = views(path)
    np.testing.assert_allclose(seen[1][0].extras["cloud"], wanted + np.float32([1.5, 0, 0]), atol=1e-6)
    path = written(tmp_path / "c.mcap", {"/points": ("protobuf", "foxglove.PointCloud", CLOUD, [
        cloud(k, wired(3, wired(1, wired(1, 1.0 * k)) + wired(2, wired(4, 1.0)))) for k in range(3)])})
    with pytest.raises(ConfigError, match="/points: its messages have poses of their own that change, in one frame"):
        views(path)


def test_a_scan_with_a_pose_of_its_own_is_seen_from_there(tmp_path):
    """A laser 0.3 m ahead of its frame and turned to the left by a quarter: what it sees ahead is to the left."""
    scan = {"frame_id": "base_link", "start_angle": -0.1, "end_angle": 0.1, "ranges": [2.0, 3.0, 4.0], "pose": {
        "position": {"x": 0.3, "y": 0.0, "z": 0.1}, "orientation": {"x": 0.0, "y": 0.0, "z": 2**-0.5, "w": 2**-0.5}}}
    path = written(tmp_path / "a.mcap", {"/scan": ("json", "foxglove.LaserScan", b"{}", [json.dumps(
        {"timestamp": {"sec": 1_700_000_000, "nsec": 10**8 * k}} | scan).encode() for k in range(3)])})
    seen = views(path)[1][0][0].scan
    np.testing.assert_allclose(seen.bearings_rad, np.pi / 2 + np.array([-0.1, 0.0, 0.1]))
    assert seen.origin_xy_m == pytest.approx((0.3, 0.0)) and seen.ranges_m.tolist()[:2] == [2.0, 3.0]


def test_messages_of_ros_1_in_mcap_are_read(tmp_path):
    with BagFile(tmp_path, "ros1") as bag:
        scan = bag.make("sensor_msgs/msg/LaserScan", header=bag.header(3.5), angle_min=-1.0, angle_max=1.0,
                        angle_increment=0.1, time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=10.0,
                        ranges=np.full(21, 2.0, np.float32), intensities=np.zeros(0, np.float32))
        raw = bytes(bag.store.serialize_ros1(scan, scan.__msgtype__))
        text, _ = bag.store.generate_msgdef(scan.__msgtype__, ros_version=1)
    path = written(tmp_path / "a.mcap", {"/scan": ("ros1", "sensor_msgs/LaserScan", text.encode(), [raw])}, profile="ros1")
    _, seen = views(path)
    assert seen[0][0].stamp_s == 3.5 and seen[0][0].scan.ranges_m.tolist() == [2.0] * 21


def test_a_message_that_is_cut_and_a_schema_that_is_none_are_refused_in_one_line(tmp_path):
    whole = image(0, picture(), "rgb8")
    path = written(tmp_path / "a.mcap", {"/color": ("protobuf", "foxglove.RawImage", IMAGE, [whole[:-4000]])})
    with pytest.raises(ConfigError, match=r"a\.mcap: .*ValueError: Error parsing message") as caught:
        views(path, camera=[50.0, 50.0, 31.5, 23.5])
    assert "\n" not in str(caught.value)
    path = written(tmp_path / "b.mcap", {"/color": ("protobuf", "foxglove.RawImage", b"\x0a\xff", [whole])})
    with pytest.raises(ConfigError, match="found messages in protobuf; expected those of ROS"):
        views(path, camera=[50.0, 50.0, 31.5, 23.5])


def test_numbers_below_zero_packed_ones_and_unknown_fields_of_protobuf():
    read = reader_of(together(schema("M", ("a", 1, INT32, 0, ""), ("b", 2, 17, 1, ""), ("c", 3, DOUBLE, 1, ""),
                                     ("d", 4, TEXT, 0, ""), ("e", 5, MESSAGE, 0, "foxglove.N")), schema("N")), "foxglove.M")
    data = varint(8) + varint((1 << 64) - 5) + wired(2, varint(1) + varint(4)) + wired(3, 1.5) + wired(3, 2.5)
    assert read(data + wired(9, "new")) == {"a": -5, "b": [-1, 2], "c": [1.5, 2.5], "d": "", "e": None}
