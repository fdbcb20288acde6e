"""A user is told once, and only when something really is compiled."""

from __future__ import annotations

import os
import subprocess
import sys

TWICE = """
import gc
from rhs.api.jit import compiled, inner, on_compile

usual = gc.get_threshold()

@inner
def twice(x):
    return 2 * x

def doubled(x):
    return twice(x)

told = []
on_compile(lambda: told.append(1))
fast = compiled(doubled)
assert told == [] and fast(2) == 4
first = len(told)
assert fast(3) == 6 and fast(1.5) == 3.0
assert gc.get_threshold() == usual
print(first, len(told))
"""


def test_compiling_is_told_once_and_using_what_is_compiled_is_not(tmp_path):
    """In processes of their own: numba tells everybody of everything that any thread compiles."""
    (tmp_path / "twice.py").write_text(TWICE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}  # nothing is known yet
    said = [subprocess.run([sys.executable, str(tmp_path / "twice.py")], env=environment, capture_output=True, text=True,
                           check=True, timeout=120).stdout.split() for _ in range(2)]
    assert said == [["1", "1"], ["0", "0"]]  # compiled; then read from the cache
