"""What the C library does with the memory of an image when it is freed: kept for the next one, not handed back until a run
is through with images.

glibc gives large blocks back to the system at once and asks for them again a moment later. A view's image pyramids are
some 75 MB, so nearly half the time of SIFT at 640x480 went into fresh pages (60 views: 152 ms each, 89 ms when kept).
"""

from __future__ import annotations

import ctypes
from functools import cache

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
    """Give the system all memory that is freed by now: what comes next needs other memory. False where it cannot be told."""
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return False
    return bool(trim(0))
