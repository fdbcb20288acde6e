"""The one door to numba: compiled once, kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` compiled by numba without fast-math (same numbers everywhere) and cached beside its file.

    Where neither the package nor the user's cache folder can be written (a read-only installation), it is compiled
    anew by each process instead of failing. Import only from modules that are themselves imported when chosen: numba
    takes half a second to load.
    """
    import numba

    try:
        return numba.njit(cache=True)(function)
    except RuntimeError:  # numba: "no locator available"
        return numba.njit(function)


def on_compile(tell: Callable[[], None]) -> None:
    """Call `tell` once, when something has to be compiled because no cache holds it: what follows takes seconds."""
    from numba.core import event

    class Teller(event.Listener):
        told = False

        def on_start(self, event):
            if not self.told:
                self.told = True
                tell()

        def on_end(self, event):
            pass

    event.register("numba:compile", Teller())


def typed(signature: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator: compiled for one numba signature when the module is imported, so that no call has to wait for it.

    Cached and careful like `compiled`.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        import numba

        try:
            return numba.njit(signature, cache=True)(function)
        except RuntimeError as error:
            if "locator" not in str(error):
                raise
            return numba.njit(signature)(function)

    return decorate
