"""Tables for papers and other programs."""

import subprocess
import sys

import pandas as pd
import pytest

from rhs.reports.export import as_latex, as_markdown
from rhs.reports.table import main, rows
from rhs.runfolder.row import write_row


@pytest.fixture
def folder(tmp_path):
    for seed in range(3):
        for planner in ("prm_star", "50% & |more|"):
            (tmp_path / "runs" / f"{planner[:2]}{seed}").mkdir(parents=True)
            write_row(tmp_path / "runs" / f"{planner[:2]}{seed}",
                      {"status": "ok", "reason": "", "world": "w", "planner": planner, "seed": seed, "places_total": 1,
                       "places_visited": 1, "path_length_m": 5.0 + seed})
    return tmp_path


def test_latex_escapes_and_keeps_every_line(folder):
    assert main([str(folder / "runs"), "--latex", str(folder / "t.tex")]) == 0
    text = (folder / "t.tex").read_text()
    assert r"prm\_star & 3 & 3 & 0" in text and r"50\% \& |more| & 3" in text and r"\toprule" in text
    assert all(line.startswith("%") or line.startswith("\\") or line.endswith(r"\\") for line in text.splitlines())
    assert "% 0 of 6 failed" in text


def test_markdown_has_a_cell_for_every_column(folder):
    assert main([str(folder / "runs"), "--compare", "planner", "--columns", "path_length_m", "--markdown",
                 str(folder / "t.md")]) == 0
    lines = [line for line in (folder / "t.md").read_text().splitlines() if line.startswith("|")]
    assert len(lines) == 3 and len({line.count("|") for line in lines}) == 1
    assert "corrected for 1 comparisons" in (folder / "t.md").read_text()


def test_parquet_reads_back_with_its_types(folder):
    pytest.importorskip("pyarrow")
    assert main([str(folder / "runs"), "--parquet", str(folder / "t.parquet")]) == 0
    again = pd.read_parquet(folder / "t.parquet")
    table = rows([folder / "runs"])
    assert list(again["run"]) == list(table.index) and list(again["path_length_m"]) == list(table["path_length_m"])
    assert (again["reason"] == "").all() and again["seed"].dtype == table["seed"].dtype


def test_parquet_without_pyarrow_is_refused_in_one_line(folder):
    """In a process that never had it: pandas holds text otherwise then."""
    words = [str(folder / "runs"), "--parquet", str(folder / "t.parquet")]
    code = f"import sys; sys.modules['pyarrow'] = None; from rhs.reports.table import main; sys.exit(main({words!r}))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 2
    assert "pip install 'rhs[parquet]'" in run.stderr and len(run.stderr.splitlines()) == 1
    assert not (folder / "t.parquet").exists()


def test_a_refused_request_writes_nothing(folder):
    assert main([str(folder / "runs"), "--compare", "odometry", "--csv", str(folder / "t.csv")]) == 2
    assert not (folder / "t.csv").exists()


def test_a_view_without_lines():
    empty = pd.DataFrame({"a": pd.Series(dtype="float64")})
    assert "a" in as_markdown(empty) and "a" in as_latex(empty)
