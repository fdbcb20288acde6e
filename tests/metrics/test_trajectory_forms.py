"""Trajectories of KITTI and EuRoC beside TUM: the same way in three forms is the same way; broken ones are refused."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import BODY_FROM_OPTICAL, inverse, quaternion_xyzw, se2, se3
from rhs.api.trajectory import Trajectory, in_tum_order, read_tum, write_tum
from rhs.base.commands import LONGEST
from rhs.base.errors import ConfigError, RecordingError
from rhs.metrics.evaluate import evaluate_pair, folder_fault, pair_fault
from rhs.metrics.trajectory_forms import read_trajectory

WAY = Trajectory(np.arange(6.0), np.array([se2(0.5 * k, 0.1 * k * k, 0.1 * k) for k in range(6)]))


def kitti(way):
    return "".join(" ".join(f"{v:.9e}" for v in pose[:3].ravel()) + "\n" for pose in way.poses)


def euroc(way):
    lines = ["#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],v_x\n"]
    for stamp, pose in zip(way.stamps_s, way.poses, strict=True):
        x, y, z, w = quaternion_xyzw(pose[:3, :3])
        values = ",".join(f"{v:.9f}" for v in (*pose[:3, 3], w, x, y, z, 0.0))
        lines.append(f"{int(stamp * 1e9)},{values}\n")
    return "".join(lines)


@pytest.mark.parametrize("form", [kitti, euroc])
def test_the_same_way_in_another_form_is_the_same_way(tmp_path, form):
    (tmp_path / "truth.txt").write_text(form(WAY))
    write_tum(tmp_path / "way.tum", WAY)
    read = read_trajectory(tmp_path / "truth.txt")
    assert np.allclose(read.poses, WAY.poses, atol=1e-7) and np.allclose(read.stamps_s, WAY.stamps_s)
    assert evaluate_pair(tmp_path / "way.tum", tmp_path / "truth.txt")["ate_rmse_m"] < 1e-6


def test_kitti_takes_the_times_beside_it(tmp_path):
    (tmp_path / "00.txt").write_text(kitti(WAY))
    (tmp_path / "times.txt").write_text("".join(f"{0.1 * k:.6e}\n" for k in range(6)))
    assert np.allclose(read_trajectory(tmp_path / "00.txt").stamps_s, 0.1 * np.arange(6))
    (tmp_path / "times.txt").write_text("0.0\n0.1\n")
    with pytest.raises(RecordingError, match="2 stamps for 6 poses"):
        read_trajectory(tmp_path / "00.txt")


@pytest.mark.parametrize(("text", "said"), [
    ("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0\n", "txt:2: .* expected 12 finite numbers"),
    ("2 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation"), ("100,1,2,3,1,0,0,0\n200,1,2,nan,1,0,0,0\n", "txt:2"),
    ("100,1,2,3,0,0,0,0\n", "txt:1"), ("1 2 3\n", "8 finite numbers"),
    ("1.5 2 3 4\n", "of places alone write 0 0 0 1 behind"),
    ("GPSTime,easting,northing,altitude,e,n,u,roll,pitch,heading,z,y,x\n1,2,3,4,5,6,7,8,9,0,1,2,3\n", ":1: found 'GPS"),
])
def test_broken_lines_are_refused_in_one_line(tmp_path, text, said):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(RecordingError, match=said) as caught:
        read_trajectory(tmp_path / "a.txt")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("stamp", ["1403636579763555584.000000", "1.403636579763555584e+18", "1403636579763555.584",
                                   "1403636579763.555584", "1403636579.763555584"])
def test_unix_times_are_seconds_in_whatever_unit_they_were_written(tmp_path, stamp):
    """ORB-SLAM3's trajectories of EuRoC are in ns with six zeros behind the point."""
    (tmp_path / "a.txt").write_text(f"{stamp} 0 0 0 0 0 0 1\n")
    assert read_tum(tmp_path / "a.txt").stamps_s[0] == pytest.approx(1403636579.763555584, abs=1e-6)


def mulran(way):
    lines = zip(way.stamps_s, kitti(way).splitlines(), strict=True)
    return "".join(f"{int(1e9 * (1.6e9 + stamp))},{line.replace(' ', ',')}\n" for stamp, line in lines)


