"""Beside a checkout that nobody installed for this Python."""

import importlib.metadata

import pytest

from rhs.base.errors import PluginError
from rhs.config import registry


def test_what_is_not_installed_is_said_with_what_to_type(monkeypatch):
    """Its parts are entry points of its distribution: without it there are none, and lists of them would be empty."""
    monkeypatch.setattr(registry, "entry_points", lambda: importlib.metadata.EntryPoints(()))
    registry._on_path.cache_clear()
    try:
        with pytest.raises(PluginError, match=r"rhs is not installed for this Python.*pip install -e"):
            registry.names("metric")
    finally:
        registry._on_path.cache_clear()
