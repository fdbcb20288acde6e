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
