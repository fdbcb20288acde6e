"""Folders of point clouds, their files, and what `sensor=lidar odometry=kiss_icp_lidar` makes of them."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from bags import BagFile

import rhs
from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, se2
from rhs.api.records import Capture, Observation, Tracking
from rhs.testing.room import FURNISHED, Room, cloud_of, context
from rhs_odometry.lidar.config import KissIcpLidar, VgicpLidar
from rhs_sensors.lidar import Lidar
from rhs_sources.folders.pcd import read_cloud, unpacked_lzf
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

POINTS = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.25], [np.nan, 0.0, 0.0]])
HEAD = ("# .PCD v0.7\nVERSION 0.7\nFIELDS x y z _ intensity\nSIZE 4 4 4 1 2\nTYPE F F F U U\nCOUNT 1 1 1 4 1\n"
        "WIDTH 3\nHEIGHT 1\nPOINTS 3\n")
ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("pad", "u1", 4), ("i", "<u2")])


def table():
    out = np.zeros(3, ROW)
    for k, axis in enumerate("xyz"):
        out[axis] = POINTS[:, k]
    return out


def literals(data):
    """LZF without any copy: runs of up to 32 bytes, each after its length less one."""
    return b"".join(bytes([len(data[k: k + 32]) - 1]) + data[k: k + 32] for k in range(0, len(data), 32))


def pcd(kind):
    head = f"{HEAD}DATA {kind}\n".encode()
    if kind == "ascii":
        return head + "".join(f"{x} {y} {z} 0 0 0 0 7\n" for x, y, z in POINTS).encode()
    if kind == "binary":
        return head + table().tobytes()
    columns = b"".join(np.ascontiguousarray(table()[name]).tobytes() for name in ROW.names)
    packed = literals(columns)
    return head + struct.pack("<II", len(packed), len(columns)) + packed


PLY = "ply\nformat {} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"


@pytest.mark.parametrize(("name", "data"), [
    *[("a.pcd", pcd(kind)) for kind in ("ascii", "binary", "binary_compressed")],
    ("a.bin", np.hstack([POINTS, np.ones((3, 1))]).astype("<f4").tobytes()),
    ("a.ply", (PLY.format("ascii") + "".join(f"{x} {y} {z}\n" for x, y, z in POINTS)).encode()),
    ("a.ply", PLY.format("binary_little_endian").encode() + POINTS.astype("<f4").tobytes()),
    ("a.ply", PLY.format("binary_big_endian").encode() + POINTS.astype(">f4").tobytes()),
])
def test_a_cloud_file_gives_its_finite_points(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    np.testing.assert_allclose(read_cloud(tmp_path / name)[0], POINTS[:2])
    (tmp_path / name).write_bytes(data[: len(data) - 13])  # cut
    with pytest.raises(ConfigError, match="bytes that are no") as error:
        read_cloud(tmp_path / name)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("unit", "moved_m", "refused"), [(1.0, 0.0, False), (1000.0, 0.0, True), (1.0, 350_000.0, True)])
def test_a_cloud_in_millimetres_or_in_a_countrys_coordinates_is_refused(tmp_path, unit, moved_m, refused):
    points = np.random.default_rng(0).uniform(-30.0, 30.0, (300, 3)) * unit + [moved_m, 0.0, 0.0]
    text = PLY.replace("vertex 3", "vertex 300").format("ascii") + "".join(f"{x} {y} {z}\n" for x, y, z in points)
    (tmp_path / "a.ply").write_text(text)
    if not refused:
        assert len(read_cloud(tmp_path / "a.ply")[0]) == 300
        return
    with pytest.raises(ConfigError, match="its points are typically .* away; expected metres from the scanner"):
        read_cloud(tmp_path / "a.ply")


@pytest.mark.parametrize("names", [
    ["cloud_1583836591_982590976", "cloud_1583836592_82590976", "cloud_1583836592_182590976"],  # Newer College
    ["1583836591-982590", "1583836592-082590", "1583836592-182590"]])
def test_names_in_seconds_and_their_fraction_are_one_time(tmp_path, names):
    """By the fraction alone the last cloud of a second came after all of the next."""
    for k, name in enumerate(names):
        (tmp_path / f"{name}.bin").write_bytes(np.tile([k + 1.0, 1.0, 1.0, 0.0], (20, 1)).astype("<f4").tobytes())
    recording = open_recording(Replay(path=str(tmp_path)))
    views = [(capture.stamp_s, capture.extras["cloud"][0, 0]) for capture, _ in recording.views]
    np.testing.assert_allclose(views, [(1583836591.98259, 1.0), (1583836592.08259, 2.0), (1583836592.18259, 3.0)], atol=2e-6)
    assert recording.timed


@pytest.mark.parametrize(("moved", "refused"), [(True, True), (False, False)])
def test_clouds_that_were_moved_into_one_world_are_refused(tmp_path, moved, refused):
    """VIEWPOINT tells where the scanner was; whether the points are round it or round 0 the points tell."""
    rng = np.random.default_rng(0)
    for k in range(3):
        points = rng.uniform(-8.0, 8.0, (300, 3)) + [10.0 * k * moved, 0.0, 0.0]
        head = ("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 300\nHEIGHT 1\n"
                f"VIEWPOINT {10 * k} 0 0 1 0 0 0\nPOINTS 300\nDATA binary\n")
        (tmp_path / f"{k:06d}.pcd").write_bytes(head.encode() + points.astype("<f4").tobytes())
    if refused:
        with pytest.raises(ConfigError, match="its points lie round its VIEWPOINT .* moved into one world"):
            open_recording(Replay(path=str(tmp_path)))
    else:
        assert len(list(open_recording(Replay(path=str(tmp_path))).views)) == 3


def test_lzf_copies_from_behind_and_over_itself():
    """`abc`, then seven bytes from three behind: abcabca; and a long one of 9 + 2 bytes from one behind."""
    assert unpacked_lzf(b"\x02abc" + bytes([5 << 5, 2]), 10) == b"abcabcabca"
    assert unpacked_lzf(b"\x00a" + bytes([7 << 5, 2, 0]), 12) == b"a" * 12
    for broken, size in ((b"\x02abc" + bytes([5 << 5, 3]), 10), (b"\x02abc", 4), (bytes([7 << 5]), 3)):
        with pytest.raises((ValueError, IndexError)):
            unpacked_lzf(broken, size)


@pytest.mark.parametrize("data", [HEAD.encode(),
                                  HEAD.replace("POINTS 3", "POINTS 999999999").encode() + b"DATA ascii\n1 2 3\n",
                                  HEAD.replace("x y z", "a b c").encode() + b"DATA ascii\n" + b"1 " * 24, b"\x00" * 50])
def test_a_broken_cloud_is_refused_in_one_line(tmp_path, data):
    (tmp_path / "0.pcd").write_bytes(data)
    with pytest.raises(ConfigError, match="0.pcd: found .* bytes that are no pcd cloud") as error:
        Replay(path=str(tmp_path)).build(None)
    assert "\n" not in str(error.value)


def clouds(folder, poses, room=FURNISHED):
    """KITTI's .bin files of a lidar 1 m above the body, and poses.txt."""
    (folder / "velodyne").mkdir(parents=True)
    lines = []
    for k, pose in enumerate(poses):
        cloud = cloud_of(pose, room, k)
        np.hstack([cloud, np.ones((len(cloud), 1))]).astype("<f4").tofile(folder / "velodyne" / f"{k:06d}.bin")
        lines.append(" ".join(f"{v:.9g}" for v in pose[:3].ravel()))
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    return folder


