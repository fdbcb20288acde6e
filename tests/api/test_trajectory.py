"""Trajectories: files, association, alignment."""

import numpy as np
import pytest

from rhs.api.errors import RecordingError
from rhs.api.geometry import exp_se3, rotation_z, se2, se3
from rhs.api.trajectory import Trajectory, aligned, associate, in_tum_order, read_tum, write_tum


def wander(count: int, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    poses = [np.eye(4)]
    for _ in range(count - 1):
        poses.append(poses[-1] @ exp_se3(rng.normal(0, 0.1, 6)))
    return Trajectory(np.arange(count) * 0.1, np.array(poses))


def test_a_trajectory_reads_back_within_a_nanometre(tmp_path):
    written = wander(50)
    write_tum(tmp_path / "a.tum", written)
    read = read_tum(tmp_path / "a.tum")
    np.testing.assert_allclose(read.stamps_s, written.stamps_s, atol=1e-9)
    np.testing.assert_allclose(read.poses, written.poses, atol=4e-9)


def test_w_comes_last(tmp_path):
    write_tum(tmp_path / "a.tum", Trajectory(np.array([1.5]), se2(1, 2, np.pi)[None]))
    words = (tmp_path / "a.tum").read_text().splitlines()[1].split()
    assert words[0] == "1.500000000"
    np.testing.assert_allclose([float(w) for w in words[1:]], [1, 2, 0, 0, 0, 1, 0], atol=1e-9)


@pytest.mark.parametrize("line", ["1 2 3", "1 0 0 0 0 0 0 nan", "1 0 0 0 0 0 0 0", "a b c d e f g h"])
def test_a_bad_line_is_named_with_its_number(tmp_path, line):
    (tmp_path / "a.tum").write_text("# header\n0 0 0 0 0 0 0 1\n" + line + "\n")
    with pytest.raises(RecordingError, match="a.tum:3"):
        read_tum(tmp_path / "a.tum")


def test_a_picture_is_not_a_trajectory(tmp_path):
    (tmp_path / "a.tum").write_bytes(b"\x89PNG\r\n\xff\xfe")
    with pytest.raises(RecordingError, match="not text"):
        read_tum(tmp_path / "a.tum")


def test_association_is_one_to_one_nearest_first_and_within_the_tolerance():
    # 0.00 is nearest to 0.01; 0.02 would also like 0.01, but it is taken, and 0.05 is too far
    pairs = associate(np.array([0.0, 0.02, 1.0]), np.array([0.009, 0.05, 1.019, 5.0]), 0.02)
    assert pairs.tolist() == [[0, 0], [2, 2]]


def test_association_survives_dropped_frames():
    rng = np.random.default_rng(1)
    a = np.arange(50) / 30.0
    b = np.delete(a + rng.uniform(-0.01, 0.01, 50), [3, 17, 18])
    pairs = associate(a, b, 0.02)
    assert len(pairs) == 47 and not {3, 17, 18} & set(pairs[:, 0].tolist())


@pytest.mark.parametrize(("how", "move", "scale"), [
    ("se3", exp_se3(np.array([1.0, -2.0, 0.5, 0.3, -0.2, 1.0])), 1.0),
    ("sim3", exp_se3(np.array([1.0, -2.0, 0.5, 0.3, -0.2, 1.0])), 0.37),
    ("yaw", se3(rotation_z(2.0), np.array([3.0, 1.0, -4.0])), 1.0),
    ("origin", exp_se3(np.array([1.0, -2.0, 0.5, 0.3, -0.2, 1.0])), 1.0),
])
def test_alignment_undoes_the_motion_it_allows(how, move, scale):
    truth = wander(40)
    poses = truth.poses.copy()
    poses[:, :3, 3] *= scale
    moved = Trajectory(truth.stamps_s, move @ poses)
    np.testing.assert_allclose(aligned(moved, truth, how).positions_m, truth.positions_m, atol=1e-9)


def test_yaw_alignment_does_not_repair_a_tilt():
    truth = wander(40)
    tilted = Trajectory(truth.stamps_s, exp_se3(np.array([0, 0, 0, 0.3, 0, 0])) @ truth.poses)
    assert np.abs(aligned(tilted, truth, "yaw").positions_m - truth.positions_m).max() > 0.01


@pytest.mark.parametrize("header, row", [
    ("timestamp,x,y,z,qx,qy,qz,qw", "1600000000.5,1,2,3,0,0,0.6,0.8"),
    ("time;x;y;z;qx;qy;qz;qw", "1600000000.5;1;2;3;0;0;0.6;0.8"),
    ("#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],v_RS_R_x [m s^-1],"
     "v_RS_R_y [m s^-1],v_RS_R_z [m s^-1]", "1600000000500000000,1,2,3,0.8,0,0,0.6,9,9,9"),
    ('"seq","stamp","pose.position.x","pose.position.y","pose.position.z","pose.orientation.w","pose.orientation.x",'
     '"pose.orientation.y","pose.orientation.z"', "7,1600000000.5,1,2,3,0.8,0,0,0.6"),
    ("# qx qy qz qw tx ty tz t", "0 0 0.6 0.8 1 2 3 1600000000.5"),
])
def test_a_header_says_which_column_is_which(tmp_path, header, row):
    (tmp_path / "way.csv").write_text(f"{header}\n{row}\n", "utf-8")
    way = read_tum(tmp_path / "way.csv")
    assert way.stamps_s.tolist() == [1600000000.5] and way.positions_m.tolist() == [[1, 2, 3]]
    np.testing.assert_allclose(way.poses[0, :2, :2], [[0.28, -0.96], [0.96, 0.28]], atol=1e-12)


@pytest.mark.parametrize("text", [
    "2020-09-13T12:26:40.5Z 1 2 3 0 0 0.6 0.8", "time,x,y,z,qx,qy,qz,qw\n2020-09-13 14:26:40.500+02:00,1,2,3,0,0,0.6,0.8",
    "datetime;x;y;z;qx;qy;qz;qw\n2020-09-13 12:26:40,5;1;2;3;0;0;0,6;0,8",
])
def test_times_of_iso_8601_are_unix_seconds_in_utc_where_no_zone_is_named(tmp_path, text):
    """`date -u -d @1600000000` prints Sun Sep 13 12:26:40 UTC 2020."""
    (tmp_path / "way.csv").write_text(text + "\n", "utf-8")
    way = read_tum(tmp_path / "way.csv")
    assert way.stamps_s.tolist() == [1600000000.5] and way.positions_m.tolist() == [[1, 2, 3]]
    np.testing.assert_allclose(way.poses[0, :2, :2], [[0.28, -0.96], [0.96, 0.28]], atol=1e-12)


@pytest.mark.parametrize(("name", "stamp", "seconds"), [
    ("time_ms", "1500", 1.5), ("t [ms]", "1500.25", 1.50025), ("timestamp_us", "1500", 0.0015), ("time [s]", "1500", 1500.0),
    ("#timestamp [ns]", "1500", 1.5e-6), ("#timestamp [ns]", "1600000000.5", 1600000000.5), ("time", "1500", 1500.0),
])
def test_the_name_of_a_column_says_the_unit_of_its_stamps(tmp_path, name, stamp, seconds):
    """Times since a program's start were seconds: a thousand times too long. Under EuRoC's header some write seconds."""
    (tmp_path / "way.csv").write_text(f"{name},x,y,z,qx,qy,qz,qw\n{stamp},1,2,3,0,0,0,1\n", "utf-8")
    assert read_tum(tmp_path / "way.csv").stamps_s.tolist() == [seconds]
    (tmp_path / "way.csv").write_text(f"{name},x,y,yaw_rad\n{stamp},1,2,0.1\n", "utf-8")
    assert read_tum(tmp_path / "way.csv").stamps_s.tolist() == [seconds]


def test_a_time_that_never_was_is_refused(tmp_path):
    (tmp_path / "way.csv").write_text("2020-13-01T12:00:00 1 2 3 0 0 0 1\n", "utf-8")
    with pytest.raises(RecordingError, match="'2020-13-01T12:00:00'.*expected one of ISO 8601"):
        read_tum(tmp_path / "way.csv")


def test_a_comment_that_is_no_header_and_a_table_without_one_stay_as_they_are():
    for text in ("# ground truth of 2020-09-13 12:26:40\n# timestamp tx ty tz\n1 2 3 4 0 0 0 1\n", "1 2 3 4 0 0 0 1\n"):
        assert in_tum_order(text) is text
