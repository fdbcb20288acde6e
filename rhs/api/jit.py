"""The one door to numba: compiled once, kept on disk where that is possible."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, TypeVar, cast

_Function = TypeVar("_Function", bound=Callable[..., Any])


COLLECT_AFTER = 20_000  # new objects; Python's own 700 costs time, none at all 180 MB
_kept_on_disk = True
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # of what only compiled code calls: a third less to compile


def inner(function: _Function) -> _Function:
    """Like `compiled`, for a function that nothing but compiled functions calls: no door to Python is made for it."""
    return _kept(function, **INNER)


def compiled(function: _Function) -> _Function:
    """`function` compiled by numba without fast-math (same numbers everywhere) and cached beside its file.

    Where neither the package nor the user's cache folder can be written (a read-only installation), it is compiled
    anew by each process instead of failing. Import only from modules that are themselves imported when chosen: numba
    takes half a second to load.
    """
    return _kept(function)


def _kept(function: _Function, *signature: Any, **options: Any) -> _Function:
    import numba

    _collect_less()
    _save_in_turn()
    njit: Any = numba.njit
    # Nothing compiled touches Python's objects: other threads go on meanwhile. A division by zero is infinite or no number,
    # as NumPy's: no branch that raises stands at each division.
    options = {"nogil": True, "error_model": "numpy"} | options
    try:
        return cast(_Function, njit(*signature, cache=True, **options)(function))
    except RuntimeError as error:
        if "locator" not in str(error):  # numba: "no locator available"
            raise
        global _kept_on_disk
        _kept_on_disk = False
        return cast(_Function, njit(*signature, **options)(function))


@cache
def _collect_less() -> None:
    """While numba compiles, its many short-lived objects are searched for garbage less often: a sixth of its time."""
    from numba.core import event

    class Calm(event.Listener):
        usual: ClassVar[list[tuple[int, int, int]]] = []  # of each function being compiled, one within another

        def on_start(self, event: Any) -> None:
            self.usual.append(gc.get_threshold())
            gc.set_threshold(COLLECT_AFTER, *self.usual[0][1:])

        def on_end(self, event: Any) -> None:
            gc.set_threshold(*self.usual.pop())

    event.register("numba:compile", Calm())


@cache
def _save_in_turn() -> None:
    """Processes save and read what numba keeps of a file's functions one after the other.

    numba finds a free name, notes it in an index and then writes there: two processes that save two signatures of a function
    at once may take one name, and one that reads in between finds what an older version of the function left there."""
    from numba.core import caching

    kept: Any = caching.IndexDataCacheFile
    save, load = kept.save, kept.load

    def save_alone(self: Any, key: Any, data: Any) -> None:
        with _alone(Path(self._index_path).parent, writing=True):
            save(self, key, data)

    def load_saved(self: Any, key: Any) -> Any:
        with _alone(Path(self._index_path).parent, writing=False):
            return load(self, key)

    kept.save, kept.load = save_alone, load_saved


@contextmanager
def _alone(folder: Path, *, writing: bool) -> Iterator[None]:
    """Among the processes that use a folder: alone in it, or while nobody writes. Where it cannot be locked, as it is."""
    try:
        import fcntl

        lock = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX if writing else fcntl.LOCK_SH)
        yield
    finally:
        os.close(lock)


def kept_on_disk() -> bool:
    """Whether what is compiled is kept for other processes, as far as this one has tried by now."""
    return _kept_on_disk


def on_compile(tell: Callable[[], None]) -> None:
    """Call `tell` once, when something has to be compiled because no cache holds it: what follows takes seconds."""
    from numba.core import event

    class Teller(event.Listener):
        told = False

        def on_start(self, event: Any) -> None:
            if not self.told:
                self.told = True
                tell()

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Teller())


def typed(signature: Any, **options: Any) -> Callable[[_Function], _Function]:
    """Decorator: compiled for one numba signature when the module is imported, so that no call has to wait for it.

    Cached and careful like `compiled`. options: numba's own, or INNER.
    """
    return lambda function: _kept(function, signature, **options)
