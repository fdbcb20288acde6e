"""The per-step table and its trajectories."""

import csv

import numpy as np
import pytest
from helpers.synthetic_run import make_steps

from rhs.api.errors import RhsError
from rhs.api.files import replacing
from rhs.api.trajectory import read_tum
from rhs.runfolder.run import Run
from rhs.runfolder.steps_csv import COLUMNS, StepTable


def fill(folder):
    table = StepTable(folder)
    for step in make_steps(8):
        table.add(step)
    for step in make_steps(8, phase="patrol", first=8):
        table.add(step)
    return table


def test_every_step_is_a_row_and_a_pose(tmp_path):
    fill(tmp_path).close()
    with (tmp_path / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["index"]) for row in rows] == list(range(16))
    assert rows[3]["motion_inliers"] == "53.0" and rows[3]["odometry_ms"] == "2.0"
    assert tuple(rows[0])[: len(COLUMNS)] == COLUMNS
    assert Run(tmp_path).steps == rows, "text by column, however it is held"
    assert Run(tmp_path).steps[0].get("nothing") is None
    for name, count in (("estimate", 8), ("truth_survey", 8), ("patrol", 8), ("truth_patrol", 8)):
        assert len(read_tum(tmp_path / f"{name}.tum")) == count
    row, pose = rows[10], read_tum(tmp_path / "truth_patrol.tum").poses[2]
    assert float(row["true_x_m"]) == pytest.approx(pose[0, 3])


def test_before_the_end_no_final_name_exists_and_afterwards_no_other(tmp_path):
    table = fill(tmp_path)
    assert all(".tmp-" in path.name for path in tmp_path.iterdir())
    assert len(next(tmp_path.iterdir()).read_text().splitlines()) == 16  # what a killed run leaves
    table.close()
    assert not [path for path in tmp_path.iterdir() if ".tmp-" in path.name]


def test_unknown_truth_is_an_empty_field_and_no_file(tmp_path):
    table = StepTable(tmp_path)
    import dataclasses

    for step in make_steps(3):
        table.add(dataclasses.replace(step, truth=None, clearance_m=np.nan))
    table.close()
    assert not (tmp_path / "truth_survey.tum").exists()
    with (tmp_path / "steps.csv").open() as file:
        assert {row["true_x_m"] for row in csv.DictReader(file)} == {""}


def test_a_failed_writer_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")
    with pytest.raises(ValueError), replacing(path) as file:
        file.write("new")
        raise ValueError("stopped")
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(RhsError, match="cannot write"):
        StepTable(tmp_path / "nowhere")
