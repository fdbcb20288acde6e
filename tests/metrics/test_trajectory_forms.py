"""Trajectories of KITTI and EuRoC beside TUM: the same way in three forms is the same way; broken ones are refused."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import quaternion_xyzw, se2
from rhs.api.trajectory import Trajectory, read_tum, write_tum
from rhs.base.errors import RecordingError
from rhs.metrics.evaluate import evaluate_pair
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
