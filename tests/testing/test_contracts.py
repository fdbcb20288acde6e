"""Every registered plugin keeps the contract of its kind, whoever wrote it."""

from __future__ import annotations

from pathlib import Path

import pytest

from rhs.api.contracts import DEGRADE, KINDS
from rhs.config import registry
from rhs.testing.checks import checks

CASES = [pytest.param(kind, name, check, id=f"{kind}-{name}-{label}") for kind in (*KINDS, DEGRADE)
         for name in registry.names(kind) for label, check in checks(kind).items()]


@pytest.mark.parametrize(("kind", "name", "check"), CASES)
def test_plugin(kind, name, check, tmp_path: Path):
    if (why := registry.failure(kind, name)) is not None:
        pytest.skip(why)
    check(registry.load(kind, name)(), tmp_path)
