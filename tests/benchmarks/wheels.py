"""Which systems take `pip install rhs` without a compiler: three Pythons on each of six, resolved from wheels alone.

    pip install uv && python tests/benchmarks/wheels.py
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

SYSTEMS = {"Linux x86-64": "linux", "Linux ARM": "aarch64-unknown-linux-gnu", "Windows x86-64": "windows",
           "macOS 13 ARM": "aarch64-apple-darwin", "macOS 15 ARM": "aarch64-apple-darwin",
           "macOS 15 Intel": "x86_64-apple-darwin"}
PROJECT = Path(__file__).parents[2] / "pyproject.toml"


def missing(python: str, system: str) -> str:
    """The last words of the resolver where something has no wheel, else nothing."""
    words = ["uv", "pip", "compile", "-q", "--only-binary", ":all:", "--python-version", python, "--python-platform",
             SYSTEMS[system], str(PROJECT), "-o", os.devnull]
    target = {"MACOSX_DEPLOYMENT_TARGET": f"{system.split()[1]}.0"} if system.startswith("macOS") else {}
    done = subprocess.run(words, capture_output=True, text=True, env=os.environ | target)
    text = " ".join(done.stderr.split())
    return text[text.find("Because"):][:80] if done.returncode else ""


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    for one in SYSTEMS:
        for version in ("3.11", "3.12", "3.13"):
            print(f"{one:16} {version}  {missing(version, one) or 'wheels alone'}", flush=True)
