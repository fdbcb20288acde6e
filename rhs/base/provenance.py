"""Where a number comes from: version, commit, config hash, seed, libraries. An allow-list; the environment stays out."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from .processes import BLAS
from .system import vector_units

LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "pybullet", "ompl", "hydra-core")
FORKS = {"pybullet": "pybullet-arm64"}  # the same module by another name, where the first has no wheels (pyproject.toml)

CODE = (".py", ".so", ".pyd")
MOST_FILES = 1000  # of a package whose code is hashed


@cache
def versions() -> str:
    """`name=version` of the libraries that can change a number; `vectors`, and `kernels`: they choose their inner loops by
    the processor, `native`, or take those that are the same everywhere (rhs.base.processes.steady)."""
    known = [("python", platform.python_version()), ("rhs", _version("rhs"))]
    known += [(name, _version(name)) for name in LIBRARIES]
    known += [("vectors", _vectors()), ("kernels", os.environ.get(BLAS, "native").lower())]
    return " ".join(f"{name}={number}" for name, number in known)


@cache
def commit() -> str:
    """Short git commit of the checkout that this process runs, with `+` when it has changes; empty outside a checkout."""
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return ""
    try:
        words = ["git", "-C", str(folder), "describe", "--always", "--dirty=+", "--abbrev=10"]
        return subprocess.run(words, capture_output=True, text=True, timeout=5, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


@cache
def code_hash(module: str) -> str:
    """12 hex digits of the code of the package that a module is of, as its files were when first asked; empty where there
    is none to read, or too much."""
    digest = hashlib.sha256()
    try:
        spec = find_spec(module.partition(".")[0])
        roots = [Path(root) for root in (spec and spec.submodule_search_locations) or ()]
        inside = [path for root in roots for path in sorted(root.rglob("*")) if path.suffix in CODE]
        files = inside if roots or spec is None or spec.origin is None else [Path(spec.origin)]
        for path in files[:MOST_FILES]:
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    except (OSError, ValueError, ImportError):
        return ""
    return digest.hexdigest()[:12] if 0 < len(files) <= MOST_FILES else ""


def _vectors() -> str:
    """The widest vector unit of the processor by name, `unknown` where Linux does not tell."""
    return next((name for name in ("avx512f", "avx2", "avx", "sse2") if name in vector_units()), "unknown")


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return f"{_version(fork)} ({fork})" if (fork := FORKS.get(name)) else "absent"


def peak_memory_mb() -> float:
    """Most memory this process has held so far, MB. /proc where there is one: getrusage also counts the parent's."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024.0
    except (OSError, StopIteration):
        try:
            import resource
        except ImportError:  # Windows
            return float("nan")
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
