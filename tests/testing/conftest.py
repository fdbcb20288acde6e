"""What tests of strangers' parts leave as they found it."""

from __future__ import annotations

import pytest

from rhs.config import loose, registry


@pytest.fixture
def afresh():
    """Parts registered by hand or from files are forgotten after the test."""
    yield
    loose._silent.clear()
    registry._by_hand.clear()
    registry.forget()
