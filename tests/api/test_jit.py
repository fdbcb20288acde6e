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


SAVES = """
import sys, time
from numba.core.caching import IndexDataCacheFile
from rhs.api import jit
jit._save_in_turn()
kept = IndexDataCacheFile(sys.argv[1], "function", "stamp")
for number in range(100):
    kept.save((sys.argv[2], number), (sys.argv[2], number))
"""


def test_signatures_that_two_processes_save_at_once_are_all_kept_apart(tmp_path):
    """numba alone loses half of them, or gives one the code of another."""
    from numba.core.caching import IndexDataCacheFile

    saving = [subprocess.Popen([sys.executable, "-c", SAVES, str(tmp_path), name]) for name in "ab"]
    assert [process.wait(100) for process in saving] == [0, 0]
    kept = IndexDataCacheFile(str(tmp_path), "function", "stamp")
    assert [kept.load((name, number)) for name in "ab" for number in range(100)] == [
        (name, number) for name in "ab" for number in range(100)]
