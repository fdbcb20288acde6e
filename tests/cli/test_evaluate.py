"""The figures again, from files."""

import numpy as np
import pytest
from helpers.synthetic_run import make_run

from rhs.api.geometry import se2
from rhs.api.trajectory import Trajectory, write_tum
from rhs.cli.evaluate import main
from rhs.metrics.evaluate import evaluate
from rhs.runfolder.row import write_row


@pytest.fixture
def run(tmp_path):
    folder = make_run(tmp_path / "run", count=12)
    write_row(folder, {"status": "ok"} | evaluate(folder) | {"odometry_ms": 999.0})
    return folder


def test_a_row_that_follows_from_its_files(run, capsys):
    assert main([str(run)]) == 0
    out, err = capsys.readouterr()
    assert "map_agreement" in out and not err


def test_a_row_that_was_touched_up(run, capsys):
    write_row(run, {"status": "ok"} | evaluate(run) | {"ate_rmse_m": 0.0001})
    assert main([str(run)]) == 3
    assert "ate_rmse_m: row.json says 0.0001" in capsys.readouterr().err


def test_two_trajectories(tmp_path, capsys):
    stamps = np.arange(10) * 0.1
    truth = np.array([se2(i * 0.1, (i % 3) * 0.1, 0.0) for i in range(10)])
    scaled = truth.copy()
    scaled[:, :3, 3] *= 2.0
    write_tum(tmp_path / "truth.tum", Trajectory(stamps, truth))
    write_tum(tmp_path / "estimate.tum", Trajectory(stamps, scaled))
    files = [str(tmp_path / "estimate.tum"), str(tmp_path / "truth.tum")]
    figures = {}
    for alignment in ("se3", "sim3"):
        assert main([*files, "--alignment", alignment]) == 0
        lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
        figures[alignment] = float(lines["ate_rmse_m"])
        assert lines["ate_alignment"] == alignment
    assert figures["sim3"] < 1e-6 < 0.1 < figures["se3"]


@pytest.mark.parametrize("words", [["nowhere"], ["a", "b", "c"], ["a.tum", "b.tum", "--alignment", "best"],
                                   ["a.tum", "b.tum", "--tolerance", "nan"]])
def test_refusals(words, capsys):
    assert main(words) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def lines(*stamps: float) -> str:
    return "".join(f"{stamp} {0.1 * k} 0 0 0 0 0 1\n" for k, stamp in enumerate(stamps))


def test_an_empty_file_is_named_and_not_the_other(tmp_path, capsys):
    for name, text in (("none.tum", ""), ("header.tum", "# stamp x y z qx qy qz qw\n"), ("way.tum", lines(0, 1, 2, 3))):
        (tmp_path / name).write_text(text)
    for files in (("none.tum", "way.tum"), ("header.tum", "way.tum"), ("way.tum", "none.tum")):
        assert main([str(tmp_path / name) for name in files]) == 2
        empty = next(name for name in files if name != "way.tum")
        assert f"{empty}: holds no pose" in capsys.readouterr().err


def test_seconds_that_count_from_zero_are_stamps_and_lines_without_any_are_none(tmp_path, capsys):
    (tmp_path / "truth.tum").write_text(lines(0, 1, 2, 3))
    (tmp_path / "fine.tum").write_text(lines(*np.arange(0, 3.5, 0.5)))
    (tmp_path / "kitti.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 4)
    (tmp_path / "longer.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 9)
    truth = str(tmp_path / "truth.tum")
    assert main([str(tmp_path / "fine.tum"), truth]) == 0
    assert main([str(tmp_path / "kitti.txt"), truth]) == 0  # a pose for each
    capsys.readouterr()
    assert main([str(tmp_path / "longer.txt"), truth]) == 2
    assert "longer.txt: its lines have no stamps" in capsys.readouterr().err


def test_a_folder_without_a_run_is_told_so(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    assert "is no run folder: it holds neither row.json nor steps.csv" in capsys.readouterr().err
