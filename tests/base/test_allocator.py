"""Freed memory stays with the process."""

from __future__ import annotations

import platform
import resource
import subprocess
import sys

import pytest

FAULTS = """
import resource
import numpy as np
from rhs.base.memory import keep_freed_memory
{first}
def faults():
    begin = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    blocks = [np.ones(500_000) for _ in range(10)]  # 4 MB each, 9766 pages of 4 KiB together
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - begin
faults()
print(faults())
"""


def faults(first: str) -> int:
    done = subprocess.run([sys.executable, "-c", FAULTS.format(first=first)], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc can be told")
def test_the_same_arrays_a_second_time_cost_no_new_pages():
    pages = 40_000_000 // resource.getpagesize()
    assert faults("pass") > pages / 2, "without it the test would show nothing"
    assert faults("assert keep_freed_memory()") < pages / 10


HANDED_BACK = """
import resource
from pathlib import Path
import numpy as np
from rhs.base.memory import hand_back, keep_freed_memory
def held_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20
keep_freed_memory()
small, large = [np.ones(1000) for _ in range(1000)], [np.ones(500_000) for _ in range(20)]
last = np.ones(1000)  # beyond them: the heap cannot simply shrink
del large
before = held_mb()
hand_back()
print(before - held_mb())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc can be told")
def test_what_was_freed_is_handed_back_when_asked():
    """Twenty arrays of 4 MB."""
    done = subprocess.run([sys.executable, "-c", HANDED_BACK], capture_output=True, text=True, check=True)
    assert float(done.stdout) > 60.0


LET_GO = """
import llvmlite.binding as llvm
from pathlib import Path
from rhs.base.memory import let_go_of_compiler
def text_mb():
    lines, held = Path("/proc/self/smaps").read_text().splitlines(), 0
    for k, line in enumerate(lines):
        if "r-xp" in line and "libllvmlite" in line:
            held += int(next(other for other in lines[k:] if other.startswith("Rss:")).split()[1]) / 1024
    return held
def run():
    return str(llvm.parse_assembly("define i32 @f() { ret i32 7 }"))
first, before = run(), text_mb()
assert let_go_of_compiler()
print(before, text_mb(), run() == first)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux can be told")
def test_the_compiler_is_let_go_of_and_works_when_it_is_asked_again():
    """Its program text is no longer held, in megabytes; what it makes of a function afterwards is the same."""
    done = subprocess.run([sys.executable, "-c", LET_GO], capture_output=True, text=True, check=True)
    before, after, same = done.stdout.split()
    assert float(before) > 1.0 and float(after) == 0.0 and same == "True"


COMPILER = """
import sys
import rhs.base.memory as memory
assert not memory.let_go_of_compiler() and memory._compiler_spans.cache_info().misses == 0, "it is not loaded yet"
import llvmlite.binding as llvm
llvm.initialize_native_target()
def resident_kb():
    inside, found = False, 0
    for line in open("/proc/self/smaps"):
        if "-" in line.split()[0]:
            inside = "libllvmlite" in line
        elif inside and line.startswith("Rss:"):
            found += int(line.split()[1])
    return found
before = resident_kb()
assert memory.let_go_of_compiler() and memory.let_go_of_compiler()
print(before, resident_kb(), memory._compiler_spans.cache_info().misses)
assert llvm.get_default_triple()
"""


@pytest.mark.skipif(platform.system() != "Linux", reason="only Linux can be told")
def test_the_compilers_pages_are_looked_for_once_and_let_go():
    """What it wrote to stays, the rest is read from its file again where it is needed."""
    done = subprocess.run([sys.executable, "-c", COMPILER], capture_output=True, text=True, check=True)
    before, after, looked = map(int, done.stdout.split())
    assert after < 0.6 * before and looked == 1