def tum(way, *, w_first=False, ahead=""):
    quaternions = [quaternion_xyzw(pose[:3, :3])[[3, 0, 1, 2] if w_first else [0, 1, 2, 3]] for pose in way.poses]
    return ahead + "".join(" ".join(f"{v:.9f}" for v in (stamp, *pose[:3, 3], *q)) + "\n" for stamp, pose, q in
                           zip(way.stamps_s, way.poses, quaternions, strict=True))


def rows(way):
    """(stamp in ns, numbers of the pose as TUM has them) of each pose."""
    for line in tum(way).splitlines():
        stamp, *pose = line.split()
        yield int(1e9 * (1.6e9 + float(stamp))), pose


def newer_college(way):
    """Also of fractions that begin with zeros."""
    lines = "".join(f"{ns // 10**9},{ns % 10**9},{','.join(pose)}\n" for ns, pose in rows(way))
    return "#sec,nsec,x,y,z,qx,qy,qz,qw\n" + lines


def four_seasons(way):
    return ("# frame_id, translation_x, translation_y, translation_z, rotation_x, rotation_y, rotation_z, rotation_w, "
            "scale, fusion_quality, v3\n" + "".join(f"{ns},{','.join(pose)},1.0,1,0\n" for ns, pose in rows(way)))


def nclt(way):
    """Its first line before anything was known."""
    turns = [float(np.arctan2(pose[1, 0], pose[0, 0])) for pose in way.poses]
    lines = "".join(f"{ns // 1000}, {', '.join(pose[:3])}, 0.0, 0.0, {yaw}\n"
                    for (ns, pose), yaw in zip(rows(way), turns, strict=True))
    return "1599999999000000, nan, nan, nan, nan, nan, nan\n" + lines


def rostopic(way):
    """rostopic echo -b BAG -p /odom, of twelve columns."""
    head = ("%time,field.header.seq,field.header.stamp,field.header.frame_id,field.child_frame_id,"
            + ",".join(f"field.pose.pose.position.{a}" for a in "xyz") + ","
            + ",".join(f"field.pose.pose.orientation.{a}" for a in "xyzw"))
    lines = (f"{ns},{k},{ns},odom,base_link,{','.join(pose)}\n" for k, (ns, pose) in enumerate(rows(way)))
    return head + "\n" + "".join(lines)


@pytest.mark.parametrize(("form", "begins_s"), [
    (lambda way: "".join(line + " 0 0 0 1\n" for line in kitti(way).splitlines()), 0.0),  # Replica's traj.txt
    (mulran, 1.6e9),
    (lambda way: "".join(line.split(" ", 1)[1] + "\n" for line in tum(way).splitlines()), 0.0),  # TartanAir's pose_left.txt
    (lambda way: "".join(f"VERTEX_SE3:QUAT {k} {line.split(' ', 1)[1]}\n" for k, line in enumerate(tum(way).splitlines())) +
     "EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1\n", 0.0),
    (lambda way: "".join(f"VERTEX2 {k} {p[0, 3]} {p[1, 3]} {np.arctan2(p[1, 0], p[0, 0])}\n"
                         for k, p in enumerate(way.poses)), 0.0),
    (lambda way: "".join(f"VERTEX3 {k} {p[0, 3]} {p[1, 3]} 0 0 0 {np.arctan2(p[1, 0], p[0, 0])}\n"
                         for k, p in enumerate(way.poses)), 0.0),
    (lambda way: tum(way).replace(" ", ";"), 0.0),
    (lambda way: "\ufeff" + tum(way), 0.0),
    (lambda way: tum(way, w_first=True, ahead="#Time px py pz qw qx qy qz\n"), 0.0),
    (newer_college, 1.6e9), (four_seasons, 1.6e9), (nclt, 1.6e9), (rostopic, 1.6e9),
])
def test_other_forms_of_the_same_way(tmp_path, form, begins_s):
    (tmp_path / "truth.txt").write_text(form(WAY))
    read = read_trajectory(tmp_path / "truth.txt")
    assert np.allclose(read.poses, WAY.poses, atol=1e-6) and np.allclose(read.stamps_s, begins_s + WAY.stamps_s, atol=1e-3)


def test_a_matrix_behind_a_stamp_is_not_taken_for_a_quaternion():
    line = mulran(WAY).splitlines()[1]
    assert in_tum_order(line) == line


