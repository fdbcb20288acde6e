"""The benchmark of RGB-D odometries beside their peers leaves the published table alone where it cannot fill it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

BENCHMARKS = Path(__file__).parent / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))
import peers_rgbd  # noqa: E402


def test_without_the_peers_nothing_is_run_or_written_and_what_to_install_is_said(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pyorbslam3" else object())
    monkeypatch.setattr(peers_rgbd, "PUBLISHED", tmp_path / "table.csv")
    monkeypatch.setattr(sys, "argv", ["peers_rgbd.py", "source.path=FOLDER"])
    assert peers_rgbd.main() == 2 and not (tmp_path / "table.csv").exists()
    assert "pyorbslam3 not installed; type pip install -e '.[peers]'" in capsys.readouterr().err
    assert peers_rgbd.not_installed(["keyframe", "open3d_hybrid"]) == []


def test_a_method_that_fails_leaves_the_published_table_as_it_is(monkeypatch, capsys, tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("kept\n")
    monkeypatch.setattr(peers_rgbd, "PUBLISHED", table)
    monkeypatch.setattr(peers_rgbd, "not_installed", lambda methods: [])
    monkeypatch.setattr(peers_rgbd.subprocess, "run", lambda *a, **k: type("Done", (), {"returncode": 0}))
    monkeypatch.setattr(peers_rgbd, "judged", lambda folder, method, *more: [
        {"method": method, "note": "failed (1): no display" if method == "orb_slam3" else ""}])
    monkeypatch.setattr(sys, "argv", ["peers_rgbd.py", "source.path=FOLDER"])
    assert peers_rgbd.main() == 1 and table.read_text() == "kept\n"
    assert "orb_slam3 failed (1): no display; no table is written" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", ["peers_rgbd.py", "source.path=FOLDER", "--methods", "keyframe"])
    assert peers_rgbd.main() == 0 and table.read_text() == "kept\n"  # of some methods no published table is made
