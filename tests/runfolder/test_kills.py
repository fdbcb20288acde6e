"""SIGKILL at random moments costs no row: a few of the 200 of tests/benchmarks/kills.py."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))


@pytest.mark.slow
def test_no_row_is_lost_and_every_killed_run_is_seen():
    from kills import measure

    found = measure(6, seed=1)
    assert sum(kind["kills"] for kind in found.values()) == 6
    assert {name: kind["lost"] for name, kind in found.items()} == {"run": 0, "overwriting": 0, "sweep": 0}
    assert {name: kind["kills"] - kind["seen"] for name, kind in found.items()} == {"run": 0, "overwriting": 0, "sweep": 0}