def test_a_quaternion_that_is_none_is_refused(tmp_path):
    (tmp_path / "angles.txt").write_text("1.0 0 0 0 0.1 0.2 1.5 0\n")  # roll, pitch and yaw
    with pytest.raises(RecordingError, match="angles.txt:1: quaternion .* is 1.52 long; expected a unit quaternion"):
        read_trajectory(tmp_path / "angles.txt")


def test_stamps_beside_numbers_of_lines_are_refused(tmp_path):
    (tmp_path / "00.txt").write_text(kitti(WAY))
    write_tum(tmp_path / "way.tum", Trajectory(WAY.stamps_s + 1.6e9, WAY.poses))
    with pytest.raises(ConfigError, match="00.txt: its lines have no stamps .*; write times.txt beside it"):
        evaluate_pair(tmp_path / "way.tum", tmp_path / "00.txt")


def turning_way(count=200):
    """A body that goes along a curve in space and looks where it goes, nodding."""
    from scipy.spatial.transform import Rotation

    time_s = 0.1 * np.arange(count)
    place = np.stack([2.0 * np.cos(0.3 * time_s), 1.5 * np.sin(0.4 * time_s), 0.3 * np.sin(0.7 * time_s)], axis=1)
    ahead = np.gradient(place, axis=0)
    angles = np.stack([np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])), 0.1 * np.sin(time_s), 0.1 * np.cos(1.3 * time_s)], 1)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = Rotation.from_euler("ZYX", angles).as_matrix(), place
    return Trajectory(time_s, poses)


def test_poses_that_are_read_another_way_than_they_were_meant_are_said(tmp_path):
    way = turning_way()
    write_tum(tmp_path / "truth.tum", way)
    camera = Trajectory(way.stamps_s, way.poses @ se3(BODY_FROM_OPTICAL, np.zeros(3)))
    texts = {"right": tum(way), "w_first": tum(way, w_first=True), "camera": tum(camera),
             "round": tum(Trajectory(way.stamps_s, inverse(way.poses)))}
    said = {}
    for name, text in texts.items():
        (tmp_path / f"{name}.tum").write_text(text)
        said[name] = pair_fault(tmp_path / f"{name}.tum", tmp_path / "truth.tum")
    (tmp_path / "euroc.txt").write_text("".join(",".join([str(ns), *pose]) + "\n" for ns, pose in rows(way)))
    write_tum(tmp_path / "later.tum", Trajectory(1.6e9 + way.stamps_s, way.poses))
    assert "of EuRoC's form: last" in pair_fault(tmp_path / "euroc.txt", tmp_path / "later.tum")
    assert said["right"] == "" and "qw first" in said["w_first"] and "Tcw" in said["round"]
    assert max(map(len, said.values())) <= LONGEST  # a line is not cut before what to type
    assert "turned by 120 degrees" in said["camera"]
    unlike = Trajectory(way.stamps_s, way.poses[::-1])
    (tmp_path / "unlike.tum").write_text(tum(unlike))  # of another way nothing is said
    assert pair_fault(tmp_path / "unlike.tum", tmp_path / "truth.tum") == ""


def test_turned_axes_are_told_by_a_few_poses(tmp_path):
    way = turning_way(12)
    write_tum(tmp_path / "a.tum", way)
    write_tum(tmp_path / "b.tum", Trajectory(way.stamps_s, way.poses @ se3(BODY_FROM_OPTICAL, np.zeros(3))))
    assert "are of axes turned by 120 degrees" in pair_fault(tmp_path / "a.tum", tmp_path / "b.tum")
    assert pair_fault(tmp_path / "a.tum", tmp_path / "a.tum") == ""


def test_axes_that_look_along_the_same_way_and_have_their_z_down_are_said(tmp_path):
    """A car's inertial unit a metre beside its lidar: ways from view to view hardly tell, the turns do (KITTI-360)."""
    time_s = 0.1 * np.arange(60)
    way = Trajectory(time_s, np.array([se2(4 * np.sin(t / 4), 4 - 4 * np.cos(t / 4), t / 4) for t in time_s]))
    write_tum(tmp_path / "way.tum", way)
    unit = se3(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 1.0, 0.0]))
    write_tum(tmp_path / "truth.tum", Trajectory(time_s, way.poses @ unit))
    assert "turned by 180 degrees" in pair_fault(tmp_path / "way.tum", tmp_path / "truth.tum")


