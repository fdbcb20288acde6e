"""Every fault of the list, tried through the command line (tests/README.md says what is expected of each)."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from faults import (  # noqa: F401
    environments,
    numerics,
    planners,
    plugins,
    recordings,
    security,
    sensors,
    stopping,
    sweeps,
    words,
)
from faults.catalogue import in_order, table

README = Path(__file__).resolve().parents[1] / "README.md"


@pytest.mark.parametrize(
    "fault", [pytest.param(one, id=one.id, marks=[pytest.mark.slow] if one.slow else []) for one in in_order()]
)
def test_fault(fault, bench):
    fault.attempt(bench)


def test_the_list_is_whole():
    groups = {"C": 12, "P": 11, "S": 10, "N": 9, "L": 7, "R": 10, "W": 14, "X": 7, "E": 5}
    assert [one.id for one in in_order()] == [
        f"{group}{n:02}" for group, count in groups.items() for n in range(1, count + 1)
    ]


def test_the_table_of_the_readme_is_the_list():
    assert table() in README.read_text("utf-8"), f"tests/README.md must hold:\n{table()}"


@pytest.mark.skipif("RHS_FAULTS" not in os.environ, reason="RHS_FAULTS names no shared list of faults")
def test_the_shared_list_is_the_same():
    shared = json.loads(Path(os.environ["RHS_FAULTS"]).read_text("utf-8"))
    assert [one["id"] for one in shared] == [one.id for one in in_order()]
