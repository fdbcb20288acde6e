"""A recording's truth, laid into the frame of the belief."""

import numpy as np
import pytest

from rhs.api.geometry import exp_so3, se2, se3
from rhs.api.trajectory import Trajectory, write_tum
from rhs.reports.report import DIGITS, truth_in_map
from rhs.runfolder.run import Run


def written(folder, estimate, truth):
    stamps = np.arange(float(len(estimate)))
    write_tum(folder / "estimate.tum", Trajectory(stamps, estimate))
    write_tum(folder / "truth_survey.tum", Trajectory(stamps, truth))
    return truth_in_map(Run(folder))


def way():
    return np.array([se2(0.3 * k, np.sin(0.4 * k), 0.2 * k) for k in range(12)])


def test_a_truth_measured_in_another_frame_of_another_body_is_the_belief_where_that_is_right(tmp_path):
    elsewhere = se3(exp_so3(np.array([0.3, -1.2, 2.5])), np.array([4.0, -2.0, 1.5]))
    other_body = se3(exp_so3(np.array([-1.5, 0.1, 0.7])), np.zeros(3))
    laid = written(tmp_path, way(), elsewhere @ way() @ other_body)
    for stamp, pose in enumerate(way()):
        x, y, yaw = laid[float(stamp)]
        assert (x, y) == pytest.approx(pose[:2, 3], abs=1e-6)
        assert np.exp(1j * yaw) == pytest.approx(np.exp(1j * 0.2 * stamp), abs=1e-6)


def test_an_error_of_the_belief_stays_to_be_seen(tmp_path):
    believed = way()
    believed[6, 0, 3] += 0.5
    laid = written(tmp_path, believed, se2(3.0, 1.0, 2.0) @ way())
    errors = [np.hypot(*(laid[float(k)][:2] - believed[k, :2, 3])) for k in range(12)]
    assert np.argmax(errors) == 6 and errors[6] > 0.4


def test_a_stamp_with_more_digits_than_a_file_has_finds_its_truth(tmp_path):
    """Views a third of a second apart: 1/3 + 1/3 + ... in steps.csv, 0.333333333 in a trajectory."""
    stamps = np.cumsum(np.full(12, 1 / 3))
    write_tum(tmp_path / "estimate.tum", Trajectory(stamps, way()))
    write_tum(tmp_path / "truth_survey.tum", Trajectory(stamps, way()))
    assert set(truth_in_map(Run(tmp_path))) == {round(float(stamp), DIGITS) for stamp in stamps}


def test_without_a_truth_there_is_nothing(tmp_path):
    write_tum(tmp_path / "estimate.tum", Trajectory(np.arange(12.0), way()))
    assert truth_in_map(Run(tmp_path)) == {}


def test_a_belief_without_a_scale_is_compared_in_its_own_unit(tmp_path):
    """One camera, whose unit is a tenth of a metre: right but for that, it is not wrong by metres."""
    (tmp_path / "steps.csv").write_text("index,phase,stamp_s,motion_scale_known\n0,survey,0.0,0\n")
    true = way()
    true[:, :3, 3] *= 10.0
    laid = written(tmp_path, way(), se2(3.0, 1.0, 2.0) @ true)
    assert max(np.hypot(*(laid[float(k)][:2] - way()[k, :2, 3])) for k in range(12)) < 1e-6
