"""A warm process per worker, and a bench per test."""

from __future__ import annotations

import pytest
from faults.bench import Bench
from faults.warm import Warm
from installing import FAKES, environment


@pytest.fixture(scope="session")
def warm():
    process = Warm(environment(FAKES))
    yield process
    process.close()


@pytest.fixture
def bench(tmp_path, warm, real_data):
    return Bench(tmp_path, warm, real_data)
