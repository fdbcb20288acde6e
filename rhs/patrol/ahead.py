"""The views of a survey that is led, taken before the loop asks for them by a thread of their own.

The way of such a survey depends on no estimate, and each part draws from a generator of its own: taken ahead or in line, the
views are the same to the last bit. While one is estimated the next ones are rendered and sensed; the interpreter's lock is
free in the renderer, in OpenCV and in numpy's generators. What taking a view raised comes out where the loop would have
met it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from queue import SimpleQueue
from typing import TypeVar

from rhs.api.contracts import Sensor, Source
from rhs.api.records import Capture
from rhs.base.system import processors

from .eyes import Eyes, Looked

MOST = 3  # views that wait, about 1 MB each
PATIENCE_S = 10.0  # for the view that is being taken when the run ends
_Value = TypeVar("_Value")


class Ahead:
    """Eyes that look ahead. `close` them: the thread is gone afterwards, unless a view takes longer than PATIENCE_S."""

    def __init__(self, eyes: Eyes) -> None:
        self._eyes = eyes
        self._taken: SimpleQueue[Callable[[], Looked | None]] = SimpleQueue()
        self._room = threading.Semaphore(MOST)
        self._over = False
        self._thread = threading.Thread(target=self._take, name="ahead", daemon=True)

    def __call__(self, move: Callable[[], Capture | None]) -> Looked | None:
        """The next view of the survey. move: how the loop would take it; not asked."""
        if self._thread.ident is None:
            self._thread.start()
        looked = self._taken.get()()
        self._room.release()
        return looked

    def close(self) -> None:
        """Take no more views. Safe to call twice."""
        self._over = True
        self._room.release()
        if self._thread.ident is not None and threading.current_thread() is not self._thread:
            self._thread.join(PATIENCE_S)

    def _take(self) -> None:
        while True:
            self._room.acquire()
            if self._over:
                return
            outcome, more = settled(lambda: self._eyes(self._eyes.source.lead))
            looked = outcome() if more else None
            if looked is not None:  # the source goes on: what is true of this view is asked now
                judged, more = settled(looked.judged)
                outcome = partial(replace, looked, judged=judged)
            self._taken.put(outcome)
            if looked is None or not more:
                return


def settled(call: Callable[[], _Value]) -> tuple[Callable[[], _Value], bool]:
    """The call made now: what gives its value, or raises what it raised, later; whether it went well."""
    try:
        value = call()
    except BaseException as error:  # a part may raise anything, even exit
        raised = error

        def again() -> _Value:
            raise raised

        return again, False
    return lambda: value, True


def wants_ahead(wanted: str) -> bool:
    """Whether something may be done beside the run. wanted: on, off, or auto, which wants two processors."""
    return wanted == "on" or (wanted == "auto" and processors() > 1)


def looks_ahead(wanted: str, source: Source, sensor: Sensor) -> bool:
    """Whether to look ahead: parts must allow it."""
    return bool(source.leads_ahead and sensor.senses_ahead) and wants_ahead(wanted)
