"""The program works from a wheel, from any folder, and puts nothing into site-packages but its own packages."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    code = f"from hatchling.build import build_wheel; print(build_wheel({str(folder)!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    zipfile.ZipFile(wheel).extractall(folder)
    return folder


def test_a_wheel_holds_packages_settings_and_worlds(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    top = {name.split("/")[0] for name in names}
    assert all(part == "rhs" or part.startswith(("rhs_", "rhs-")) for part in top), top
    for path in ("rhs/data/conf/config.yaml", "rhs/data/conf/stack/rgbd.yaml", "rhs/data/worlds/square.yaml", "rhs/py.typed",
                 "rhs_planners/config.py", "rhs_tasks/planning/task.py", "rhs_replan/__init__.py"):
        assert path in names
    assert not [name for name in names if "/results/" in name or name.endswith(".pyc")]


def run(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "rhs", *words], cwd=folder, capture_output=True, text=True, timeout=120,
                          env={**os.environ, "PYTHONPATH": str(site)})


def test_an_unpacked_wheel_runs_from_any_folder(site, tmp_path):
    code = "import rhs.base.data_dirs as p; print(p.data_dir('conf'), p.data_dir('worlds'))"
    where = subprocess.run([sys.executable, "-c", code],
                           cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(site)})
    assert where.stdout.split() == [f"{site}/rhs/data/conf", f"{site}/rhs/data/worlds"]
    done = run(site, tmp_path, "--cfg", "planner=prm", "world=square_small")
    assert done.returncode == 0, done.stderr
    assert "name: prm" in done.stdout
    assert run(site, tmp_path, "--help").returncode == 0
    assert list(tmp_path.iterdir()) == []


def test_a_wheel_lists_the_same_plugins_as_the_checkout(site, tmp_path):
    code = ("from rhs.config import registry; from rhs.api.contracts import KINDS\n"
            "print([(kind, registry.names(kind)) for kind in KINDS])")
    outputs = {subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True,
                              env={**os.environ, "PYTHONPATH": path}).stdout for path in (str(site), "")}
    assert len(outputs) == 1
