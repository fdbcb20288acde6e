"""Poses whose matrices stand in lines of four numbers, as NumPy prints them and Neural RGB-D has them."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import exp_so3, se3
from rhs.base.errors import RecordingError
from rhs.metrics.trajectory_forms import read_trajectory
from rhs_sources.folders.poses import poses_by_line

WAY = [se3(exp_so3(np.array([0.1 * k, 0.2, -0.05 * k])), np.array([0.1 * k, 1.0, 0.3])) for k in range(7)]


def written(path, poses, rows):
    lines = (f"{' '.join(f'{v:.9f}' for v in row)}\n" for pose in poses for row in pose[:rows])
    path.write_text("".join(lines))
    return path


@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("count", [6, 7])  # 24 lines of four are also eight poses of three lines
def test_three_and_four_lines_a_pose_are_read_alike_by_runs_and_by_evaluate(tmp_path, rows, count):
    path = written(tmp_path / "poses.txt", WAY[:count], rows)
    assert read_trajectory(path).poses == pytest.approx(np.array(WAY[:count]), abs=1e-7)
    found = poses_by_line(path)
    assert [*found] == [*range(count)] and np.array([*found.values()]) == pytest.approx(np.array(WAY[:count]), abs=1e-7)


def test_a_view_that_was_not_found_has_no_pose(tmp_path):
    """Neural RGB-D writes NaN in all four lines of it."""
    found = poses_by_line(written(tmp_path / "poses.txt", [WAY[0], np.full((4, 4), np.nan), WAY[2]], 4))
    assert found[1] is None and found[2] == pytest.approx(WAY[2], abs=1e-7)


@pytest.mark.parametrize("lines", ["0.0 0.1 0.2 0.3\n" * 12, "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 0 0 0\n"])
def test_four_columns_that_are_no_matrices_and_half_a_matrix_are_refused(tmp_path, lines):
    path = tmp_path / "way.txt"
    path.write_text(lines)
    with pytest.raises(RecordingError, match="expected 8 finite numbers: stamp x y z qx qy qz qw"):
        read_trajectory(path)
    assert poses_by_line(path) is None
