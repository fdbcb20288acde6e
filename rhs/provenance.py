"""Where a number comes from: version, commit, config hash, seed, libraries. An allow-list; the environment stays out."""

from __future__ import annotations

import hashlib
import json
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "pybullet", "ompl", "hydra-core")


def config_hash(resolved: dict[str, Any]) -> str:
    """Twelve hexadecimal digits of the resolved config: equal hash, equal experiment."""
    text = json.dumps(resolved, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def versions() -> str:
    """`name=version` of the libraries that can change a number."""
    known = [("python", platform.python_version()), ("rhs", _version("rhs"))]
    known += [(name, _version(name)) for name in LIBRARIES]
    return " ".join(f"{name}={number}" for name, number in known)


def commit() -> str:
    """Short git commit of the checkout that is running, with `+` when it has changes; empty outside a checkout."""
    folder = Path(__file__).resolve().parent.parent
    if not (folder / ".git").exists():
        return ""
    try:
        words = ["git", "-C", str(folder), "describe", "--always", "--dirty=+", "--abbrev=10"]
        return subprocess.run(words, capture_output=True, text=True, timeout=5, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "absent"