def way(count):
    """A tenth of a metre and 2 degrees to the left a view."""
    poses = [se2(-1.5, -0.5, 0.2)]
    for _ in range(count - 1):
        poses.append(poses[-1] @ se2(0.1, 0.0, 0.035))
    return poses


def test_a_run_over_a_folder_of_clouds_gives_a_way_and_a_map(tmp_path):
    folder = clouds(tmp_path / "drive", way(20))
    row = rhs.run(["task=survey", "source=replay", f"source.path={folder}", "sensor=lidar", "source.extent_m=10",
                   f"output={tmp_path / 'run'}"], quiet=True)
    assert row["status"] == "ok" and row["views"] == 20 and row["scale_from"] == "range"
    assert row["ate_rmse_m"] < 0.05 and row["tracked_share"] == 1.0
    source = Replay(path=str(folder), rate_hz=5.0, scan_mount=[0, 0, 1, 0, 0, 0]).build(None)
    first, second = source.lead(), source.lead()
    source.close()
    assert source.provides == {"cloud"} and second.stamp_s == 0.2
    assert first.extras["cloud"][:, 2].max() == pytest.approx(cloud_of(way(1)[0], FURNISHED, 0)[:, 2].max() + 1.0, abs=1e-5)


BOTH = pytest.mark.parametrize("kind", [VgicpLidar, KissIcpLidar])


def follow(kind, room, poses):
    odometry = kind().build(None)
    return [odometry.update(Observation(k, 0.1 * k, None, extras={"cloud": cloud_of(pose, room, k)}))
            for k, pose in enumerate(poses)]


@BOTH
def test_it_says_how_far_it_went_and_how_sure_it_is(kind):
    poses = way(12)
    motions = follow(kind, FURNISHED, poses)
    for before, pose, motion in zip(poses[:-1], poses[1:], motions[1:], strict=True):
        assert motion.status is Tracking.OK
        off = inverse(inverse(before) @ pose) @ motion.previous_from_body
        assert np.linalg.norm(off[:3, 3]) < 0.05
        assert np.linalg.norm(off[:2, 3]) < 4.0 * np.sqrt(np.trace(motion.covariance[:2, :2]))


