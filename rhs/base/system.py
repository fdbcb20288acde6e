"""What operating systems do differently, in one place: processors, locks, signals, reading at a position, memory.

Linux is what everything is made for. Where a call is missing (macOS, Windows) a single run goes on without it: planning,
replays and surveys led along a route need none of them. Sweeps need `fork`.
"""

from __future__ import annotations

import mmap
import os
import shutil
import signal
import threading
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

CAN_FORK = hasattr(os, "fork")
PAGE_BYTES = mmap.PAGESIZE
KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
ENDINGS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""signals that ask a process to end"""
_position = threading.Lock()


def processors() -> int:
    """Processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return os.cpu_count() or 1


def vector_units() -> set[str]:
    """Flags of the processor, `avx2` for example; none where Linux does not tell."""
    try:
        return set(Path("/proc/cpuinfo").read_text("utf-8", "replace").partition("flags")[2].partition("\n")[0].split())
    except OSError:
        return set()


def total_memory_mb() -> float:
    """Memory of the machine, MB; infinity where it cannot be told."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * PAGE_BYTES / 2**20
    except (AttributeError, ValueError, OSError):
        return float("inf")


def free_space_mb(folder: Path) -> float:
    """Space left where `folder` is, MB. Raises OSError where that cannot be told."""
    return shutil.disk_usage(folder).free / 1e6


def lock_file(descriptor: int, *, shared: bool = False) -> None:
    """Lock an open file, by oneself or with others that share it, until it is closed. Raises OSError when another has it."""
    if fcntl is not None:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    else:
        import msvcrt

        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]


def read_at(descriptor: int, size: int, at: int) -> bytes:
    """`size` bytes from position `at` of an open file, which other threads and forked processes may read meanwhile."""
    if hasattr(os, "pread"):
        return os.pread(descriptor, size, at)
    with _position:
        os.lseek(descriptor, at, os.SEEK_SET)
        return os.read(descriptor, size)


def write_at(descriptor: int, data: bytes, at: int) -> None:
    """Write at position `at` of an open file."""
    if hasattr(os, "pwrite"):
        os.pwrite(descriptor, data, at)
        return
    with _position:
        os.lseek(descriptor, at, os.SEEK_SET)
        os.write(descriptor, data)
