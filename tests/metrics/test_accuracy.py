"""ATE, RPE and drift on cases that can be worked out by hand."""

import itertools

import numpy as np
import pytest

from rhs.api.geometry import exp_so3, inverse, se2
from rhs.api.trajectory import Trajectory
from rhs.metrics.accuracy import absolute_errors_m, apart, consecutive, pair, relative_errors, rmse, rotation_angles
from rhs.metrics.survey import trajectory_values


def line(count: int, step_m: float = 0.1, yaw_rad: float = 0.0) -> Trajectory:
    poses = np.array([se2(i * step_m * np.cos(yaw_rad), i * step_m * np.sin(yaw_rad), yaw_rad) for i in range(count)])
    return Trajectory(np.arange(count) * 0.1, poses)


def test_one_pose_fits_any_truth_and_has_no_error():
    values = trajectory_values(line(1, 0.1), line(1, 0.1, yaw_rad=1.0))
    assert np.isnan(values["ate_rmse_m"]) and np.isnan(values["ate_max_m"])


def test_an_odometry_that_says_ten_per_cent_too_much():
    """100 steps of 0.1 m told as 0.11 m: 1 m too far at the end, 0.01 m wrong in each step, 0.1 m in each metre."""
    values = trajectory_values(line(101, 0.11), line(101, 0.1))
    assert values["distance_m"] == pytest.approx(10.0)
    assert values["end_error_m"] == pytest.approx(1.0) and values["half_error_m"] == pytest.approx(0.5)
    assert values["rpe_trans_m"] == pytest.approx(0.01)
    assert values["rpe_trans_per_metre_m"] == pytest.approx(0.1)
    assert values["rpe_trans_per_second_m"] == pytest.approx(0.1)
    assert values["rpe_rot_rad"] == pytest.approx(0.0, abs=1e-9)
    # aligned at the middle the errors run evenly from -0.5 to 0.5 m
    assert values["ate_rmse_m"] == pytest.approx(rmse(np.arange(-50, 51) * 0.01))
    assert values["ate_max_m"] == pytest.approx(0.5)


def test_a_trajectory_that_stops_early_says_so():
    truth = line(101)
    values = trajectory_values(line(26), truth)
    assert values["ate_rmse_m"] == pytest.approx(0.0, abs=1e-9)
    assert values["matched_share"] == pytest.approx(26 / 101)
    assert values["covered_share"] == pytest.approx(0.25)
    assert values["distance_m"] == pytest.approx(10.0)  # of the whole survey, not of the part that was kept


def test_a_truth_measured_ten_times_as_often_is_still_matched_whole():
    fine = Trajectory(np.arange(1001) * 0.01, line(1001, 0.01).poses)
    assert pair(line(101), fine, 0.004).matched_share == pytest.approx(1.0, abs=0.01)


def test_nothing_estimated_is_unknown_and_not_zero():
    values = trajectory_values(None, line(10))
    assert np.isnan(values["ate_rmse_m"]) and values["matched_share"] == 0.0


def test_no_stamp_in_common():
    late = Trajectory(line(10).stamps_s + 100.0, line(10).poses)
    values = trajectory_values(late, line(10))
    assert values["matched_share"] == 0.0 and np.isnan(values["ate_rmse_m"])


def test_relative_errors_do_not_see_where_the_map_lies():
    truth = line(30)
    moved = Trajectory(truth.stamps_s, se2(5, -3, 1.0) @ truth.poses)
    trans, rot = relative_errors(pair(moved, truth, 0.01), consecutive(30))
    assert trans.max() < 1e-9 and rot.max() < 1e-9


def test_pairs_a_metre_apart_follow_one_another():
    assert apart(np.array([0, 0.4, 0.9, 1.1, 1.5, 2.0, 2.2]), 1.0).tolist() == [[0, 3], [3, 6]]


@pytest.mark.parametrize("angle", [0.0, 1e-7, 1.0, 3.0, np.pi])
def test_rotation_angles_are_exact_from_zero_to_pi(angle):
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    assert rotation_angles(exp_so3(axis * angle)[None])[0] == pytest.approx(angle, abs=1e-9)


def test_without_alignment_a_constant_offset_is_the_error():
    truth = line(10)
    shifted = Trajectory(truth.stamps_s, se2(3.0, 4.0, 0.0) @ truth.poses)
    both = pair(shifted, truth, 0.01)
    np.testing.assert_allclose(absolute_errors_m(both, "none"), 5.0)
    np.testing.assert_allclose(absolute_errors_m(both, "origin"), 0.0, atol=1e-12)
    assert inverse(shifted.poses[0])[0, 3] == pytest.approx(-3.0)


def test_the_end_of_a_way_without_a_scale_is_wrong_by_metres_of_the_truth():
    """A square of 4 m, closed; the estimate is a tenth of it and ends 0.02 of its units off: 0.2 m."""
    corners = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4], [0, 0]])
    way = np.concatenate([np.linspace(a, b, 50, endpoint=False) for a, b in itertools.pairwise(corners)] + [corners[-1:]])
    truth = Trajectory(np.arange(len(way)) * 0.1, np.array([se2(x, y, 0.0) for x, y in way]))
    poses = truth.poses.copy()
    poses[:, :3, 3] *= 0.1
    poses[-1, 0, 3] += 0.02
    values = trajectory_values(Trajectory(truth.stamps_s, poses), truth, alignment="sim3")
    assert values["end_error_m"] == pytest.approx(0.2, rel=0.01)
    assert values["half_error_m"] == pytest.approx(0.0, abs=0.01)
    assert trajectory_values(Trajectory(truth.stamps_s, poses), truth)["end_error_m"] == pytest.approx(0.02, rel=0.01)
