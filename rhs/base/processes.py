"""Processes that others leave behind: found by /proc, ended. Where there is no /proc (not Linux), nothing is found.

A subreaper (prctl(2)) inherits the orphans among its descendants, so that even a child that went into a session of its
own and lost its parent is still found under whoever started it.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import threading
from collections.abc import Callable, Iterable
from pathlib import Path

from .system import CAN_FORK, ENDINGS, KILL, PAGE_BYTES, vector_units

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
AGAIN_S = 0.05
# Environment of a process whose sums must not depend on how many threads share them ...
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS",
           "OPENCV_FOR_THREADS_NUM")
BLAS = "OPENBLAS_CORETYPE"  # ... nor on who made the processor: OpenBLAS and NumPy choose their inner loops by it
NUMPY = "NPY_DISABLE_CPU_FEATURES"
SWEEP_PATH = "RHS_SWEEP_PATH"  # in the environment of the server of a sweep: where it looks for modules
SWEEP_PRELOAD = "RHS_SWEEP_PRELOAD"  # there too: modules that the parts of its jobs want loaded once


def steady() -> dict[str, str]:
    """Environment in which the same configuration and seed give the same row on any x86-64 processor with AVX2, and with any
    number of threads; read when numpy is imported. OpenBLAS adds as on Haswell, NumPy without AVX-512."""
    units = vector_units()
    kernels = {BLAS: "Haswell"} if "avx2" in units else {}
    narrow = {NUMPY: "X86_V4 AVX512_ICL AVX512_SPR"} if "avx512f" in units else {}
    return dict.fromkeys(THREADS, "1") | kernels | narrow


_helpers = False


def allow_helpers() -> None:
    """This process is a command of its own, nobody's test or library: it may start others that help it."""
    global _helpers
    _helpers = True


def has_helpers() -> bool:
    """Whether that was said."""
    return _helpers


def adopt_orphans() -> None:
    """Orphans among the descendants of this process become its children."""
    _prctl(PR_SET_CHILD_SUBREAPER, 1)


def die_with_parent() -> None:
    """This process is killed when the one that forked it ends."""
    _prctl(PR_SET_PDEATHSIG, KILL)


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def raises(error: type[BaseException], *, once: bool = False) -> Callable[[int, object], None]:
    """A handler of signals that raises in this process, the first time or every time. In a process that this one forks, a
    worker of a part's pool too, the signal ends it as any other."""
    def handle(number: int, frame: object) -> None:
        if once:
            signal.signal(number, signal.SIG_IGN)
        raise error()

    def as_usual() -> None:
        for number in ENDINGS:
            if signal.getsignal(number) is handle:
                signal.signal(number, signal.SIG_DFL)

    if CAN_FORK:
        os.register_at_fork(after_in_child=as_usual)
    return handle


def send_again(number: int) -> None:
    """That signal to this process, a moment later."""
    timer = threading.Timer(AGAIN_S, os.kill, (os.getpid(), number))
    timer.daemon = True
    timer.start()


def children(pid: int) -> list[int]:
    """Processes that this one started, or adopted."""
    found: list[int] = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (task / "children").read_text().split())
    return found


def descendants(pid: int) -> list[int]:
    """Children, their children, and so on."""
    found = children(pid)
    for child in list(found):
        found += descendants(child)
    return found


def resident_bytes(pid: int) -> int:
    """Memory held by a process and its descendants; pages that they share count for each."""
    total = 0
    for one in (pid, *descendants(pid)):
        with contextlib.suppress(OSError, ValueError, IndexError):
            total += int(Path(f"/proc/{one}/statm").read_text().split()[1]) * PAGE_BYTES
    return total


def kill(pids: Iterable[int]) -> None:
    """SIGKILL to each that is still there."""
    for pid in pids:
        with contextlib.suppress(OSError):
            os.kill(pid, KILL)


def end_unless(process: int) -> None:
    """Ends this process if it is another than the one of that number: the child of a part that forked, which would go on as
    if it were the run, and write everything twice."""
    if os.getpid() != process:
        kill([os.getpid()])


def kill_group(pid: int) -> None:
    """SIGKILL to the process, its descendants and its process group."""
    kill(descendants(pid))
    with contextlib.suppress(OSError, AttributeError):
        if os.getpgid(pid) == pid:
            os.killpg(pid, KILL)
    kill([pid])


def kill_strays(parent: int, keep: Iterable[int] = ()) -> None:
    """Kill the children of `parent`, except those to keep, and theirs, until none is left (at most 50 rounds)."""
    kept = set(keep)
    for _ in range(50):
        left = [pid for pid in children(parent) if pid not in kept and not _is_zombie(pid)]
        if not left:
            return
        kill([*left, *(below for pid in left for below in descendants(pid))])


def _is_zombie(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except (OSError, IndexError):
        return True