@pytest.mark.parametrize("text", [
    "__time,/odom/header/stamp,/odom/pose/pose/position/x,/odom/pose/pose/position/y,/odom/pose/pose/position/z,"
    "/odom/pose/pose/orientation/x,/odom/pose/pose/orientation/y,/odom/pose/pose/orientation/z,"
    "/odom/pose/pose/orientation/w,/odom/pose/pose/orientation/yaw\n1700000000.25,0,1,2,3,0,0,0.6,0.8,73.7\n",
    "1700000000,250000000,odom,base_link,1,2,3,0,0,0.6,0.8,0.1,0.1\n",
    "1700000000,250000000,map,1,2,3,0,0,0.6,0.8\n",
])
def test_poses_as_plotjuggler_and_ros2_topic_echo_export_them(tmp_path, text):
    (tmp_path / "poses.csv").write_text(text)
    way = read_trajectory(tmp_path / "poses.csv")
    assert way.stamps_s.tolist() == [1700000000.25] and way.positions_m.tolist() == [[1.0, 2.0, 3.0]]
    assert way.poses[0, :2, 0] == pytest.approx([0.28, 0.96])


def colmap(way, names):
    """images.txt: the world in the camera, w first, in any order, a line of points behind each."""
    out = ["# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"]
    for k in reversed(range(len(way))):
        pose = inverse(way.poses[k])
        x, y, z, w = quaternion_xyzw(pose[:3, :3])
        numbers = " ".join(f"{v:.9f}" for v in (w, x, y, z, *pose[:3, 3]))
        out.append(f"{k + 1} {numbers} 1 {names[k]}\n2362.39 248.49 58396 1784.7 268.25 -1\n")
    return "".join(out)


@pytest.mark.parametrize(("names", "stamps"), [
    ([f"rgb/{1700000000 + 0.1 * k:.6f}.png" for k in range(6)], 1700000000 + 0.1 * np.arange(6)),
    ([f"frame_{k:05d}.jpg" for k in range(6)], np.arange(6.0)),
])
def test_images_of_colmap_are_poses_of_the_camera_at_the_numbers_in_their_names(tmp_path, names, stamps):
    (tmp_path / "images.txt").write_text(colmap(WAY, names))
    read = read_trajectory(tmp_path / "images.txt")
    np.testing.assert_allclose(read.poses, WAY.poses, atol=1e-6)
    np.testing.assert_allclose(read.stamps_s, stamps, atol=1e-5)


def test_a_truth_in_another_frame_than_the_map_is_said_to_be(tmp_path):
    """A robot that found itself was called wrong and sure in 99 % of the views."""
    way = turning_way()
    flat = Trajectory(way.stamps_s, np.array([se2(*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])) for pose in way.poses]))
    write_tum(tmp_path / "localised.tum", flat)
    moved_by = "moved by (-1.50, 2.00) m and turned by -17 degrees"
    for name, moved, said in (("other", se2(1.5, -2.0, 0.3) @ flat.poses, moved_by), ("same", flat.poses, ""),
                              ("lost", flat.poses[::-1], "")):
        write_tum(tmp_path / "truth_localised.tum", Trajectory(flat.stamps_s, moved))
        assert said in folder_fault(tmp_path) and bool(folder_fault(tmp_path)) == bool(said), name


def test_images_of_colmap_without_numbers_are_refused(tmp_path):
    (tmp_path / "images.txt").write_text(colmap(WAY, ["front.jpg"] * 6))
    with pytest.raises(RecordingError, match="no image of COLMAP with a number in its name"):
        read_trajectory(tmp_path / "images.txt")


def test_a_trajectory_log_of_open3d_is_five_lines_a_pose(tmp_path):
    rows = ("\n".join(" ".join(f"{v:.9f}" for v in row) for row in pose) for pose in WAY.poses)
    (tmp_path / "trajectory.log").write_text("".join(f"{k} {k} {k + 1}\n{one}\n" for k, one in enumerate(rows)))
    np.testing.assert_allclose(read_trajectory(tmp_path / "trajectory.log").poses, WAY.poses, atol=1e-6)


