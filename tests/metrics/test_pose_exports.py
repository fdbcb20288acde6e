"""Poses that other programs export: read as what they mean there, or refused in one line that says what to type."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rhs.api.geometry import exp_so3, inverse, quaternion_xyzw, se3
from rhs.api.trajectory import Trajectory, write_tum
from rhs.base.commands import LONGEST, shortened
from rhs.base.errors import RecordingError
from rhs.cli.main import main
from rhs.metrics.evaluate import evaluate_pair, pair_fault
from rhs.metrics.trajectory_forms import read_trajectory

COUNT = 30
WAY = Trajectory(0.1 * np.arange(COUNT), np.array([
    se3(exp_so3(np.array([0.1 * np.sin(k), 0.2 * np.cos(k / 2), 0.1 * k])), np.array([np.sin(0.2 * k), 0.1 * k, np.cos(k)]))
    for k in range(COUNT)]))
NUMBERED = np.arange(float(COUNT))
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
Z_FROM_Y = se3(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))  # z_up_from_y_up


def words(*values):
    return ",".join(f"{v:.9f}" for v in np.concatenate([np.ravel(v) for v in values]))


def motive(unit="Millimeters", scale=1000.0, bodies=("cart",), rotation="Quaternion"):
    """As Motive 2 and 3 write it: a rigid body with its error and a marker each; y is up; the third frame has nothing."""
    text = (f"Format Version,1.23,Take Name,walk,Capture Frame Rate,120,Rotation Type,{rotation},Length Units,{unit}\n\n"
            f",Type{''.join(',Rigid Body' * 8 + ',Rigid Body Marker' * 3 for _ in bodies)}\n"
            f",Name{''.join(f',{name}' * 8 + f',{name}:Marker 1' * 3 for name in bodies)}\n,ID{',7' * 11 * len(bodies)}\n"
            f",,{','.join((['Rotation'] * 4 + ['Position'] * 3 + ['Mean Marker Error'] + ['Position'] * 3) * len(bodies))}\n"
            f"Frame,Time (Seconds){',X,Y,Z,W,X,Y,Z,,X,Y,Z' * len(bodies)}\n")
    for k, (stamp, pose) in enumerate(zip(WAY.stamps_s, WAY.poses, strict=True)):
        turned = inverse(Z_FROM_Y) @ pose @ Z_FROM_Y
        seen = words(quaternion_xyzw(turned[:3, :3]), scale * turned[:3, 3], [0.1], [1, 2, 3])
        text += f"{k},{stamp:.6f}" + ("," + (seen if k != 2 else "," * 10)) * len(bodies) + "\n"
    return text


def qualisys(bodies=1, times=True):
    """As QTM exports 6DOF data: millimetres, a rotation column by column, zeros in the third frame."""
    one = [f"{'cart ' * (k == 0)}{name}" for k, name in enumerate(
        ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{k}]" for k in range(9))])]
    text = (f"NO_OF_FRAMES\t{COUNT}\nNO_OF_CAMERAS\t4\nNO_OF_BODIES\t{bodies}\nFREQUENCY\t10\nDATA_INCLUDED\t6D\n"
            "BODY_NAMES\tcart\n" + "\t".join((["Frame", "Time"] if times else []) + one * bodies) + "\n")
    for k, pose in enumerate(WAY.poses):
        numbers = [*1000 * pose[:3, 3], 0, 0, 0, 2.5, *pose[:3, :3].T.ravel()] if k != 2 else [0.0] * 16
        cells = [f"{k + 1}", f"{0.1 * k:.5f}"] if times else []
        text += "\t".join([*cells, *(f"{v:.9f}" for v in numbers * bodies)]) + "\n"
    return text


def kapture(devices=("0",)):
    rows = "".join(f"{k}, {devices[k % len(devices)]}, {words(np.roll(quaternion_xyzw(tcw[:3, :3]), 1), tcw[:3, 3])}\n"
                   for k, tcw in enumerate(inverse(WAY.poses)))
    return "# kapture format: 1.1\n# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz\n" + rows


def arkit():
    return "".join(f"{stamp} {words(Rotation.from_matrix(tcw[:3, :3]).as_rotvec(), tcw[:3, 3]).replace(',', ' ')}\n"
                   for stamp, tcw in zip(WAY.stamps_s, inverse(WAY.poses), strict=True))


def robotcar():
    head = ("timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,velocity_north,velocity_east,"
            "velocity_down,roll,pitch,yaw\n")
    angles = Rotation.from_matrix(WAY.poses[:, :3, :3]).as_euler("xyz")
    rows = (f"{1e15 + 1e6 * stamp:.0f},GOOD,51.7,-1.2,110.0,{words(pose[:3, 3])},30U,{words([0, 0, 0], angle)}\n"
            for stamp, pose, angle in zip(WAY.stamps_s, WAY.poses, angles, strict=True))
    return head + "".join(rows)


def nuscenes():
    return json.dumps([{"timestamp": int(1e15 + 1e6 * stamp), "rotation": np.roll(quaternion_xyzw(pose[:3, :3]), 1).tolist(),
                        "translation": pose[:3, 3].tolist()} for stamp, pose in zip(WAY.stamps_s, WAY.poses, strict=True)])


def nerfstudio():
    return json.dumps({"fl_x": 500.0, "frames": [{"file_path": f"images/frame_{k:05d}.png",
                                                  "transform_matrix": (pose @ FLIP).tolist()}
                                                 for k, pose in enumerate(WAY.poses)]})


def scannetpp():
    return json.dumps({f"frame_{k:06d}": {"timestamp": 0.1 * k, "pose": np.eye(4).tolist(), "aligned_pose": pose.tolist()}
                       for k, pose in enumerate(WAY.poses)})


def record3d():
    seen = WAY.poses @ FLIP
    return json.dumps({"fps": 60, "poses": [[*quaternion_xyzw(pose[:3, :3]), *pose[:3, 3]] for pose in seen]})


def open3d():
    return json.dumps({"class_name": "PinholeCameraTrajectory", "parameters": [
        {"extrinsic": tcw.T.ravel().tolist()} for tcw in inverse(WAY.poses)]})


@pytest.mark.parametrize(("form", "name", "stamps"), [
    (motive, "take.csv", np.delete(WAY.stamps_s, 2)), (kapture, "trajectories.txt", NUMBERED),
    (arkit, "lowres_wide.traj", WAY.stamps_s), (robotcar, "ins.csv", 1e9 + WAY.stamps_s),
    (nuscenes, "ego_pose.json", 1e9 + WAY.stamps_s), (nerfstudio, "transforms.json", NUMBERED),
    (scannetpp, "pose_intrinsic_imu.json", NUMBERED), (record3d, "metadata.json", NUMBERED),
    (open3d, "trajectory.json", NUMBERED), (qualisys, "walk_6D.tsv", np.delete(WAY.stamps_s, 2)),
])
def test_an_export_is_read_as_what_it_means(tmp_path, form, name, stamps):
    (tmp_path / name).write_text(form())
    read = read_trajectory(tmp_path / name)
    known = [k for k in range(COUNT) if k != 2 or form not in (motive, qualisys)]
    assert np.allclose(read.stamps_s, stamps) and np.allclose(read.poses, WAY.poses[known], atol=1e-6)


def test_a_recorded_table_of_qualisys_turns_as_the_angles_in_it_say(tmp_path):
    """The first frame of a ship model in a basin (shiplab/dt_cv, M510A): roll -0.656, pitch 0.094 and yaw 0.058 degrees."""
    (tmp_path / "a.tsv").write_text(
        "NO_OF_FRAMES\t1\nNO_OF_CAMERAS\t4\nNO_OF_BODIES\t1\nFREQUENCY\t100\nDESCRIPTION\t--\nDATA_INCLUDED\t6D\n"
        "BODY_NAMES\tPSVH\nFrame\tTime\tPSVH X\tY\tZ\tRoll\tPitch\tYaw\tResidual\t"
        + "\t".join(f"Rot[{k}]" for k in range(9)) + "\n1\t0.00000\t-194.91974\t2.24150\t0.99661\t-0.65630\t0.09391\t"
        "0.05772\t4.98536\t1.00000\t0.00099\t-0.00165\t-0.00101\t0.99993\t-0.01145\t0.00164\t0.01145\t0.99993\n")
    pose = read_trajectory(tmp_path / "a.tsv").poses[0]
    assert pose[:3, 3] == pytest.approx([-0.19492, 0.00224, 0.001], abs=1e-5)
    turned = Rotation.from_euler("XYZ", [-0.6563, 0.09391, 0.05772], degrees=True).as_matrix()
    np.testing.assert_allclose(pose[:3, :3], turned, atol=1e-4)


def test_a_table_of_qualisys_of_two_bodies_is_refused_and_one_without_times_takes_its_rate(tmp_path):
    (tmp_path / "a.tsv").write_text(qualisys(bodies=2))
    with pytest.raises(RecordingError, match=r"2 rigid bodies of Qualisys \(6D data\); expected one: export its 6DOF data"):
        read_trajectory(tmp_path / "a.tsv")
    (tmp_path / "a.tsv").write_text(qualisys(times=False))
    assert np.allclose(read_trajectory(tmp_path / "a.tsv").stamps_s, np.delete(WAY.stamps_s, 2))


def test_poses_by_the_numbers_of_images_take_the_times_beside_them(tmp_path):
    (tmp_path / "transforms.json").write_text(nerfstudio())
    (tmp_path / "times.txt").write_text("".join(f"{stamp}\n" for stamp in WAY.stamps_s))
    write_tum(tmp_path / "way.tum", WAY)
    assert evaluate_pair(tmp_path / "transforms.json", tmp_path / "way.tum")["ate_rmse_m"] < 1e-6


@pytest.mark.parametrize(("name", "text", "said"), [
    ("take.csv", motive(bodies=("cart", "wand")), r"2 rigid bodies of Motive \(cart, wand\).*export that alone"),
    ("take.csv", motive(rotation="XYZ"), "rotations as XYZ; expected one, as Quaternion"),
    ("take.csv", motive(unit="Feet"), "cannot be read"),
    ("trajectories.txt", kapture(("left", "right")), "the lines of one"),
    ("way.json", '{"version": 1}', "cannot be read"), ("way.json", "{", "cannot be read"),
    ("walk.csv", "Objects\n100\n,,cart\nFrame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n", "Vicon.*write it as lines of `stamp x y z"),
    ("walk.tsv", "NO_OF_FRAMES\t20\nDATA_INCLUDED\t3D\n", r"rigid body of Qualisys \(3D data\); expected one: export"),
    ("problem.txt", "4 9 20\n0 1     -3.9 2.6\n", r"\(BAL\)"),
    ("walk.bag", "#ROSBAG V2.0\n", "evo_traj bag2 walk.bag /TOPIC --save_as_tum"), ("a.gpx", "<gpx>", "east, north and up"),
    ("walk.log", "FLASER 1 2.0 0 0 0 0 0 0 1 a 1\n", "source=replay source.path=walk.log"),
])
def test_other_files_say_what_makes_a_trajectory_of_them(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(RecordingError, match=said) as caught:
        read_trajectory(tmp_path / name)
    assert len(shortened(str(caught.value))) < LONGEST or len(str(caught.value)) <= LONGEST


def test_a_tum_file_of_whatever_name_is_one(tmp_path):
    write_tum(tmp_path / "way.traj", WAY)
    assert np.allclose(read_trajectory(tmp_path / "way.traj").poses, WAY.poses, atol=1e-6)


def test_arrays_say_how_they_become_lines(tmp_path):
    np.save(tmp_path / "way.npy", np.zeros((3, 7)))
    with pytest.raises(RecordingError, match="n.savetxt"):
        read_trajectory(tmp_path / "way.npy")


def test_keys_of_gtsam_are_numbers_with_a_letter_above_them(tmp_path):
    """x0, x1, ... of older writers: with twenty digits all were one number, and of the way one pose was left."""
    rows = (f"VERTEX_SE3:QUAT {(ord('x') << 56) + k} {words(pose[:3, 3], quaternion_xyzw(pose[:3, :3])).replace(',', ' ')}\n"
            for k, pose in enumerate(WAY.poses))
    (tmp_path / "way.g2o").write_text("".join(rows))
    assert np.array_equal(read_trajectory(tmp_path / "way.g2o").stamps_s, NUMBERED)


@pytest.mark.parametrize("turns", [True, False])
def test_a_way_of_left_handed_axes_is_said_to_be_mirrored(tmp_path, turns):
    """All of it, or the places alone; a way on the floor is the same turned over, and nothing is said of it."""
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    flat = WAY.poses * np.array([[1], [1], [0], [1]]) + np.diag([0.0, 0, 1, 0])
    for poses, said in ((WAY.poses, True), (flat, False)):
        way = mirror @ poses @ mirror
        way[:, :3, :3] = way[:, :3, :3] if turns else poses[:, :3, :3]
        write_tum(tmp_path / "truth.tum", Trajectory(WAY.stamps_s, poses))
        write_tum(tmp_path / "way.tum", Trajectory(WAY.stamps_s, way))
        assert ("mirror image" in pair_fault(tmp_path / "way.tum", tmp_path / "truth.tum")) == said


def test_stamps_of_two_clocks_are_printed(tmp_path, capsys):
    write_tum(tmp_path / "truth.tum", WAY)
    write_tum(tmp_path / "way.tum", Trajectory(WAY.stamps_s + 3600.0, WAY.poses))
    assert main(["evaluate", str(tmp_path / "way.tum"), str(tmp_path / "truth.tum")]) == 3
    assert ": stamps of 3600.0 to 3602.9 and 0.0 to 2.9; another clock?" in capsys.readouterr().err
