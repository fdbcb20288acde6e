"""What the C library does with the memory of an image when it is freed: kept for the next one, not handed back until a run
is through with images; and the compiler's pages, which nobody reads once the kernels are loaded.

glibc gives large blocks back to the system at once and asks for them again a moment later. A view's image pyramids are
some 75 MB, so nearly half the time of SIFT at 640x480 went into fresh pages (60 views: 152 ms each, 89 ms when kept).
"""

from __future__ import annotations

import ctypes
import re
import sys
from functools import cache
from pathlib import Path

# mallopt(3) parameters, malloc.h
M_TRIM_THRESHOLD = -1
M_MMAP_THRESHOLD = -3
M_ARENA_MAX = -8
# Blocks up to this size come from the heap: the most that every glibc takes; a plane of a 2000x2000 float64 image.
LARGEST_BLOCK_BYTES = 32 << 20
# The heap shrinks only when this much lies free at its end.
KEPT_BYTES = 256 << 20
# One heap for all threads: each with a heap of its own would keep what it freed from the others, a tenth of a run's memory.
HEAPS = 1
# madvise(2), sys/mman.h
MADV_DONTNEED = 4
# Numba's compiler: loading a cached kernel walks through 65 MB of its program text and constants.
COMPILER, LOADED_BY = "libllvmlite", "llvmlite.binding"


@cache
def keep_freed_memory() -> bool:
    """Tell the C library to keep freed memory, for the whole process. False where it cannot be told (not glibc)."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return False
    wanted = ((M_MMAP_THRESHOLD, LARGEST_BLOCK_BYTES), (M_TRIM_THRESHOLD, KEPT_BYTES), (M_ARENA_MAX, HEAPS))
    return all([mallopt(*each) for each in wanted])


def hand_back() -> bool:
    """Give the system all memory that is freed by now, and the compiler's: what comes next needs other memory. False where
    it cannot be told."""
    let_go_of_compiler()
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return False
    return bool(trim(0))


def let_go_of_compiler() -> bool:
    """Let go of the pages that the compiler has of its file, program text and constants: those that are needed again are
    mapped anew. False where the system cannot be told (not Linux), or the compiler is not loaded."""
    try:
        advise = ctypes.CDLL(None).madvise
        spans = _compiler_spans() if LOADED_BY in sys.modules else ()
    except (AttributeError, OSError, TypeError):
        return False
    for first, last in spans:
        advise(ctypes.c_void_p(first), ctypes.c_size_t(last - first), MADV_DONTNEED)
    return bool(spans)


@cache
def _compiler_spans() -> tuple[tuple[int, int], ...]:
    """First and last address of what the loaded compiler has mapped of its file and never wrote to, for good: the system
    walks through all pages of the process to say so (20 ms)."""
    spans, span = [], None
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if begins := re.match(r"([0-9a-f]+)-([0-9a-f]+) (\S+) ", line):
            span = (int(begins[1], 16), int(begins[2], 16)) if COMPILER in line and "w" not in begins[3] else None
        elif span is not None and re.match(r"Anonymous: +0 kB", line):
            spans.append(span)
    return tuple(spans)