@pytest.mark.parametrize(("header", "unit"), [
    ("timestamp,x,y,yaw", 1.0), ("time;x;y;theta [rad]", 1.0), ("# t x y heading_deg", np.pi / 180),
    ("Time (s),pose.x,pose.y,pose.yaw (deg)", np.pi / 180),
])
def test_a_table_of_places_and_headings_is_a_way_on_the_floor(tmp_path, header, unit):
    comma = ";" if ";" in header else "," if "," in header else " "
    lines = [comma.join(f"{v:.9f}" for v in (k, 0.5 * k, 0.1 * k * k, 0.1 * k / unit)) for k in range(6)]
    (tmp_path / "way.csv").write_text("\n".join([header, *lines]))
    np.testing.assert_allclose(read_trajectory(tmp_path / "way.csv").poses, WAY.poses, atol=1e-6)


def test_a_heading_of_more_than_a_turn_whose_unit_nobody_says_is_refused(tmp_path):
    (tmp_path / "way.csv").write_text("time,x,y,yaw\n0,0,0,0\n1,1,0,90.0\n")
    with pytest.raises(RecordingError, match=r"\w:3: the heading 90\.0 is more than a turn.*yaw_deg or yaw_rad"):
        read_trajectory(tmp_path / "way.csv")


@pytest.mark.parametrize(("header", "unit"), [("timestamp,x,y,z,roll,pitch,yaw", 1.0),
                                              ("t;pos.x;pos.y;pos.z;roll_deg;pitch_deg;yaw_deg", np.pi / 180)])
def test_a_table_of_places_and_three_angles_turns_about_fixed_axes_roll_first(tmp_path, header, unit):
    """Rolled by a quarter of a turn and then turned left by one: the robot's left points up, its top along x."""
    comma = ";" if ";" in header else ","
    row = comma.join(f"{v:.9f}" for v in (1.0, 2.0, 3.0, 4.0, 0.5 * np.pi / unit, 0.0, 0.5 * np.pi / unit))
    (tmp_path / "way.csv").write_text(f"{header}\n{row}\n")
    way = read_trajectory(tmp_path / "way.csv")
    np.testing.assert_allclose(way.poses[0], [[0, 0, 1, 2], [1, 0, 0, 3], [0, 1, 0, 4], [0, 0, 0, 1]], atol=1e-6)


@pytest.mark.parametrize(("header", "lost"), [("", " nan nan nan nan nan nan nan"), ("t,x,y,z,qx,qy,qz,qw\n", ",,,,,,,")])
def test_a_moment_without_a_pose_is_left_out_and_said(tmp_path, header, lost, caplog):
    rows = tum(WAY).splitlines()
    rows[3] = f"3{lost}"
    (tmp_path / "way.txt").write_text(header + "\n".join(row if lost in row else row.replace(" ", "," if header else " ")
                                                        for row in rows))
    assert read_trajectory(tmp_path / "way.txt").stamps_s.tolist() == [0, 1, 2, 4, 5]
    assert f"way.txt:{4 + bool(header)}: found a stamp and no pose, as in 1 line in all" in caplog.text
    assert "83.3 % of the moments have one" in caplog.text


def test_commas_beside_semicolons_are_those_of_decimals(tmp_path):
    (tmp_path / "way.csv").write_text("time;x;y;z;qx;qy;qz;qw\n" + tum(WAY).replace(" ", ";").replace(".", ","))
    np.testing.assert_allclose(read_trajectory(tmp_path / "way.csv").poses, WAY.poses, atol=1e-6)


@pytest.mark.parametrize(("times", "said"), [(1000.0, "1000 times as large as the other: in millimetres?"), (1.0, ""),
                                             (0.01, "the estimate is 100 times as large as the other: in centimetres?"),
                                             (7.0, "")])
def test_a_truth_in_another_unit_is_said_to_be_in_it(tmp_path, times, said):
    """An ATE of 2407 m was printed without a word."""
    scaled = WAY.poses.copy()
    scaled[:, :3, 3] *= times
    (tmp_path / "way.tum").write_text(tum(WAY))
    (tmp_path / "truth.tum").write_text(tum(Trajectory(WAY.stamps_s, scaled)))
    fault = pair_fault(tmp_path / "way.tum", tmp_path / "truth.tum")
    assert said in fault and bool(fault) == bool(said)
