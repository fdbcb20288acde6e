"""What differs between runs becomes a column; what does not stays in config.yaml."""

import yaml

from rhs.reports.table import rows
from rhs.runfolder.row import write_row


def run_folder(parent, name, refine, seed):
    folder = parent / name
    folder.mkdir()
    config = {"seed": seed, "output": name, "odometry": {"name": "procrustes", "refine": refine, "planar": True}}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    write_row(folder, {"status": "ok", "odometry": "procrustes", "seed": seed, "ate_rmse_m": 0.1})


def test_a_setting_that_differs_is_a_column_and_one_that_does_not_is_none(tmp_path):
    run_folder(tmp_path, "a", "none", 0)
    run_folder(tmp_path, "b", "reprojection", 0)
    table = rows([tmp_path])
    assert sorted(table["odometry.refine"]) == ["none", "reprojection"]
    assert "odometry.planar" not in table and "output" not in table and "odometry.name" not in table


def test_a_run_without_a_config_leaves_its_cell_empty(tmp_path):
    run_folder(tmp_path, "a", "none", 0)
    run_folder(tmp_path, "b", "reprojection", 0)
    run_folder(tmp_path, "c", "none", 1)
    (tmp_path / "c" / "config.yaml").unlink()
    table = rows([tmp_path])
    assert table["odometry.refine"].isna().sum() == 1


def test_dicts_of_other_keys_are_other_settings(tmp_path):
    """Runs with {1: 2.0} and {2: 3.0} stood in one line; a setting that older runs of the part lack is no difference."""
    for name, heights, more in (("a", {1: 2.0}, {}), ("b", {2: 3.0}, {"new": 1})):
        (tmp_path / name).mkdir()
        config = {"seed": 0, "planner": {"name": "theirs", "heights": heights, **more}}
        (tmp_path / name / "config.yaml").write_text(yaml.safe_dump(config))
        write_row(tmp_path / name, {"status": "ok", "planner": "theirs", "seed": 0, "plan_length_m": 1.0})
    table = rows([tmp_path])
    assert table["planner.heights.1"].isna().sum() == table["planner.heights.2"].isna().sum() == 1
    assert "planner.new" not in table
