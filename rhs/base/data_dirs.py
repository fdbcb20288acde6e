"""Where the data folders (conf/, worlds/) are: inside the installed package (wheel) or beside it (checkout)."""

from __future__ import annotations

from pathlib import Path

from .errors import ConfigError

_PACKAGE = Path(__file__).resolve().parents[1]


def data_dir(name: str) -> Path:
    """Folder of that name, absolute. Raises ConfigError when the installation lacks it."""
    for candidate in (_PACKAGE / "data" / name, _PACKAGE.parent / name):
        if candidate.is_dir():
            return candidate
    raise ConfigError(f"data folder {name}/ is neither in {_PACKAGE} nor beside it; reinstall rhs")
