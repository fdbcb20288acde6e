"""What several tests share."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from rhs.base.processes import BLAS, NUMPY, steady

if "numpy" not in sys.modules:  # rows of this process are those of the command line
    os.environ |= {name: value for name, value in steady().items() if name in (BLAS, NUMPY)}

os.environ["RHS_CACHE_MB"] = "0"  # no test takes a survey of another, or leaves one; those of the cache say where

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).parent))  # helpers beside the tests are importable


@pytest.fixture
def real_data():
    """A function: name -> path in the real data that the project did not make (RHS_DATA, else ../shared/data).

    It skips the test, saying so, when the data are absent."""

    def find(name: str) -> Path:
        path = Path(os.environ.get("RHS_DATA", ROOT.parent / "shared" / "data")) / name
        if not path.exists():
            pytest.skip(f"real data absent: {path}; set RHS_DATA to the folder that holds {name.split('/')[0]}/")
        return path

    return find
