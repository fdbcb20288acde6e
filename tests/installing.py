"""Puts the projects of tests/fakes/ and tests/thirdparty/ on the path, as an installation would."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rhs.config import registry

HERE = Path(__file__).resolve().parent
FAKES = HERE / "fakes"
CHOICE = ["source=fake", "sensor=fake", "odometry=fake", "loop_closer=fake", "mapper=fake", "planner=fake",
          "localiser=fake"]


@contextmanager
def installed(*folders: Path) -> Iterator[None]:
    """The distributions in these folders count as installed inside the with block."""
    before = list(sys.path)
    sys.path[:0] = [str(folder) for folder in folders]
    registry.forget()
    try:
        yield
    finally:
        sys.path[:] = before
        registry.forget()


def environment(*folders: Path, **more: str) -> dict[str, str]:
    """The environment of a child process in which they count as installed."""
    path = os.pathsep.join([*map(str, folders), os.environ.get("PYTHONPATH", "")]).strip(os.pathsep)
    return {**os.environ, "PYTHONPATH": path, **more}


def interruptible() -> None:
    """preexec_fn of a child process that is to be sent Ctrl-C: a shell's background job hands down that it is ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def installed_project(project: Path, site: Path) -> Path:
    """`site`, holding the project as pip would have installed it: its package and the metadata of its pyproject."""
    about = tomllib.loads((project / "pyproject.toml").read_text())["project"]
    metadata = site / f"{about['name'].replace('-', '_')}-{about['version']}.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {about['name']}\nVersion: {about['version']}\n")
    lines = [f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
             for group, points in about["entry-points"].items()]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    for package in project.glob("*/__init__.py"):
        shutil.copytree(package.parent, site / package.parent.name, ignore=shutil.ignore_patterns("__pycache__"))
    return site
