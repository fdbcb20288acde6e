"""PyBullet, imported without its banner."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

_ONE = threading.RLock()  # the streams are one for all threads: two that took them away would give back the void


@contextmanager
def quiet() -> Iterator[None]:
    """PyBullet and Mesa write banners past Python to both standard streams; a table on stdout must stay clean."""
    with _ONE:
        yield from _quiet()


def _quiet() -> Iterator[None]:
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
        with suppress(AttributeError, OSError, TypeError):  # not on Windows
            ctypes.CDLL(None).fflush(None)  # the C libraries keep their words in buffers of their own
    finally:
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for descriptor in (*kept, nowhere):
            os.close(descriptor)


with quiet():
    import pybullet



class Client:
    """A PyBullet world of its own. `close` it. It belongs to its process: it is not pickled, unless whoever inherits builds
    it anew."""

    def __init__(self) -> None:
        with quiet():
            self.client = pybullet.connect(pybullet.DIRECT)

    def close(self) -> None:
        """Let PyBullet forget the world; safe to call twice."""
        if self.client >= 0:
            with quiet():
                pybullet.disconnect(physicsClientId=self.client)
            self.client = -1

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("a PyBullet world belongs to its process")


__all__ = ["Client", "pybullet", "quiet"]
