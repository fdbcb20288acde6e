"""The first run of an installation: a process beside it compiles the inner loops that the run will need later.

It begins when the run first finds a loop that nobody has compiled, so that later runs cost nothing; what it has compiled the
run finds in numba's cache. The loops are listed in conf/kernels.txt in the order in which they are compiled, those that the
run meets at once last. A run and this process that compile the same loop at the same time write the same files, each whole.
Nobody waits for this process or hears of it: without it, or with a list that lacks something, a first run only takes longer.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module

from rhs.base import processes
from rhs.base.data_dirs import data_dir

KERNELS = "kernels.txt"
STANDS_BACK = 10  # nice(2)
CODE = "import sys; sys.path[:] = sys.argv[2:]; from rhs.cli.first_run import compile_ahead; compile_ahead(int(sys.argv[1]))"


@cache
def begin() -> None:
    """Start the process, once, where that is allowed and what it compiles is kept. It ends with the one that called."""
    from rhs.api.jit import kept_on_disk

    if not (processes.has_helpers() and kept_on_disk()):
        return
    import subprocess

    with suppress(OSError):
        subprocess.Popen([sys.executable, "-c", CODE, str(os.getpid()), *sys.path], stdin=subprocess.DEVNULL,
                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compile_ahead(parent: int) -> None:
    """Compile what is listed, or read it where it is compiled already. parent: the process that this is done for."""
    processes.die_with_parent()
    if hasattr(os, "nice"):  # not on Windows
        os.nice(STANDS_BACK)
    from numba.core.sigutils import normalize_signature

    for module, function, signature in listed():
        if os.getppid() != parent:
            return
        with suppress(Exception):  # an older list; a part that is not installed
            found = import_module(module)
            if function:
                getattr(found, function).compile(normalize_signature(signature)[0])  # of a string it keeps it as that


def listed() -> Iterator[tuple[str, str, str]]:
    """(module, function, signature) of each line; the last two are empty where importing the module compiles its loops."""
    for line in (data_dir("conf") / KERNELS).read_text("utf-8").splitlines():
        name, _, signature = line.partition(" ")
        if signature.startswith("("):
            yield (*name.rsplit(".", 1), signature)  # type: ignore[misc]
        elif not line.startswith("#"):
            yield name, "", ""
