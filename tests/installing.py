"""Puts the projects of tests/fakes/ and tests/thirdparty/ on the path, as an installation would."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rhs import registry

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