@BOTH
def test_along_a_tunnel_without_end_it_is_degenerate_along_it_and_empty_clouds_are_lost(kind):
    tunnel = Room("tunnel", (-900.0, -1.5, 0.0), (900.0, 1.5, 2.5), (0.0, 0.0, 0.0))
    motion = follow(kind, tunnel, [se2(0.0, 0, 0), se2(0.1, 0, 0)])[1]
    assert motion.status is Tracking.DEGENERATE and motion.covariance[0, 0] > 0.9 > 0.1 > motion.covariance[1, 1]
    odometry = kind().build(None)
    none = Observation(0, 0.0, None, extras={"cloud": np.empty((0, 3), np.float32)})
    assert odometry.update(none).status is Tracking.LOST


STREET = Room("street", (-60.0, -9.0, 0.0), (60.0, 9.0, 40.0), (0.0, 0.0, 0.0), boxes=tuple(
    ((x + 3.0 * side, 7.0 * side - 0.5, 0.0), (x + 3.0 * side + 3.0, 7.0 * side + 0.5, 1.5))
    for side in (-1.0, 1.0) for x in np.arange(-56.0, 56.0, 11.0)))


@pytest.mark.parametrize("step_m", [0.5, 1.0])
def test_a_car_that_drives_as_the_log_begins_is_not_held_by_the_rings_on_the_ground(step_m):
    """Between boxes 11 m apart; `kiss_icp_lidar` believes to stand."""
    motions = follow(VgicpLidar, STREET, [se2(-20.0 + step_m * k, 1.0, 0.0) for k in range(6)])
    assert [motion.previous_from_body[0, 3] for motion in motions[1:]] == pytest.approx([step_m] * 5, abs=0.06)


def test_a_cloud_that_was_not_believed_leaves_no_trace():
    """Of a cloud from elsewhere the motion before is taken, and the next one fits again."""
    odometry, poses = VgicpLidar(max_range_m=50.0).build(None), [se2(0.1 * k, -0.5, 0.0) for k in range(6)]
    for k, pose in enumerate(poses):
        cloud = cloud_of(pose, FURNISHED, k) if k != 3 else np.full((500, 3), 40.0) + np.arange(500)[:, None] * 1e-3
        motion = odometry.update(Observation(k, 0.1 * k, None, extras={"cloud": cloud}))
        assert (motion.status is Tracking.OK) == (k != 3)
    assert motion.previous_from_body[0, 3] == pytest.approx(0.1, abs=0.04)


def test_the_scan_of_a_lidar_is_the_nearest_point_of_its_band_on_each_bearing(tmp_path):
    points = np.array([[2, 0.01, 0.5], [1, 0.01, 3], [3, 0.01, 0.5], [-1, -0.01, 0.2], [0.1, 0, 0.5]], np.float32)
    sensor = Lidar(beams=8).build(context(tmp_path))
    scan = sensor.sense(Capture(0, 0.0, sensed=True, extras={"cloud": points})).scan
    known = np.isfinite(scan.ranges_m)
    np.testing.assert_allclose(scan.bearings_rad[known], [-np.pi * 7 / 8, np.pi / 8])
    np.testing.assert_allclose(scan.ranges_m[known], [1.0, 2.0], atol=1e-3)  # too high, too far, too near are left out


def test_a_lidar_without_clouds_is_refused_with_what_to_type(tmp_path):
    folder = clouds(tmp_path / "drive", way(2))
    with pytest.raises(rhs.RhsError, match="sensor=rgbd needs .*, which source=replay does not provide.*; type .*lidar"):
        rhs.run(["task=survey", "source=replay", f"source.path={folder}", "sensor=rgbd", f"output={tmp_path / 'run'}"])


def test_a_bag_with_clouds_alone_is_a_lidars_and_its_mount_comes_from_tf(tmp_path):
    """The lidar sits 0.3 m ahead of base_link and is turned by 90 degrees: its x is the body's y."""
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.transform("/tf_static", 0.0, "base_link", "camera", 0.3, yaw=np.pi / 2)
        for k in range(3):
            bag.cloud("/points", 0.1 * k, np.array([[2.0 + k, 0.0, 1.0], [np.nan, 0.0, 0.0]]))
            bag.odometry("/odom", 0.1 * k + 0.01, 0.0, 0.0, 0.0)
    source = Replay(path=str(bag.path)).build(None)
    seen = [source.lead() for _ in range(3)]
    source.close()
    assert source.provides == {"cloud", "wheel"} and source.views_expected == 3
    np.testing.assert_allclose(seen[2].extras["cloud"], [[0.3, 4.0, 1.0]], atol=1e-6)
